"""A fleet: N robots, each with a simulator and a controller of its own, driven by one kernel.

Robot i does what `Simulator` and the controller do with the same parameters and seeds, bit for
bit, whatever N, the number of threads and the other robots are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
import pandas as pd

from spikelane.interruption import check
from spikelane_controllers.fleet import ControllerFleet, Journey, make_journey
from spikelane_controllers.registry import controller_class, fleet_class
from spikelane_sim.contract import controller_rng, LaneState
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.filters import FilterParameters
from spikelane_sim.fleet.kernel import make_scratch
from spikelane_sim.fleet.simulators import SimulatorFleet
from spikelane_sim.fleet.threads import Threads
from spikelane_sim.simulator_parameters import SimulatorParameters

#: Observations that each robot answers in a call of the kernel: about a millisecond's work.
CALL_STEPS = 100


class End(NamedTuple):
    """How an episode of a robot ended."""

    robot: int
    lane_state: LaneState


class Track(NamedTuple):
    """An episode of a robot, observation by observation, the one that ended it included.

    Attributes:
        end: The last lane state.
        places: Where each observation was made, records of `PLACE_DTYPE`, (n,).
        answers: The answer to each [rad/s], (n, 2).
    """

    end: LaneState
    places: NDArray[np.void]
    answers: NDArray[np.float64]


#: Called with robots' numbers of steps and progresses along their lanes [m], (n_robots,) each.
OnAdvance = Callable[[NDArray[np.int64], NDArray[np.float64]], None]


class Fleet:
    """N robots that drive.

    Attributes:
        simulators: The simulators.
        controllers: The controllers.
        steps: Observations that each robot has answered, those that ended an episode left out,
            (n_robots,).
    """

    def __init__(
        self,
        controller: str,
        seeds: Sequence[int],
        *,
        simulator: SimulatorParameters | Mapping[str, Any] | None = None,
        parameters: Mapping[str, Any] | None = None,
        courses: Sequence[str] | None = None,
        filters: FilterParameters | Mapping[str, Any] | None = None,
        threads: int = 1,
    ) -> None:
        """Make a robot for each seed; none has begun an episode.

        Args:
            controller: Name of one whose card has a fleet: 'rstdp', 'braitenberg' or 'dqn'.
            seeds: Seed of each robot's simulator and of its controller.
            simulator: Parameters of all simulators, an object or values under dotted names, as
                {'robot.engine': 'rigid'}. The engines 'kinematic' and 'rigid' are compiled and
                many times as fast as all others.
            parameters: Parameters of all controllers, under dotted names.
            courses: Each robot's own, as the simulators' parameter `course`; None for the same.
            filters: Filters of all robots' events, an object or values under dotted names, as
                {'chain': 'correlation'}; None for no filter.
            threads: How many threads drive them, at least 1.

        Raises:
            SpikelaneError: Anything is unknown or not allowed, or the kernel does not have it; the
                message names it.
        """
        if not isinstance(simulator, SimulatorParameters):
            simulator = SimulatorParameters.from_mapping(simulator or {}, 'simulator')
        self._seeds = [int(seed) for seed in seeds]
        if not isinstance(filters, FilterParameters):
            filters = FilterParameters.from_mapping(filters or {}, 'filter')
        self.simulators = SimulatorFleet(
            len(self._seeds), simulator, courses=courses, filters=filters
        )
        given = controller_class(controller).parameters_class.from_mapping(parameters or {})
        self.controllers: ControllerFleet = fleet_class(controller)(given, self.simulators)
        self._resets = [each.reset for each in self.controllers.controllers]
        self.steps = np.zeros(len(self._seeds), np.int64)
        self._threads = Threads(threads, len(self._seeds), self.simulators.world)

    def __enter__(self) -> Fleet:
        """Return the fleet; leaving the block closes it."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the fleet."""
        self.close()

    def __len__(self) -> int:
        """Return how many robots there are."""
        return len(self._seeds)

    def close(self) -> None:
        """End the threads, and release the physics engines."""
        self._threads.close()
        self.simulators.close()

    def controller(self, robot: int) -> Any:
        """Return a robot's controller as it is now; to change it, see `load`."""
        self.controllers.store(robot)
        return self.controllers.controllers[robot]

    def load(self, robot: int) -> None:
        """Take over what a robot's controller is now, after it was restored or changed."""
        self.controllers.load(robot)

    def initialise(self) -> None:
        """Draw initial weights for each controller that learns, as a training does."""
        for robot, seed in enumerate(self._seeds):
            controller = self.controllers.controllers[robot]
            if hasattr(controller, 'initialise'):
                controller.initialise(controller_rng(seed, 0))
                self.load(robot)

    def host(
        self, robot: int, controller: Any, reset: Callable[[np.random.Generator], None]
    ) -> None:
        """Give a robot another controller.

        Args:
            robot: Which one.
            controller: One of the same class, with the same parameters.
            reset: Is called instead of the controller's `reset`, where an episode begins.
        """
        self.controllers.controllers[robot] = controller
        self._resets[robot] = reset
        self.load(robot)

    def repeat(self, robot: int, answers: NDArray[np.float64]) -> None:
        """Drive a robot with answers (n, 2) that were given before [rad/s]."""
        self.controllers.repeat(robot, answers, make_scratch(self.simulators.world))

    def reset(self, robot: int, lane: str | None = None, *, episode: int | None = None) -> None:
        """Begin a robot's next episode, or its first one.

        Args:
            robot: Which one.
            lane: Name of the lane; None for the next one in turn, the course's first in the
                first episode.
            episode: Number of the episode, to begin the robot's sequence there; None for the next.

        Raises:
            SpikelaneError: No such lane or number of an episode.
        """
        seed = self._seeds[robot]
        is_first = episode is not None or not self.simulators.has_begun(robot)
        state = self.simulators.reset(
            robot, lane, seed if is_first else None, episode=episode or 1
        )
        self.controllers.store(robot)
        self._resets[robot](controller_rng(seed, state.episode))
        self.load(robot)
        self.controllers.look(robot)

    def advance(self, journey: Journey) -> None:
        """Let each robot answer as many observations as a journey wants, and drive on.

        A robot stops where an episode ends, after it has answered that observation as well.

        Args:
            journey: What is wanted, and where what was done goes.

        Raises:
            SpikelaneError: The kernel has failed.
        """
        self._threads.run(
            lambda first, last, scratch: self.controllers.advance(first, last, journey, scratch)
        )
        self.steps += journey.taken

    def drive(self, steps: int, lane: str | None = None) -> list[End]:
        """Drive for so many steps each, episode after episode.

        Robots that have not begun an episode begin their first one.

        Args:
            steps: Observations to answer, of 50 ms each; those that end an episode do not count.
            lane: Lane of all episodes that begin; None for the lanes in turn.

        Returns:
            How episodes ended, in the order of robots, then of episodes.

        Raises:
            SpikelaneError: No such lane.
            Interrupted: A signal has come.
        """
        ends: list[End] = []
        journey = make_journey(len(self), min(steps, CALL_STEPS))
        target = self.steps + steps
        self._begin(lane)
        while np.any(self.steps < target):
            check()
            journey.wanted[:] = np.minimum(target - self.steps, CALL_STEPS)
            self.advance(journey)
            for robot in np.flatnonzero(journey.has_ended).tolist():
                ends.append(End(robot, self.simulators.lane_state(robot)))
                self.reset(robot, lane)
        return sorted(ends, key=lambda end: end.robot)

    def lap(self, lane: str | None = None) -> tuple[list[LaneState], pd.DataFrame]:
        """Drive an episode with each robot, to its end.

        Args:
            lane: Name of the lane; None for the course's first.

        Returns:
            The last lane state of each robot, and what happened in all steps: columns robot, step,
            t_s, x_m, y_m, heading_rad, distance_m, left_rad_s and right_rad_s. The observation
            that ended the episode is the lane state, and has no row.

        Raises:
            SpikelaneError: No such lane, or an episode that nothing ends.
            Interrupted: A signal has come.
        """
        tracks = self.episodes([lane] * len(self))
        return [track.end for track in tracks], _frame(tracks, self.simulators.parameters.period_s)

    def episodes(
        self, lanes: Sequence[str | None], on_advance: OnAdvance = lambda *_: None
    ) -> list[Track]:
        """Drive an episode with each robot, to its end.

        Args:
            lanes: Name of each robot's lane; None for the course's first.
            on_advance: Called as the robots come on.

        Returns:
            The episode of each robot.

        Raises:
            SpikelaneError: No such lane, or an episode that nothing ends.
            Interrupted: A signal has come.
        """
        limits = self.simulators.world.limits
        if not (limits.max_laps or limits.max_steps):
            raise SpikelaneError(
                'episode.max_laps, episode.max_steps: expected a limit, or a lap may never end'
            )
        for robot, lane in enumerate(lanes):
            self.reset(robot, lane, episode=1)
        journey = make_journey(len(self), CALL_STEPS, has_places=True)
        journey.wanted[:] = CALL_STEPS
        places: list[list[NDArray[np.void]]] = [[] for _ in lanes]
        answers: list[list[NDArray[np.float64]]] = [[] for _ in lanes]
        while journey.wanted.any():
            check()
            self.advance(journey)
            counts = journey.taken + journey.has_ended  # the last observation is answered, too
            for robot, count in enumerate(counts.tolist()):
                places[robot].append(journey.places[robot, :count].copy())
                answers[robot].append(journey.answers[robot, :count].copy())
            journey.wanted[journey.has_ended] = 0
            known = self.simulators.robots.known
            on_advance(known['step'], known['progress_m'])
        return [
            Track(self.simulators.lane_state(robot), np.concatenate(where), np.concatenate(what))
            for robot, (where, what) in enumerate(zip(places, answers, strict=True))
        ]

    def _begin(self, lane: str | None) -> None:
        """Begin the first episode of the robots that have begun none."""
        for robot in range(len(self)):
            if not self.simulators.has_begun(robot):
                self.reset(robot, lane)


#: Columns of a table of steps, in addition to robot, step and time.
_COLUMNS = ('x_m', 'y_m', 'heading_rad', 'distance_m')


def _frame(tracks: Sequence[Track], period_s: float) -> pd.DataFrame:
    """Return the steps of all robots as a table."""
    lengths = [len(track.places) - 1 for track in tracks]
    places = np.concatenate([track.places[:-1] for track in tracks])
    answers = np.concatenate([track.answers[:-1] for track in tracks])
    steps = np.concatenate([np.arange(length) for length in lengths])
    robots = np.repeat(np.arange(len(tracks)), lengths)
    values = {name: places[name] for name in _COLUMNS}
    wheels = {'left_rad_s': answers[:, 0], 'right_rad_s': answers[:, 1]}
    return pd.DataFrame(
        {'robot': robots, 'step': steps, 't_s': steps * period_s, **values, **wheels}
    )
