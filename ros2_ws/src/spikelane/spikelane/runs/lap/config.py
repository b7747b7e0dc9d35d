"""What determines a lap."""

from __future__ import annotations

from collections.abc import Collection
import dataclasses
import math
from typing import Any

from spikelane.runs.configuration import Configuration, configure, Request
from spikelane_controllers.weights import shipped_weights
from spikelane_sim.course import course_label, load_course, scenario_course
from spikelane_sim.simulator_parameters import SimulatorParameters

#: Ends a drive that makes no progress: less than 0.1 m farther within this time.
NO_PROGRESS_S = 30.0

#: The time limit of a lap is what this speed needs, a seventh of the usual one [m/s].
SLOWEST_M_S = 0.02


@dataclasses.dataclass(frozen=True, kw_only=True)
class LapConfig(Configuration):
    """Everything that determines a lap.

    Attributes:
        lane: Name of the lane.
    """

    lane: str

    @property
    def usual_name(self) -> str:
        """As in RunConfig."""
        scenario = course_label(self.scenario)
        return f'lap-{scenario}-{self.controller}-{self.lane}-seed{self.seed}'

    @classmethod
    def make(cls, asked: Request, lane: str | None = None) -> LapConfig:
        """Make the configuration of a lap; no lane is the course's first.

        A controller that learns has the weights shipped for the scenario unless others are given.
        Unless other limits are given, the drive ends where the robot makes no progress, and after
        the time that the course's longest lane takes at a slow speed (`limit_drive`).

        Raises:
            SpikelaneError: Anything is unknown or not allowed.
        """
        parts = configure(asked, default_weights(asked.scenario, asked.controller))
        course = load_course(parts['simulator'].course)
        length_m = max(each.length_m for each in course.lanes.values())
        parts['simulator'] = limit_drive(parts['simulator'], asked.parameters, length_m)
        return cls(lane=course.lane(lane).name if lane else next(iter(course.lanes)), **parts)


#: Parameters of the simulator that `limit_drive` sets where they are not given.
LIMITS = ('episode.max_steps', 'episode.no_progress_steps')


def limit_drive(
    simulator: SimulatorParameters, given: Collection[str], length_m: float
) -> SimulatorParameters:
    """Return a simulator's parameters with limits that end every drive of some laps.

    Args:
        simulator: The parameters.
        given: Names of the parameters that were given: their limits are kept.
        length_m: Length of one lap.
    """
    episode = simulator.episode
    steps = math.ceil(episode.max_laps * length_m / (SLOWEST_M_S * simulator.period_s))
    idle_steps = round(NO_PROGRESS_S / simulator.period_s)
    limits = zip(LIMITS, (min(steps, 2**31 - 1), idle_steps), strict=True)
    missing = {
        name.removeprefix('episode.'): value
        for name, value in limits
        if f'simulator.{name}' not in given
    }
    return dataclasses.replace(simulator, episode=dataclasses.replace(episode, **missing))


def default_weights(scenario: str, controller: str) -> dict[str, Any]:
    """Return the parameter that gives a controller the weights shipped for a scenario, if any.

    Raises:
        SpikelaneError: There is no such scenario.
    """
    name = scenario_course(scenario)
    return {f'{controller}.checkpoint': name} if name in shipped_weights(controller) else {}
