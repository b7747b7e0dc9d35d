"""Many simulators at once: what `Simulator` is for one robot."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.bit_planes import words_of
from spikelane_sim.conditions.courses import load_courses
from spikelane_sim.conditions.schedule import Phases, Schedule
from spikelane_sim.contract import LaneState, link_rng, simulator_rng
from spikelane_sim.course import Course
from spikelane_sim.episode_rules import check_beginning, REASONS
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.events import EVENT_DTYPE
from spikelane_sim.filters import FilterParameters
from spikelane_sim.fleet.bodies import Bodies
from spikelane_sim.fleet.conditions import make_conditions, write_condition
from spikelane_sim.fleet.generators import Generators
from spikelane_sim.fleet.kernel import (
    begin,
    FORWARD,
    make_scratch,
    ROBOT_DTYPE,
    Robots,
    TURN,
)
from spikelane_sim.fleet.world import ENGINES, make_world, OTHER, World
from spikelane_sim.pixels import PixelParameters
from spikelane_sim.pixels.esim import EsimPixels, make_pixels
from spikelane_sim.robots import KINEMATIC
from spikelane_sim.robots.wheel_errors import real_velocities
from spikelane_sim.simulator import CommandCounts
from spikelane_sim.simulator_parameters import SimulatorParameters

_LANE_FIELDS = (
    'course',
    'lane',
    'section',
    'reason',
    'distance_m',
    'heading_error_rad',
    'position_m',
    'progress_m',
    'laps',
    'step',
)


class _Episode(NamedTuple):
    """Where a robot is in its sequence of episodes."""

    seed: int
    number: int


class SimulatorFleet:
    """N robots, each in a simulation of its own.

    Robot i does what `Simulator` and filters do with the same parameters, course and seeds, bit
    for bit, whatever the others do. Its steps are taken by kernels that are given `world`,
    `robots` and i (`kernel.simulate`); here robots are reset and asked for what they know.

    Attributes:
        parameters: Parameters of all robots, except their courses.
        world: What the robots share.
        robots: What changes.
        noise: The generators of the pixels' noise.
        losses: The generators of the losses between robot and controller.
    """

    def __init__(
        self,
        n_robots: int,
        parameters: SimulatorParameters | None = None,
        *,
        courses: Sequence[str] | None = None,
        filters: FilterParameters | None = None,
    ) -> None:
        """Make robots that have not begun an episode.

        Args:
            n_robots: How many, at least 1.
            parameters: Parameters of all robots; None for the defaults.
            courses: Each robot's own, as `SimulatorParameters.course`; None for the parameters'.
            filters: Filters of all robots' events; None for no filter.

        Raises:
            SpikelaneError: A fleet cannot simulate this, or the numbers of robots and courses
                differ, or an engine has no room for so many robots.
        """
        if n_robots < 1:
            raise SpikelaneError(f'n_robots: expected at least 1, got {n_robots}')
        self.parameters = parameters or SimulatorParameters()
        names = [self.parameters.course] * n_robots if courses is None else list(courses)
        if len(names) != n_robots:
            raise SpikelaneError(f'courses: expected one for each robot, got {len(names)}')
        self._schedules = _schedules(self.parameters, names)
        self._courses = _load_all(self._schedules)
        found = tuple(self._courses.values())
        self._numbers = {name: number for number, name in enumerate(self._courses)}
        self._lane_names = [name for course in found for name in course.lanes]
        self.world = make_world(self._schedules[0], found, filters or FilterParameters())
        self.noise, self.losses = Generators(n_robots), Generators(n_robots)
        self._bodies = (
            Bodies(n_robots, self.parameters.robot, self.world.n_images, self.world.period_s)
            if self.world.engine == OTHER
            else None
        )
        numbers = self._bodies.numbers if self._bodies else np.zeros(n_robots, np.int64)
        self.robots = _make_robots(self.world, numbers, self.noise, self.losses)
        self.robots.known['course'] = [self._numbers[name] for name in names]
        self._scratch = make_scratch(self.world)
        camera = self.parameters.camera
        # Looks at the first image of each episode, for whichever robot.
        self._pixels = (
            EsimPixels(self.parameters.pixels.esim, camera.width, camera.height)
            if self.world.esim
            else None
        )
        self._episodes: list[_Episode | None] = [None] * n_robots
        for robot in range(n_robots):
            self._write_phases(robot, Phases(self._schedules[robot].parameters, None, 0))

    def __len__(self) -> int:
        """Return how many robots there are."""
        return len(self._episodes)

    def close(self) -> None:
        """Release the physics engines."""
        if self._bodies:
            self._bodies.close()

    def course(self, robot: int) -> Course:
        """Return the course that a robot drives on."""
        return self._course_at(int(self.robots.known['course'][robot]))

    def reset(
        self, robot: int, lane: str | None = None, seed: int | None = None, *, episode: int = 1
    ) -> LaneState:
        """Place a robot at a lane's start and begin an episode; see `Simulator.reset`.

        Raises:
            SpikelaneError: No such lane, a negative seed, no such number of an episode, or a
                first reset without a seed.
        """
        before = self._episodes[robot]
        if seed is not None:
            now = _Episode(seed, episode)
        elif before is not None:
            now = before._replace(number=before.number + 1)
        else:
            raise SpikelaneError('seed: expected one in the first reset, got none')
        check_beginning(seed, now.number)
        schedule, known = self._schedules[robot], self.robots.known
        phases = schedule.phases(*now)
        number = self._numbers[phases.first.course]
        course = self._course_at(number)
        names = tuple(course.lanes)
        if lane is not None:
            course.lane(lane)
            index = names.index(lane)
        else:
            last = int(known['lane'][robot] - self.world.first_lane[known['course'][robot]])
            index = 0 if seed is not None or before is None else (last + 1) % len(names)
        self._episodes[robot] = now
        lane_number = int(self.world.first_lane[number]) + index
        known['course'][robot], known['lane'][robot] = number, lane_number
        if schedule.changing:
            self._write_phases(robot, phases)
        if self.world.most_noise_hz or self.world.esim:
            self.noise[robot] = simulator_rng(*now)
        if self.world.has_losses:
            self.losses[robot] = link_rng(*now)
        start = self.world.starts[lane_number]
        if self._bodies:
            self.robots.poses[robot, -1] = self._bodies.reset(robot, *start)
        begin(self.world, self.robots, self._scratch, robot, *start)
        if self._pixels is not None:
            self._see_first(self._pixels, robot, phases.first.pixels)
        return self.lane_state(robot)

    def _course_at(self, number: int) -> Course:
        return tuple(self._courses.values())[number]

    def _write_phases(self, robot: int, phases: Phases) -> None:
        conditions = self.robots.conditions
        conditions.step[robot] = phases.step
        for phase, parameters in enumerate((phases.first, phases.then)):
            if parameters is not None:
                seen = parameters.markings or parameters.course
                markings = self._numbers[seen], self._courses[seen]
                write_condition(conditions, robot, phase, parameters, markings)

    def has_begun(self, robot: int) -> bool:
        """Return whether a robot has begun an episode."""
        return self._episodes[robot] is not None

    def seed(self, robot: int) -> int:
        """Return the seed last given for a robot."""
        return self._episode(robot).seed

    def episode(self, robot: int) -> int:
        """Return the number of a robot's episode."""
        return self._episode(robot).number

    def lane_state(self, robot: int) -> LaneState:
        """Return what is known of a robot on its lane after its last step.

        Raises:
            SpikelaneError: It has not begun an episode.
        """
        return self._lane_states(np.array([robot]))[0]

    def lane_states(self) -> list[LaneState]:
        """Return what is known of all robots, which must have begun an episode."""
        return self._lane_states(np.arange(len(self)))

    def reasons(self) -> list[str]:
        """Return why the episode of each robot is over; '' where it is not."""
        return [REASONS[reason] for reason in self.robots.known['reason'].tolist()]

    def wheel_velocities(self) -> NDArray[np.float64]:
        """Return what the encoders of the wheels measure [rad/s], (n_robots, 2)."""
        forward, turn = self.robots.motion[:, FORWARD], self.robots.motion[:, TURN]
        if self._bodies:
            left, right = self._bodies.wheel_velocities().T
        elif ENGINES[self.world.engine] == KINEMATIC:
            left, right = forward, turn
        else:
            body = self.world.body
            half = turn * body.track_m / 2
            left, right = (forward - half) / body.radius_m, (forward + half) / body.radius_m
        if not self.world.has_wheel_errors:
            return np.stack([left, right], axis=1)
        rows = self._conditions_now()
        errors = rows['left'], rows['right'], rows['track']
        return np.stack(real_velocities(np.stack([left, right]), errors), axis=1)

    def _conditions_now(self) -> NDArray[np.void]:
        """Return the condition of each robot in its last step, (n_robots,)."""
        conditions, steps = self.robots.conditions, self.robots.known['step']
        phases = (conditions.step > 0) & (steps >= conditions.step)
        found: NDArray[np.void] = conditions.numbers[np.arange(len(self)), phases.astype(int)]
        return found

    def _lane_states(self, robots: NDArray[np.int64]) -> list[LaneState]:
        known = self.robots.known[robots]
        columns = [known[field].tolist() for field in _LANE_FIELDS]
        states = []
        for robot, *values in zip(robots.tolist(), *columns, strict=True):
            course, lane, section, reason, *numbers = values
            name = self._lane_names[lane]
            distance_m, heading_error_rad, position_m, progress_m, laps, step = numbers
            states.append(
                LaneState(
                    lane=name,
                    distance_m=distance_m,
                    heading_error_rad=heading_error_rad,
                    position_m=position_m,
                    section=self._course_at(course).section_name(name, section),
                    progress_m=progress_m,
                    laps=laps,
                    episode=self.episode(robot),
                    step=step,
                    terminated=reason > 0,
                    reason=REASONS[reason],
                )
            )
        return states

    def command_counts(self, robot: int) -> CommandCounts:
        """Return how many of a robot's commands were not taken as they came."""
        known = self.robots.known[robot]
        return CommandCounts(int(known['not_finite']), int(known['clipped']))

    @property
    def has_ended(self) -> NDArray[np.bool_]:
        """Whether each robot's episode is over, (n_robots,)."""
        ended: NDArray[np.bool_] = self.robots.known['reason'] > 0
        return ended

    def _see_first(self, pixels: EsimPixels, robot: int, parameters: PixelParameters) -> None:
        """Let the pixels of a robot see its first image."""
        pixels.adopt(parameters)
        pixels.reset(self.noise[robot])
        pixels.step(self._scratch.image[None], 0, self.world.period_ns)
        rows: tuple[NDArray[Any], ...] = self.robots.esim or ()
        for row, values in zip(rows, pixels.pixels, strict=True):
            row[robot] = values

    def _episode(self, robot: int) -> _Episode:
        found = self._episodes[robot]
        if found is None:
            raise SpikelaneError('no episode has begun: reset the robot first')
        return found


