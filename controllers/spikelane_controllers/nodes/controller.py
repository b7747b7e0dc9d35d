"""The base of every controller node: it receives observations and sends wheel velocities.

An observation is an event packet and the lane state of the same stamp, or without lane states a
step of any event camera (`spikelane_sim.sensor`). Each is answered once; the answer carries its
stamp and is re-sent when a subscriber joins or the observation comes again, so that no node waits
for a message that was sent too early, in whatever order the nodes start.
"""

from __future__ import annotations

import signal
import threading
from typing import Any, NamedTuple

from event_camera_msgs.msg import EventPacket
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from spikelane_msgs.msg import LaneState, WheelVelocities

from spikelane_controllers.controller_host import ControllerHost, image_size, period_ms_of
from spikelane_controllers.nodes.controller_parameters import (
    ControllerNodeParameters,
    RELIABILITIES,
)
from spikelane_controllers.nodes.diagnostics import ControllerDiagnostics, Counts
from spikelane_controllers.nodes.shown_publishers import ShownPublishers
from spikelane_controllers.nodes.warm_up import warm_up
from spikelane_controllers.registry import controller_class
from spikelane_sim import contract, messages, topic_names
from spikelane_sim.binning import SensorStep
from spikelane_sim.contract import Controller, Observation, sensors_of, WheelEncoders
from spikelane_sim.errors import ParameterError
from spikelane_sim.nodes import conversions
from spikelane_sim.nodes.base_drive import BaseDrive
from spikelane_sim.nodes.direct import DirectSubscriptions
from spikelane_sim.nodes.kept_publisher import KeptPublisher
from spikelane_sim.nodes.local_topics import LocalTopics
from spikelane_sim.nodes.meeting import Meeting
from spikelane_sim.nodes.pairing import StampGroups
from spikelane_sim.nodes.parameter_node import ChangePublisher, ParameterNode
from spikelane_sim.nodes.ros_parameters import declare_parameters
from spikelane_sim.nodes.sole_publishers import SOLE_TOPICS, SolePublishers
from spikelane_sim.nodes.waiting import publishers_of
from spikelane_sim.parameter_changes import changeable_specs
from spikelane_sim.parameters import Parameters
from spikelane_sim.period import PERIOD_MS
from spikelane_sim.sensor import Sensor

RELIABLE_10 = QoSProfile(depth=10)
_LOOK_PERIOD_S = 0.5


class _Identity(NamedTuple):
    """Tells an observation that comes again from another at the same time after a reset."""

    stamp_ns: int
    sequence: int


