"""The simulator: course, robot and event camera in steps of a period, all chance from one seed."""

from __future__ import annotations

from collections.abc import Collection, Mapping
import math
from types import TracebackType
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.camera import CameraModel
from spikelane_sim.conditions.courses import load_courses
from spikelane_sim.conditions.devices import Devices
from spikelane_sim.conditions.schedule import Phases, Schedule
from spikelane_sim.contract import (
    LaneState,
    Observation,
    Robot,
    RobotState,
    WheelEncoders,
    WheelVelocities,
)
from spikelane_sim.course import LanePoint
from spikelane_sim.episode_rules import (
    admit,
    check_beginning,
    CLIPPED,
    follow,
    heading_of,
    NOT_FINITE,
    Progress,
    REASONS,
    start_at,
)
from spikelane_sim.errors import PoseError, SpikelaneError
from spikelane_sim.parameter_changes import ChangingParameters
from spikelane_sim.simulator_parameters import SimulatorParameters

#: How far beyond the rectangle around the road a robot can be placed.
AREA_MARGIN_M = 10.0


class CommandCounts(NamedTuple):
    """Wheel commands that were not taken as they came, since the simulator was made."""

    not_finite: int = 0  # the wheels were stopped for that step
    clipped: int = 0  # to the robot's limit