def _make_robots(
    world: World, bodies: NDArray[np.int64], noise: Generators, losses: Generators
) -> Robots:
    n_robots = len(bodies)
    planes = (2, world.height, words_of(world.width)) if world.has_planes else (0, 0, 0)
    size = world.height * world.width
    pixels = 0 if world.has_planes or world.esim else size
    return Robots(
        known=np.zeros(n_robots, ROBOT_DTYPE),
        motion=np.zeros((n_robots, 7)),
        bodies=bodies,
        poses=np.zeros((n_robots, world.n_images, 7)),
        planes=np.zeros((n_robots, *planes), np.uint64),
        reference=np.zeros((n_robots, pixels)),
        change=np.zeros((n_robots, pixels)),
        esim=make_pixels((n_robots, size)) if world.esim else None,
        waiting=np.zeros((n_robots, _most_waiting(world)), EVENT_DTYPE),
        memory=np.zeros((n_robots, len(world.filters.memory)), np.int64),
        commands=np.zeros((n_robots, world.most_latency_steps + 1, 2)),
        conditions=make_conditions(n_robots, size if world.has_dead else 0),
        noise=noise.addresses,
        losses=losses.addresses,
    )


def _most_waiting(world: World) -> int:
    """Return room for the events that wait for the latency of the pixels.

    That is for two of each pixel and step, and noise of 20 standard deviations above its mean.
    """
    esim = world.esim
    if not (esim and esim.latency_us):
        return 0
    size = world.height * world.width
    rate_hz = world.most_esim_noise_hz * size + esim.hot_rate_hz * len(esim.hot)
    steps = -(-esim.latency_us * 1000 // world.period_ns)
    noise = rate_hz * world.period_s * steps
    return int(2 * size * steps + noise + 20 * math.sqrt(noise + 1))


def _schedules(parameters: SimulatorParameters, courses: Sequence[str]) -> list[Schedule]:
    """Return a schedule for each robot, those on the same course the same one."""
    made = {
        name: Schedule(dataclasses.replace(parameters, course=name))
        for name in dict.fromkeys(courses)
    }
    return [made[name] for name in courses]


def _load_all(schedules: Sequence[Schedule]) -> dict[str, Course]:
    """Return the courses of all schedules by name."""
    found: dict[str, Course] = {}
    for schedule in dict.fromkeys(schedules):
        found |= load_courses(schedule)
    return found
