"""Node `replay`: publishes a recorded drive to a controller node and compares its answers.

In lockstep a packet is published once all that was to be answered before has been; in real time
packets come as they were recorded, from the first answer on. At the end one line of JSON says how
the answers compare, as `spikelane replay --json` does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import json
from pathlib import Path
import signal
import sys
import time

from event_camera_msgs.msg import EventPacket
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from spikelane_msgs.msg import LaneState, WheelVelocities

from spikelane.bag.drive import DrivePacket, RecordedDrive
from spikelane.runs.replay.metrics import Answer, summarise, unmeasured
from spikelane_sim import messages, topic_names
from spikelane_sim.binning import SensorParameters
from spikelane_sim.errors import ParameterError
from spikelane_sim.files import write_json
from spikelane_sim.filters import FilterParameters
from spikelane_sim.frame_names import CAMERA_FRAME, WHEEL_JOINTS
from spikelane_sim.nodes import conversions
from spikelane_sim.nodes.parameter_node import ParameterNode
from spikelane_sim.nodes.ros_parameters import declare_parameters
from spikelane_sim.nodes.running import run_node
from spikelane_sim.nodes.sole_publishers import SOLE_TOPICS, SolePublishers
from spikelane_sim.nodes.waiting import publishers_of, WaitingWarnings
from spikelane_sim.parameters import nested, parameter, Parameters
from spikelane_sim.period import PERIOD_MS
from spikelane_sim.sensor import Sensor

_LOOK_PERIOD_S = 0.02
_TICK_PERIOD_S = 0.001
_LAST_ANSWERS_S = 1.0  # how long they may take in real time
_KEPT = QoSProfile(depth=1000)


@dataclass(frozen=True, kw_only=True)
class ReplayNodeParameters(Parameters):
    """What is replayed, and how."""

    bag: str = parameter('', 'Folder of a bag, or one of its .mcap or .db3 files; required.')
    events: str = parameter(
        '',
        'Topic of the event packets; empty: /event_camera/events, or the only topic of event '
        'packets.',
    )
    period_ms: int = parameter(
        0,
        'Control period of the controller; 0: that of the recorded drive, or 50 for a camera.',
        unit='ms',
        low=0,
        high=PERIOD_MS,
    )
    mode: str = parameter(
        'lockstep',
        'When packets are published: after the answers to the packets before them (lockstep), '
        'or at the recorded times (realtime).',
        choices=('lockstep', 'realtime'),
    )
    rate: float = parameter(
        1.0, 'Recorded time per wall time in realtime mode.', low=0.01, high=1000.0
    )
    use_lane_state: bool = parameter(
        True, 'Publish lane/state with the packets, if the bag has it.'
    )
    output: str = parameter('', 'File for the result in JSON; empty: the result is only printed.')
    wait_for_subscribers: int = parameter(
        1,
        'Number of subscribers that event_camera/events must have before the first packet is '
        'published.',
        low=1,
        high=1000,
    )
    sensor: SensorParameters = nested(SensorParameters)
    filter: FilterParameters = nested(FilterParameters)


class ReplayNode(ParameterNode):
    """Publishes, gathers answers, and ends when all is done."""

    def __init__(self) -> None:
        """Declare the parameters and open the bag.

        Raises:
            SpikelaneError: A parameter is not allowed, or the bag cannot be replayed.
        """
        super().__init__('replay')
        self.exit_status = 0
        self._settings = settings = declare_parameters(self, ReplayNodeParameters)
        if not settings.bag:
            raise ParameterError("bag: expected the path of a bag, got ''")
        self._drive = RecordedDrive(Path(settings.bag), settings.events or None)
        self._has_lane = self._drive.has_lane and settings.use_lane_state
        # Only when which step is complete matters here, not what is seen in it.
        self._sensor = Sensor(
            settings.sensor,
            settings.filter,
            period_ns=(settings.period_ms or self._drive.period_ms or PERIOD_MS) * 1_000_000,
            has_lane=self._has_lane,
            any_size=True,
            sums_events=True,
        )
        self._packets: Iterator[DrivePacket] = self._drive.packets()
        self._next: DrivePacket | None = next(self._packets, None)
        self._answers: list[Answer] = []
        self._pending: dict[int, list[int]] = {}  # indices of answers awaited, by stamp [ns]
        self._lane_message, self._packet_message = LaneState(), EventPacket()
        self._lane_message.header.frame_id = conversions.WORLD_FRAME
        self._packet_message.header.frame_id = CAMERA_FRAME
        self.create_subscription(WheelVelocities, topic_names.WHEELS, self._on_wheels, _KEPT)
        self._lanes = self.create_publisher(LaneState, topic_names.LANE_STATE, _KEPT)
        self._joint_message = JointState(name=list(WHEEL_JOINTS))
        self._joints = self.create_publisher(JointState, topic_names.JOINT_STATES, _KEPT)
        self._events = self.create_publisher(EventPacket, topic_names.EVENTS, _KEPT)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._looking = self.create_timer(_LOOK_PERIOD_S, self._begin, clock=self._steady)
        SolePublishers(self, SOLE_TOPICS, self._fail).look_regularly()
        self._waiting = WaitingWarnings(self, self._progress, self._lacks)
        self._start_s = self._end_s = 0.0
        self._start_ns = 0
        self._has_begun = False  # real time
        self._is_halted = self._is_finished = False
        self.get_logger().info(
            f'{settings.mode}, {self._drive.count} event packets of {settings.bag}'
        )
        for note in self._drive.notes:
            self.get_logger().warning(note)

    def halt(self, number: int) -> None:
        """Publish nothing more, and say where that cuts the replay short; see `run_node`."""
        self._is_halted = True
        if not self._is_finished:
            self.get_logger().warning(
                f'ended by {signal.Signals(number).name} after {len(self._answers)} steps: there '
                'is no result'
            )
            self.exit_status = 128 + number

    def _fail(self, reason: str) -> None:
        """End without a result: the answers are not to this replay alone."""
        self.get_logger().fatal(reason)
        self._is_halted = self._is_finished = True
        self.exit_status = 1
        self.context.try_shutdown()

    def _begin(self) -> None:
        """Begin once the controller is there."""
        has_subscribers = (
            self._events.get_subscription_count() >= self._settings.wait_for_subscribers
        )
        if not has_subscribers or not publishers_of(self, topic_names.WHEELS):
            return
        self._looking.cancel()
        if self._joints.get_subscription_count() and not self._drive.has_encoders:
            self.get_logger().error(
                f'{self._settings.bag}: expected {topic_names.JOINT_STATES} of the wheels, which '
                'the controller waits for, got none'
            )
            self.exit_status = 1
            self._is_finished = True
            self.context.try_shutdown()
            return
        self._start_s = time.monotonic()
        self._advance()

    def _begin_real_time(self) -> None:
        """Let recorded time begin, now that the controller is awake: its first answer is slow."""
        self._has_begun = True
        self._start_s = time.monotonic()
        self._start_ns = self._next.log_ns if self._next else 0
        self.create_timer(_TICK_PERIOD_S, self._publish_due, clock=self._steady)

    def _advance(self) -> None:
        """Publish until there is something to wait for."""
        while not self._pending and self._next is not None and not self._is_halted:
            self._publish_next()
        if not self._pending and not self._is_halted:
            self._finish()

    def _publish_due(self) -> None:
        """Publish all whose time has come, and end when the last answers had theirs."""
        if self._is_halted:
            return
        elapsed_ns = (time.monotonic() - self._start_s) * 1e9 * self._settings.rate
        while self._next is not None and self._next.log_ns - self._start_ns <= elapsed_ns:
            self._publish_next()
            self._end_s = time.monotonic() + _LAST_ANSWERS_S
        if self._next is None and (not self._pending or time.monotonic() > self._end_s):
            self._finish()

    def _publish_next(self) -> None:
        recorded, self._next = self._next, next(self._packets, None)
        assert recorded is not None  # there is one to be published
        lane = recorded.lane if self._has_lane else None
        # A controller that waits for lane states never answers a packet without one.
        is_answerable = not self._has_lane or lane is not None
        for step in self._sensor.add(recorded.packet, lane):
            self._answers.append(
                Answer(
                    step.stamp_ns,
                    None if self._sensor.is_camera else recorded.lane,
                    len(step.events),
                    self._drive.answer(step.stamp_ns, recorded),
                    None,
                )
            )
            if is_answerable:
                self._pending.setdefault(step.stamp_ns, []).append(len(self._answers) - 1)
        if not is_answerable:
            return
        if lane is not None:
            conversions.fill_lane_state(self._lane_message, lane, recorded.packet.stamp_ns)
            self._lanes.publish(self._lane_message)
        if recorded.encoders is not None:
            stamp_ns = recorded.packet.stamp_ns
            conversions.fill_encoders(self._joint_message, recorded.encoders, stamp_ns)
            self._joints.publish(self._joint_message)
        conversions.fill_received_packet(self._packet_message, recorded.packet)
        self._events.publish(self._packet_message)

    def _on_wheels(self, message: WheelVelocities) -> None:
        stamp_ns = messages.to_stamp_ns(message.header.stamp)
        awaited = self._pending.get(stamp_ns)
        if not awaited:
            return  # sent once more, as somebody joined
        index = awaited.pop(0)
        if not awaited:
            del self._pending[stamp_ns]
        wheels = messages.wheels_from_message(message)
        self._answers[index] = self._answers[index]._replace(replayed=wheels)
        if self._pending or self._has_begun:
            return
        if self._settings.mode == 'lockstep':
            self._advance()
        else:
            self._begin_real_time()

    def _finish(self) -> None:
        self._is_finished = True
        result = {
            'bag': self._settings.bag,
            'mode': self._settings.mode,
            **summarise(self._drive, self._answers, self._sensor),
            'wall_time_s': time.monotonic() - self._start_s,
        }
        print(json.dumps(result), flush=True)
        if self._settings.output:
            write_json(Path(self._settings.output), result)
        if failure := unmeasured(self._answers, self._sensor):
            self.get_logger().error(f'{self._settings.bag}: {failure}')
            self.exit_status = 1
        self.context.try_shutdown()

    def _progress(self) -> tuple[int, int]:
        return len(self._answers), sum(map(len, self._pending.values()))

    def _lacks(self) -> str:
        """Return what is waited for, '' where only recorded time has to pass."""
        if not self._answers:
            return (
                f'waiting for {self._settings.wait_for_subscribers} subscribers of '
                f'{topic_names.EVENTS} and a publisher of {topic_names.WHEELS}; '
                f'{self._events.get_subscription_count()} and '
                f'{publishers_of(self, topic_names.WHEELS)} are there'
            )
        if self._pending:
            return f'waiting for {topic_names.WHEELS} with stamp {next(iter(self._pending))} ns'
        return ''


def main() -> None:
    """Run the node."""
    sys.exit(run_node(ReplayNode))


if __name__ == '__main__':
    main()