class ControllerNode(ParameterNode):
    """Hosts one controller of the registry."""

    def __init__(self, name: str, local: LocalTopics | None = None) -> None:
        """Declare the parameters and make the controller.

        Args:
            name: In the registry.
            local: Carries messages to and from a simulator of this process; None: there is none.

        Raises:
            SpikelaneError: A parameter is not allowed.
        """
        super().__init__(name)
        self.exit_status = 0
        self.is_done = False
        self._settings = settings = declare_parameters(self, ControllerNodeParameters)
        self._driver: Controller = self._make_driver(name)
        self._controller: Controller = self._wrap_driver(name, self._driver)
        period_ms = self._period_ms if settings.use_lane_state else None  # else no simulator
        self._host = ControllerHost(self._controller, settings.seed, self._changeable(), period_ms)
        self._changes = self._let_change()
        self._sensor = self._make_sensor()
        self._seen: _Identity | None = None
        self._answer = WheelVelocities()
        self._is_answered = self._is_sent = self._is_halted = False
        # The lane state of the last observation that was answered.
        self._lane: LaneState | contract.LaneState | None = None
        # Observations come in one thread, subscribers join in another.
        self._lock = threading.Lock()
        kept = QoSProfile(depth=self._settings.history_depth)
        self._shown = ShownPublishers(
            self, name, self._driver, self._settings.record_quantities, kept, self._on_match
        )
        self._wheels = KeptPublisher(
            self, WheelVelocities, topic_names.WHEELS, kept, self._on_match, local
        )
        self._received = self._lane_states = self._steps = 0
        self._reliability = RELIABILITIES[self._settings.reliability]
        self._has_encoders = 'encoders' in sensors_of(self._driver)
        if self._has_encoders and not self._settings.use_lane_state:
            raise ParameterError(
                f'use_lane_state: expected true, since {name} uses wheel encoders, which belong '
                "to a simulator's observations"
            )
        self._encoders: WheelEncoders | None = None  # of the observation at hand
        self._groups = StampGroups(self._on_group, 3 if self._has_encoders else 2)
        self._observations = DirectSubscriptions(
            self, lambda: self._groups.lacks_others or self._meeting.needs_recorder, local
        )
        self._base = self._make_base()
        self._subscribe()
        # A camera waits for nobody.
        is_lockstep = self._settings.use_lane_state
        self._meeting = Meeting(
            self,
            self._observations,
            self._settings,
            steps=(*self._shown.publishers, self._wheels),
            heard=1,
            others=self._other_publishers(),
            window_steps=self._settings.recorder_window_steps if is_lockstep else 0,
            on_open=self._on_open,
        )
        self._begin_to_look()
        fail = self._fail if self._settings.wait_for else None
        topics = SOLE_TOPICS if is_lockstep else (topic_names.EVENTS, topic_names.WHEELS)
        SolePublishers(self, topics, fail).look_regularly()
        self._start()

    def halt(self, number: int) -> None:
        """Answer nothing more, and say where that cuts an episode short; see `run_node`."""
        self._stop_base()
        with self._lock:
            self._is_halted = True
        self._check_cut_short(number)
        self._meeting.end(is_cut_short=self.exit_status != 0)

    def destroy_node(self) -> None:
        """Stop answering."""
        self._stop_base()
        self._observations.stop()
        super().destroy_node()

    def _check_cut_short(self, number: int) -> None:
        """Find out whether a signal ends the node before its work is done."""
        lane = self._lane
        if lane is not None and lane.step and not lane.terminated:
            self._cut_short(number, f'in episode {lane.episode}, after {lane.step} steps')

    def _cut_short(self, number: int, where: str) -> None:
        """Say where a signal ends the node before its work is done."""
        self.get_logger().warning(f'ended by {signal.Signals(number).name} {where}')
        self.exit_status = self.exit_status or 128 + number

    def _fail(self, reason: str) -> None:
        """End with status 1: the drive is nobody's."""
        self._stop_base()
        with self._lock:
            self._is_halted = True
        self.get_logger().fatal(reason)
        self.exit_status = 1
        self._meeting.end(is_cut_short=True)
        self.is_done = True

    def _make_base(self) -> BaseDrive | None:
        """Return what drives the robot's base; None where nothing but the wheels is asked for."""
        command = self._settings.command
        if command == 'wheels':
            return None
        return BaseDrive(
            self,
            self._settings.base,
            topic_names.WHEELS,
            is_stamped=command == 'twist_stamped',
            others=self._watched(),
            max_events_per_s=self._settings.max_events_per_s,
            on_geometry=self.get_logger().info,
        )

    def _watched(self) -> tuple[str, ...]:
        """Return the topics without which the base is stopped."""
        lanes = (topic_names.LANE_STATE,) if self._settings.use_lane_state else ()
        return (topic_names.EVENTS, *lanes)

    def _stop_base(self) -> None:
        """Tell the base to stand, at once: a step may be at work, and may hang."""
        if self._base is not None:
            self._base.halt()

    def _make_driver(self, name: str) -> Controller:
        """Declare the controller's parameters and make it."""
        cls = controller_class(name)
        self._driver_parameters = parameters = declare_parameters(
            self, cls.parameters_class, may_change=self._may_change
        )
        self._image_size = image_size(parameters)
        self._period_ms = period_ms_of(parameters)
        warm_up(cls(parameters), self._image_size, self._settings.filter)
        return cls(parameters)

    @property
    def _may_change(self) -> bool:
        """Whether parameters of the controller may change while it drives."""
        return True

    def _changeable(self) -> Parameters | None:
        """Return the controller's parameters where some of them may be changed."""
        specs = changeable_specs(type(self._driver_parameters))
        return self._driver_parameters if self._may_change and any(specs) else None

    def _let_change(self) -> ChangePublisher | None:
        changing = self._host.changing
        if changing is None:
            return None
        self.let_change(changing)
        return ChangePublisher(self, topic_names.CONTROLLER_CHANGES, changing)

    def _make_sensor(self) -> Sensor:
        """Return what makes steps of packets, in the size that the controller is made for."""
        width, height = self._image_size
        return Sensor(
            self._settings.sensor,
            self._settings.filter,
            width=width,
            height=height,
            period_ns=1_000_000 * (self._period_ms or PERIOD_MS),
            has_lane=self._settings.use_lane_state,
            on_fault=self._report_fault,
            on_loss=self._report_lost,
        )

    def _subscribe(self) -> None:
        """Subscribe to observations; they are handled from the start on."""
        if self._settings.use_lane_state:
            self._observations.subscribe(
                LaneState,
                topic_names.LANE_STATE,
                self._on_lane_state,
                RELIABLE_10,
                is_companion=True,
            )
        if self._has_encoders:
            self._observations.subscribe(
                JointState,
                topic_names.JOINT_STATES,
                self._on_joint_state,
                RELIABLE_10,
                is_companion=True,
            )
        callbacks = None
        if self._settings.reliability == 'auto':
            callbacks = SubscriptionEventCallbacks(
                incompatible_qos=lambda _: self._look_at_publishers()
            )
        self._observations.subscribe(
            EventPacket,
            topic_names.EVENTS,
            self._on_packet,
            self._events_qos(),
            event_callbacks=callbacks,
        )

    def _events_qos(self) -> QoSProfile:
        # A simulator waits for us; a camera does not, and sends many packets a step.
        depth = 10 if self._settings.use_lane_state else 1000
        return QoSProfile(depth=depth, reliability=self._reliability)

    def _begin_to_look(self) -> None:
        """Begin to look for publishers, for progress, and for what is odd in the packets."""
        if self._settings.reliability == 'auto':
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self.create_timer(_LOOK_PERIOD_S, self._look_at_publishers, clock=steady)
        self._diagnostics = ControllerDiagnostics(
            self,
            topic_names.EVENTS,
            self._sensor,
            lambda: Counts(self._received, self._lane_states, self._steps),
            self._lacks,
            self._base,
        )

    def _look_at_publishers(self) -> None:
        """Subscribe as the publishers of events offer it.

        A best-effort publisher does not match a reliable subscription, and a best-effort
        subscription could lose what a reliable publisher sends.
        """
        offered = {
            info.qos_profile.reliability
            for info in self.get_publishers_info_by_topic(
                self.resolve_topic_name(topic_names.EVENTS)
            )
        }
        wanted = ReliabilityPolicy.RELIABLE
        if ReliabilityPolicy.BEST_EFFORT in offered:
            wanted = ReliabilityPolicy.BEST_EFFORT
        if wanted != self._reliability:
            self._reliability = wanted
            self._observations.renew(topic_names.EVENTS, self._events_qos())
            self.get_logger().info(
                f'{topic_names.EVENTS}: subscribed {wanted.name.lower()}, as the publishers offer'
            )

    def _lacks(self) -> str:
        """Return what was received and what is lacking for the next step."""
        if self._is_answered and not self._is_sent and self._meeting.waits_for:
            return f'waiting for {self._meeting.waits_for}'
        publishers = publishers_of(self, topic_names.EVENTS)
        received = f'received {self._received} event packets'
        if self._settings.use_lane_state:
            received += f' and {self._lane_states} lane states'
        received += f', answered {self._steps} steps'
        if publishers == 0:
            lacks = f'{topic_names.EVENTS} has no publisher'
        elif self._received == 0 or self._steps:
            lacks = (
                f'no event packet that completes a step arrives from {publishers} publishers of '
                f'{topic_names.EVENTS}'
            )
        elif self._settings.use_lane_state:
            lanes = topic_names.LANE_STATE
            lacks = (
                f'no {lanes} ({publishers_of(self, lanes)} publishers) has the stamp '
                'of a packet; a camera publishes no lane states: use_lane_state:=false'
            )
        else:
            lacks = 'no step is complete: the time in the packets does not advance'
        return f'waiting for observations: {lacks}; {received}'

    def _wrap_driver(self, name: str, driver: Controller) -> Controller:
        """Return what answers: the controller itself, or something that asks it."""
        del name
        return driver

    def _other_publishers(self) -> tuple[KeptPublisher, ...]:
        """Return the publishers of what is recorded and does not come with each answer."""
        return () if self._changes is None else (self._changes.publisher,)

    def _start(self) -> None:
        """Say that the node is ready, and begin to answer."""
        events, wheels = map(self.resolve_topic_name, (topic_names.EVENTS, topic_names.WHEELS))
        self.get_logger().info(f'ready: answers {events} on {wheels}')
        self._observations.start()

    def _on_lane_state(self, lane: LaneState) -> None:
        self._lane_states += 1
        if self._base is not None:
            self._base.hear(topic_names.LANE_STATE)
        self._groups.add(0, lane)

    def _on_joint_state(self, joints: JointState) -> None:
        self._groups.add(1, joints)

    def _on_group(self, lane: LaneState, *others: Any) -> None:
        *joints, packet = others
        for each in joints:
            self._encoders = messages.encoders_from_message(each)
        self._on_observation(lane, packet)

    def _on_packet(self, packet: EventPacket) -> None:
        self._received += 1
        if self._base is not None:
            self._base.hear(topic_names.EVENTS, waited_s=self._observations.waited_s)
        if self._settings.use_lane_state:
            self._groups.add(2 if self._has_encoders else 1, packet)
        else:
            self._on_observation(None, packet)

    def _on_observation(self, lane: LaneState | None, packet: EventPacket) -> None:
        identity = _Identity(messages.to_stamp_ns(packet.header.stamp), packet.seq)
        if identity == self._seen:
            self._send_answer()
            return
        self._seen = identity
        try:
            state = None if lane is None else messages.lane_state_from_message(lane)
            before = self._sensor.events_in
            steps = self._sensor.add(messages.received_packet(packet), state)
            if self._base is not None:
                self._base.hear(topic_names.EVENTS, self._sensor.events_in - before)
            for step in steps:
                with self._lock:
                    if self._is_halted:
                        return
                    observation = self._observation(step, state)
                    if observation is None:
                        continue
                    self._step(observation)
                    self._lane = lane or observation.lane
                    self._is_answered, self._is_sent = True, False
                    self._steps += 1
                    self._publish_answer()
                    if self._base is not None:
                        self._base.drive(messages.wheels_from_message(self._answer))
        except ParameterError as error:  # not the image's size or part, or not the period wanted
            self.get_logger().fatal(f'sensor: {error}')
            self.exit_status = 2
            self.context.try_shutdown()

    def _observation(
        self, step: SensorStep, state: contract.LaneState | None
    ) -> Observation | None:
        """Return what the controller is to answer; None for nothing."""
        return Observation(step.stamp_ns, step.events, state, self._encoders)

    def _step(self, observation: Observation) -> None:
        self._answer.left, self._answer.right = self._host.step(observation)
        self._answer.header.stamp = conversions.to_time(observation.stamp_ns)

    def _report_fault(self, reason: str) -> None:
        self.get_logger().error(
            f'{topic_names.EVENTS}: {reason}; taken as empty', throttle_duration_sec=1.0
        )

    def _report_lost(self, count: int) -> None:
        self.get_logger().warning(
            f'{topic_names.EVENTS}: {count} packets were lost', throttle_duration_sec=1.0
        )

    def _on_open(self) -> None:
        with self._lock:
            if not self._is_sent:
                self._publish_answer()

    def _on_match(self) -> None:
        self._meeting.look_again()
        with self._lock:
            if self._is_sent:
                self._shown.send(self._answer.header.stamp, self._lane, again=True)
                self._wheels.send_again(lambda: self._answer)
            else:
                self._publish_answer()

    def _send_answer(self) -> None:
        with self._lock:
            self._publish_answer()

    def _publish_answer(self) -> None:
        if self._is_answered and self._meeting.is_open:
            if not self._is_sent:
                if self._changes is not None:
                    self._changes.publish()
                self._shown.send(self._answer.header.stamp, self._lane)
            self._is_sent = True
            self._meeting.window.count_step()
            self._wheels.send(lambda: self._answer)