class Simulator:
    """One robot with an event camera on a course.

    `reset` begins an episode and gives the first observation, `step` each further one. The same
    seed gives the same observations, bit for bit, whatever was simulated before.

    Attributes:
        parameters: Those in use.
        changing: Takes changes of those that may be changed, and tells which have taken effect.
        command_counts: Wheel commands that were not taken as they came.
    """

    def __init__(
        self,
        parameters: SimulatorParameters | None = None,
        *,
        robot: Robot | None = None,
        camera: CameraModel | None = None,
        sensors: Collection[str] = ('events',),
    ) -> None:
        """Build the course, and the robot and the camera where they are not given.

        Args:
            parameters: All parameters; None for the defaults. Those that a given robot or camera
                replaces have no effect, except for the robot's limit of wheel velocities and the
                size of the image, which must be the camera's.
            robot: The robot; the simulator closes it. Its steps last as long as
                `parameters.period_ms` and have as many poses as `parameters.pixels` has images
                in a step.
            camera: The camera.
            sensors: What observations have, of `contract.SENSORS`; events are always there.

        Raises:
            SpikelaneError: The course or a combination of parameters cannot be simulated.
        """
        self.parameters = parameters or SimulatorParameters()
        self.changing = ChangingParameters(self.parameters)
        self._schedule = Schedule(self.parameters)
        self._courses = load_courses(self._schedule)
        self._phases = Phases(self.parameters, None, 0)
        self.course = self._courses[self.parameters.course]
        self._has_encoders = 'encoders' in sensors
        self.command_counts = CommandCounts()
        seen = self._courses[self.parameters.markings or self.parameters.course]
        self._devices = Devices(self._schedule, seen, robot, camera)
        self._time_ns = 0
        self._seed = 0
        self._episode = 0
        self._lane_state: LaneState | None = None
        self._progress = start_at(0.0)

    def __enter__(self) -> Simulator:
        """Return the simulator; leaving the block closes it."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> Literal[False]:
        """Close the simulator."""
        self.close()
        return False

    def close(self) -> None:
        """Release the physics engine."""
        self._devices.robot.close()

    @property
    def camera(self) -> CameraModel:
        """The camera, for its intrinsics and its place on the robot."""
        return self._devices.camera

    @property
    def robot_state(self) -> RobotState:
        """Pose and motion of the robot now."""
        return self._devices.robot.state

    @property
    def lane_state(self) -> LaneState | None:
        """The lane state of the last observation, None before the first reset."""
        return self._lane_state

    @property
    def time_ns(self) -> int:
        """Simulation time [ns], 0 before the first observation."""
        return self._time_ns

    @property
    def seed(self) -> int:
        """The seed last given to `reset`."""
        return self._seed

    def change(self, values: Mapping[str, Any]) -> None:
        """Change parameters that may be changed, as `{'link.event_loss': 0.1}`.

        Each takes effect as its declaration says (`ParameterSpec.changes`): with the next step or
        the next episode. An episode that begins is the same, bit for bit, as with a simulator that
        was made with these values.

        Raises:
            ParameterError: As in `ChangingParameters.change`; nothing has changed then.
        """
        self.changing.change(values)

    def clear(self, lane: str | None = None) -> None:
        """Forget the episode: no time has passed, and the robot stands where one may begin.

        Args:
            lane: Name of the lane at whose start it is; None for the course's first.

        Raises:
            SpikelaneError: No such lane.
        """
        start = self.course.lane(self._next_lane(True) if lane is None else lane).start
        self._devices.robot.reset(start.x_m, start.y_m, start.heading_rad)
        self._time_ns = 0
        self._lane_state = None

    def reset_time(self) -> Observation:
        """Let simulation time begin again, and observe the present state at its first step.

        The event camera forgets what it saw, as in a reset: the observation has no events.

        Raises:
            SpikelaneError: No episode has begun.
        """
        if self._lane_state is None:
            raise SpikelaneError('no episode has begun: reset the simulator first')
        self._time_ns = 0
        self._devices.forget_image(self._seed, self._episode)
        return self._observe(self._pose_now()[None])

    def reset(
        self,
        lane: str | None = None,
        seed: int | None = None,
        *,
        episode: int = 1,
        from_time_zero: bool = False,
    ) -> Observation:
        """Place the robot at a lane's start and begin an episode.

        Args:
            lane: Name of the lane; None for the next one in turn, the course's first where a
                sequence begins.
            seed: Not negative. Begins a new sequence of episodes, the same for the same seed;
                None goes on with the present sequence.
            episode: Number at which the sequence begins, 1 or more; of use only with a seed, to
                go on where another run stopped.
            from_time_zero: Simulation time begins again as well; otherwise it goes on.

        Raises:
            SpikelaneError: No such lane, a negative seed, or no such number of an episode.
        """
        check_beginning(seed, self._episode + 1 if seed is None else episode)
        number = self._episode + 1 if seed is None else episode
        phases = self._schedule.phases(self._seed if seed is None else seed, number)
        course = self._courses[phases.first.course]
        lane = self._next_lane(seed is not None) if lane is None else lane
        start = course.lane(lane).start
        if seed is not None:
            self._seed = seed
        if from_time_zero:
            self._time_ns = 0
        self._episode, self._phases, self.course = number, phases, course
        has_changed = self._take_changes(begins_episode=True)
        if has_changed or self._schedule.changing:
            self._change(self._phases.first)
        self._devices.robot.reset(start.x_m, start.y_m, start.heading_rad)
        self._devices.reset(self._seed, self._episode)
        self._begin(lane)
        return self._observe(self._pose_now()[None])

    def step(self, wheels: WheelVelocities) -> Observation:
        """Drive for one step with these target wheel velocities, or older ones (`link.py`).

        They are multiplied by `parameters.speed`. Velocities that are not finite stop the wheels
        for this step, others are clipped to the robot's limit; `command_counts` counts both.

        Raises:
            SpikelaneError: The episode is over, or none has begun.
        """
        last = self._running_lane_state()
        step = self._progress.step + 1
        has_changed = self._take_changes(begins_episode=False)
        first, then, begin = self._phases
        if then is not None and (step == begin or (has_changed and step > begin)):
            self._change(then)
        elif has_changed:
            self._change(first)
        poses = self._devices.drive(self._admit(wheels))
        x_m, y_m, heading_rad = _planar(poses[-1])
        point = self.course.locate(last.lane, x_m, y_m, heading_rad)
        self._progress = follow(
            self.course.lanes[last.lane].length_m,
            self.parameters.episode,
            self._progress,
            point.position_m,
            point.distance_m,
        )
        self._lane_state = self._lane_state_at(last.lane, point)
        return self._observe(poses)

    def place(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Move the robot elsewhere, at rest, within the episode; its progress is kept.

        Args:
            x_m: Position, at most AREA_MARGIN_M from the rectangle around the road.
            y_m: Position.
            heading_rad: Heading, finite.

        Raises:
            PoseError: The pose is not finite, or too far from the road.
            SpikelaneError: The episode is over, or none has begun.
        """
        last = self._running_lane_state()
        area = self.course.area(AREA_MARGIN_M)
        if not (math.isfinite(heading_rad) and area.contains(x_m, y_m)):
            raise PoseError(
                f'pose: expected x from {area.x_min_m:.2f} to {area.x_max_m:.2f} m, y from '
                f'{area.y_min_m:.2f} to {area.y_max_m:.2f} m and a finite heading, '
                f'got x {x_m:g} m, y {y_m:g} m, heading {heading_rad:g} rad'
            )
        self._devices.robot.reset(x_m, y_m, heading_rad)
        point = self.course.locate(last.lane, x_m, y_m, heading_rad)
        self._progress = self._progress._replace(position_m=point.position_m)
        self._lane_state = last._replace(position_m=point.position_m)

    def _take_changes(self, *, begins_episode: bool) -> bool:
        """Let changes take effect that were asked for; return whether any did."""
        next_ns = self._time_ns + self.parameters.period_ns
        if not self.changing.take_effect(next_ns, begins_episode=begins_episode):
            return False
        self.parameters = self.changing.parameters
        self._schedule = Schedule(self.parameters)
        self._phases = self._schedule.phases(self._seed, self._episode)
        return True

    def _observe(self, poses: NDArray[np.float64]) -> Observation:
        start_ns = self._time_ns
        self._time_ns += self.parameters.period_ns
        events = self._devices.see(poses, start_ns, self._time_ns)
        encoders = None
        if self._has_encoders:
            state = self._devices.robot.state
            encoders = WheelEncoders(state.wheel_angles, state.wheel_velocities)
        return Observation(self._time_ns, events, self._lane_state, encoders)

    def _change(self, parameters: SimulatorParameters) -> None:
        self._devices.change(parameters, self._courses[parameters.markings or parameters.course])

    def _admit(self, wheels: WheelVelocities) -> WheelVelocities:
        speed, limit = self.parameters.speed, self.parameters.robot.max_wheel_velocity_rad_s
        left, right, became = admit(wheels.left * speed, wheels.right * speed, limit)
        counts = self.command_counts
        if became == NOT_FINITE:
            self.command_counts = counts._replace(not_finite=counts.not_finite + 1)
        elif became == CLIPPED:
            self.command_counts = counts._replace(clipped=counts.clipped + 1)
        return WheelVelocities(left, right)

    def _running_lane_state(self) -> LaneState:
        if self._lane_state is None or self._lane_state.terminated:
            raise SpikelaneError('no episode is running: reset the simulator first')
        return self._lane_state

    def _begin(self, lane: str) -> None:
        """Begin an episode on a lane, where the robot stands."""
        point = self.course.locate(lane, *_planar(self._pose_now()))
        self._progress = start_at(point.position_m)
        self._lane_state = self._lane_state_at(lane, point)

    def _lane_state_at(self, lane: str, point: LanePoint) -> LaneState:
        progress: Progress = self._progress
        return LaneState(
            lane=lane,
            distance_m=point.distance_m,
            heading_error_rad=point.heading_error_rad,
            position_m=point.position_m,
            section=self.course.section_name(lane, point.section),
            progress_m=progress.progress_m,
            laps=progress.laps,
            episode=self._episode,
            step=progress.step,
            terminated=bool(progress.reason),
            reason=REASONS[progress.reason],
        )

    def _pose_now(self) -> NDArray[np.float64]:
        state = self._devices.robot.state
        return np.array(state.position + state.orientation)

    def _next_lane(self, is_first: bool) -> str:
        names = tuple(self.course.lanes)
        if is_first or self._lane_state is None:
            return names[0]
        return names[(names.index(self._lane_state.lane) + 1) % len(names)]


def _planar(pose: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return x [m], y [m] and heading [rad] of a pose (7,)."""
    x, y, _, *orientation = pose.tolist()
    return x, y, heading_of(*orientation)
