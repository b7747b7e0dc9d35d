"""Node `simulator`: the simulator on its topics, in lockstep or in real time."""

from __future__ import annotations

from dataclasses import dataclass
import signal
import sys

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter

from spikelane_sim import topic_names
from spikelane_sim.contract import Observation
from spikelane_sim.nodes.commands import Commands
from spikelane_sim.nodes.diagnostics import SimulatorDiagnostics
from spikelane_sim.nodes.direct import DirectSubscriptions
from spikelane_sim.nodes.local_topics import LocalTopics
from spikelane_sim.nodes.meeting import Meeting, MeetingParameters
from spikelane_sim.nodes.parameter_node import ChangePublisher, ParameterNode
from spikelane_sim.nodes.ros_parameters import declare_parameters
from spikelane_sim.nodes.running import run_node
from spikelane_sim.nodes.services import SimulatorServices
from spikelane_sim.nodes.sole_publishers import SOLE_TOPICS, SolePublishers
from spikelane_sim.nodes.topics import SimulatorTopics
from spikelane_sim.nodes.waiting import publishers_of
from spikelane_sim.parameter_changes import ChangingParameters
from spikelane_sim.parameters import NEXT_STEP, parameter
from spikelane_sim.run_state import Publish
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters
from spikelane_sim.stepper import Stepper

WAITING_WARNING_PERIOD_S = 5.0
ENDING_CHECK_PERIOD_S = 0.2


@dataclass(frozen=True, kw_only=True)
class SimulatorNodeParameters(MeetingParameters):
    """How the simulator takes part in a ROS graph."""

    mode: str = parameter(
        'lockstep',
        'When the simulator steps: after the answer to each observation (lockstep), or by the '
        'wall clock (realtime).',
        choices=('lockstep', 'realtime'),
    )
    real_time_factor: float = parameter(
        1.0,
        'Simulation time per wall time in realtime mode.',
        low=0.01,
        high=1000.0,
        changes=NEXT_STEP,
    )
    command_timeout_s: float = parameter(
        0.5,
        'In realtime mode the wheels stop when no command has come for this simulation time.',
        unit='s',
        low=0.005,
        high=3600.0,
    )
    use_stamped_vel: bool = parameter(
        False, 'Subscribe to cmd_vel as TwistStamped instead of Twist (realtime mode).'
    )
    autostart: bool = parameter(
        True, 'Begin an episode at once instead of waiting for a service call.'
    )
    end_after_episodes: int = parameter(
        0,
        'Number of episodes after which the node ends, in lockstep when the last observation '
        'has been answered; 0: it never ends by itself.',
        low=0,
        high=2**31 - 1,
    )
    lane: str = parameter('', 'Lane of the first episode; empty: the first lane of the course.')
    seed: int = parameter(0, 'Seed of all randomness.', low=0, high=2**63 - 1)
    event_encoding: str = parameter(
        'evt3', 'Encoding of the event packets.', choices=('evt3', 'mono')
    )


