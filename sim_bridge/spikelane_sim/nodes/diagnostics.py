"""Diagnostics of the simulator, once a second and when an episode ends."""

from __future__ import annotations

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from spikelane_sim.contract import LaneState, TERMINATED_LANE_LOST
from spikelane_sim.nodes.commands import Commands
from spikelane_sim.nodes.recorder_window import RecorderWindow
from spikelane_sim.nodes.status_publisher import StatusPublisher
from spikelane_sim.nodes.topics import SimulatorTopics
from spikelane_sim.run_state import RunState
from spikelane_sim.simulator import CommandCounts, Simulator
from spikelane_sim.stepper import Stepper


class SimulatorDiagnostics:
    """Publishes how the simulation fares, and reports commands that were not taken as given."""

    def __init__(
        self,
        node: Node,
        simulator: Simulator,
        stepper: Stepper,
        topics: SimulatorTopics,
        commands: Commands,
        window: RecorderWindow,
    ) -> None:
        """Create the publisher."""
        self._node = node
        self._simulator = simulator
        self._stepper = stepper
        self._topics = topics
        self._commands = commands
        self._mixed: list[str] = []  # publishers whose commands have mixed in the last second
        self._window = window
        robot = simulator.parameters.robot
        self._status = StatusPublisher(node, 'simulator', f'{robot.model}, {robot.engine}')
        self._clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._last = (self._clock.now().nanoseconds, 0)
        self._progress = (0, 0)  # steps and observations at the last message
        self._counts = CommandCounts()
        self._was_terminated = False
        self._was_answered = False

    def notice(self) -> None:
        """Report what is new: a command not taken as given, an episode's end, its last answer."""
        counts = self._simulator.command_counts
        if counts != self._counts:
            self._report(counts)
        lane = self._simulator.lane_state
        is_terminated = lane is not None and lane.terminated
        if lane is not None and is_terminated and not self._was_terminated:
            self._node.get_logger().info(
                f'episode {lane.episode} on the {lane.lane} lane ended after {lane.step} steps: '
                f'{lane.reason}{self._next_episode(lane)}'
            )
            self.publish()
        elif is_terminated and self._stepper.is_answered and not self._was_answered:
            self.publish()
        self._was_terminated = is_terminated
        self._was_answered = is_terminated and self._stepper.is_answered

    def look_and_publish(self) -> None:
        """Find the nodes that commanded the robot in the last second, and publish."""
        self._mixed = self._commands.report()
        self.publish()

    def publish(self) -> None:
        """Publish the state of the simulation."""
        is_worrying = self._is_worrying()
        state = self._stepper.state.name.lower()
        lane = self._simulator.lane_state
        if self._stepper.state is RunState.PLAYING and lane is not None and lane.terminated:
            state = 'the episode is over'
        self._status.publish(state, self._values(), is_worrying=is_worrying)

    def _next_episode(self, lane: LaneState) -> str:
        """Return how the robot goes on, where whoever drives is not waited for."""
        if self._stepper.is_lockstep:
            return ''
        name = self._node.get_fully_qualified_name()
        text = f'; the robot stands until {name}/reset is called'
        if lane.reason == TERMINATED_LANE_LOST:
            text += ' (episode.max_distance_m:=0 lets it leave the lane)'
        return text

    def _is_worrying(self) -> bool:
        is_quitting = self._stepper.state is RunState.QUITTING
        return self._is_stuck() or is_quitting or bool(self._mixed)

    def _is_stuck(self) -> bool:
        """Return whether an answer is waited for that was already at the last message."""
        before, self._progress = self._progress, (self._stepper.steps, self._topics.packets)
        is_waiting = self._stepper.is_waiting or self._window.is_full
        return is_waiting and self._progress == before

    def _values(self) -> dict[str, object]:
        counts = self._simulator.command_counts
        values: dict[str, object] = {
            'steps': self._stepper.steps,
            'steps_per_s': round(self._rate(), 1),
            'simulation_time_s': self._simulator.time_ns / 1e9,
            'event_packets': self._topics.packets,
            'commands_not_finite': counts.not_finite,
            'commands_clipped': counts.clipped,
            'commands_ignored': self._stepper.ignored_commands,
            'commands_refused': self._commands.refused,
            'commands_mixed_from': ', '.join(self._mixed),
            'answered': self._stepper.is_answered,
            'waits_for_recorder': self._window.is_full,
        }
        lane = self._simulator.lane_state
        return values | (_lane_values(lane) if lane is not None else {})

    def _rate(self) -> float:
        then_ns, steps_then = self._last
        self._last = (self._clock.now().nanoseconds, self._stepper.steps)
        rate: float = (self._last[1] - steps_then) / max(self._last[0] - then_ns, 1) * 1e9
        return rate

    def _report(self, counts: CommandCounts) -> None:
        logger = self._node.get_logger()
        if counts.not_finite > self._counts.not_finite:
            logger.error(
                'wheel velocities: expected finite rad/s; the wheels stop for this step',
                throttle_duration_sec=1.0,
            )
        if counts.clipped > self._counts.clipped:
            limit = self._simulator.parameters.robot.max_wheel_velocity_rad_s
            logger.warning(
                f'wheel velocities: expected at most {limit} rad/s; clipped',
                throttle_duration_sec=1.0,
            )
        self._counts = counts


def _lane_values(lane: LaneState) -> dict[str, object]:
    return {
        'episode': lane.episode,
        'step': lane.step,
        'lane': lane.lane,
        'progress_m': lane.progress_m,
        'laps': lane.laps,
        'terminated': lane.terminated,
        'reason': lane.reason,
    }