class SimulatorNode(ParameterNode):
    """Publishes observations and takes wheel velocities; all else is in what it is made of."""

    def __init__(self, local: LocalTopics | None = None) -> None:
        """Declare the parameters, build the simulator, and begin an episode if so asked.

        Args:
            local: Carries messages to and from a controller of this process; None: there is none.

        Raises:
            SpikelaneError: A parameter is not allowed, or the course cannot be driven.
        """
        super().__init__('simulator')
        self.exit_status = 0
        self.is_done = False
        self._settings = settings = declare_parameters(
            self, SimulatorNodeParameters, may_change=True
        )
        self._simulator = Simulator(declare_parameters(self, SimulatorParameters, may_change=True))
        own = self._own = ChangingParameters(settings)
        self.let_change(own, self._simulator.changing)
        self._changes = ChangePublisher(
            self, topic_names.SIMULATOR_CHANGES, own, self._simulator.changing
        )
        is_realtime = settings.mode == 'realtime'
        self._topics = SimulatorTopics(
            self,
            self._simulator,
            settings.event_encoding,
            settings.history_depth,
            self._on_match,
            local,
        )
        self._stepper = Stepper(
            self._simulator,
            Publish(
                self._publish,
                lambda: self._meeting.is_open,
                lambda: publishers_of(self, topic_names.WHEELS) > 0,
            ),
            seed=settings.seed,
            lane=settings.lane or None,
            hold_ns=round(settings.command_timeout_s * 1e9) if is_realtime else None,
        )
        self._direct = DirectSubscriptions(self, lambda: self._meeting.needs_recorder, local)
        robot = self._simulator.parameters.robot
        self._commands = Commands(self, self._direct, robot, self._stepper, self._notice)
        self._meeting = Meeting(
            self,
            self._direct,
            settings,
            steps=self._topics.steps,
            heard=2,  # lane state and events
            others=(*self._topics.latched, self._changes.publisher),
            window_steps=0 if is_realtime else settings.recorder_window_steps,
            on_open=self._on_open,
        )
        # Steady time: this node makes /clock and must not wait for it.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        if is_realtime:
            self._commands.take_usual(is_stamped=settings.use_stamped_vel)
            period_s = self._simulator.parameters.period_s / settings.real_time_factor
            self._ticks = self.create_timer(period_s, self._stepper.tick, clock=steady)
        self._begin_to_tell(steady)
        self._simulation_services = SimulatorServices(
            self, self._simulator, self._stepper, self._end
        )
        fail = self._fail if settings.wait_for else None
        SolePublishers(self, SOLE_TOPICS, fail).look_regularly()
        if settings.end_after_episodes:
            self.create_timer(ENDING_CHECK_PERIOD_S, self._end_if_over, clock=steady)
        self.get_logger().info(
            f'{settings.mode}, course {self._simulator.course.name}, seed {settings.seed}'
        )
        if settings.autostart:
            self._stepper.begin()
        self._commands.start()

    def _begin_to_tell(self, steady: Clock) -> None:
        """Begin to publish diagnostics, and to warn where nothing goes on."""
        self._diagnostics = SimulatorDiagnostics(
            self,
            self._simulator,
            self._stepper,
            self._topics,
            self._commands,
            self._meeting.window,
        )
        self.create_timer(1.0, self._diagnostics.look_and_publish, clock=steady)
        self.create_timer(WAITING_WARNING_PERIOD_S, self._warn_if_waiting, clock=steady)
        self._steps_at_warning = 0

    def halt(self, number: int) -> None:
        """Take no further step, and say where that cuts a drive short; see `run_node`.

        In real time, and where no controller is there, the node serves until it is told to end;
        only who waits for an episode to begin waits in vain.
        """
        is_awaited = self._stepper.is_awaited
        is_cut_short = self._stepper.quit()
        is_driven = self._settings.mode == 'lockstep' and publishers_of(self, topic_names.WHEELS)
        if is_awaited or (is_cut_short and is_driven):
            lane = self._simulator.lane_state
            when = 'before an episode'
            if lane is not None:
                when = f'in episode {lane.episode}, after {lane.step} steps'
            self.get_logger().warning(f'ended by {signal.Signals(number).name} {when}')
            self.exit_status = self.exit_status or 128 + number
        self._meeting.end(is_cut_short=self.exit_status != 0)
        self._diagnostics.publish()

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """As in ParameterNode; another pace is taken up at once."""
        result = super().set_parameters_atomically(parameter_list)
        period_ns = self._simulator.parameters.period_ns
        if self._own.take_effect(self._simulator.time_ns + period_ns, begins_episode=False):
            self._settings = self._own.parameters
            if self._settings.mode == 'realtime':
                self._ticks.timer_period_ns = round(period_ns / self._settings.real_time_factor)
                self._ticks.reset()  # the step that was due might be seconds away
        return result

    def destroy_node(self) -> None:
        """Stop stepping and release everything."""
        self._commands.stop()
        self._simulator.close()
        super().destroy_node()

    def _on_open(self) -> None:
        self._stepper.audience_changed(has_grown=False)

    def _publish(self, observation: Observation, is_new: bool) -> None:
        self._changes.publish()
        self._topics.publish(observation, is_new)
        self._meeting.window.count_step()
        self._diagnostics.notice()

    def _on_match(self) -> None:
        self._meeting.look_again()
        self._stepper.audience_changed(has_grown=self._topics.is_missed)

    def _notice(self) -> None:
        self._diagnostics.notice()

    def _end(self) -> None:
        self.is_done = True

    def _end_if_over(self) -> None:
        lane = self._simulator.lane_state
        if (
            lane is not None
            and lane.terminated
            and lane.episode >= self._settings.end_after_episodes
            and self._stepper.is_answered
        ):
            self._stepper.quit()
            self._meeting.end(is_cut_short=False)
            self.is_done = True

    def _fail(self, reason: str) -> None:
        """End with status 1: the drive is nobody's."""
        self._stepper.quit()
        self.get_logger().fatal(reason)
        self.exit_status = 1
        self._meeting.end(is_cut_short=True)
        self.is_done = True

    def _warn_if_waiting(self) -> None:
        if self._stepper.steps != self._steps_at_warning:
            self._steps_at_warning = self._stepper.steps
        elif self._stepper.lacks_subscribers and self._meeting.waits_for:
            self.get_logger().warning(f'waiting for {self._meeting.waits_for}')
        elif self._meeting.window.is_full:
            self.get_logger().warning(
                f'waiting for the recorder: it has not written the last '
                f'{self._meeting.window.steps_ahead} steps; '
                f'{publishers_of(self, topic_names.RECORDER_STATE)} publishers of '
                f'{topic_names.RECORDER_STATE} are there'
            )
        elif self._stepper.lacks_subscribers:
            self.get_logger().warning(
                f'waiting for {self._settings.wait_for_subscribers} subscribers of '
                f'{topic_names.EVENTS}; {self._topics.event_subscribers} are there'
            )
        elif self._stepper.is_waiting:
            self.get_logger().warning(
                f'waiting for {topic_names.WHEELS} with stamp {self._simulator.time_ns} ns; '
                f'{publishers_of(self, topic_names.WHEELS)} publishers are there'
            )


def main() -> None:
    """Run the node."""
    sys.exit(run_node(SimulatorNode))


if __name__ == '__main__':
    main()
