"""Which parameters of a simulator hold in which step of which episode.

An episode has at most two phases: what it begins with, and what a perturbation makes of it. Both
follow from seed and episode alone, so that in one process, over ROS, in a fleet and where a run is
resumed the same parameters hold in the same steps.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from spikelane_sim.contract import conditions_rng
from spikelane_sim.robots import WHEEL_ERRORS
from spikelane_sim.simulator_parameters import SimulatorParameters

#: What a phase has instead of these parameters, since nothing changes in it any more.
_CHECKED = {'randomisation.enabled': False, 'perturbation.changes': []}


class Phases(NamedTuple):
    """The phases of an episode."""

    first: SimulatorParameters
    then: SimulatorParameters | None  # None: the first one lasts
    step: int  # at whose beginning `then` holds; 0 without


class Schedule:
    """The phases of the episodes of one simulator.

    Attributes:
        parameters: The simulator's.
        changing: Names of the parameters that change, from episode to episode or while driving.
    """

    def __init__(self, parameters: SimulatorParameters) -> None:
        self.parameters = parameters
        self._values = parameters.to_dict()
        self._changes = parameters.perturbation.values()
        self._is_random = parameters.randomisation.enabled
        self.changing = set(self._changes)
        if self._is_random:
            self.changing |= set(parameters.randomisation.draw(self._values, conditions_rng(0, 1)))

    @property
    def courses(self) -> tuple[str, ...]:
        """Courses that episodes are on or whose markings are seen, the simulator's own first."""
        names = [self.parameters.course, *self.markings]
        if self.is_on_several_courses:
            names += self.parameters.randomisation.course_names
        return tuple(dict.fromkeys(names))

    @property
    def markings(self) -> tuple[str, ...]:
        """Courses whose markings can be seen on another one."""
        names = (self.parameters.markings, str(self._changes.get('markings', '')))
        return tuple(name for name in names if name)

    @property
    def is_on_several_courses(self) -> bool:
        """Whether episodes draw their courses."""
        return self._is_random and bool(self.parameters.randomisation.courses)

    def values_of(self, name: str) -> tuple[Any, ...]:
        """Return the values of a parameter that are not drawn: the usual and the changed one."""
        return (self._values[name], self._changes.get(name, self._values[name]))

    @property
    def has_wheel_errors(self) -> bool:
        """Whether wheels are ever not as the robot takes them to be."""
        names = set(WHEEL_ERRORS)
        return bool(self.changing & names) or any(self._values[name] != 1.0 for name in names)

    def largest(self, name: str) -> float:
        """Return the largest value that a number can have, of those that can only be added to."""
        drawn = self.parameters.randomisation.most_added(name) if self._is_random else 0.0
        return max(float(self._values[name]) + drawn, float(self._changes.get(name, 0.0)))

    def phases(self, seed: int, episode: int) -> Phases:
        """Return the phases of an episode."""
        if not self.changing:
            return Phases(self.parameters, None, 0)
        values, first = self._values, self.parameters
        if self._is_random:
            drawn = self.parameters.randomisation.draw(values, conditions_rng(seed, episode))
            values = {**values, **drawn}
            first = SimulatorParameters.from_mapping({**values, **_CHECKED})
        perturbation = self.parameters.perturbation
        step = perturbation.step(self.parameters.period_s)
        if not self._changes or episode < perturbation.episode:
            return Phases(first, None, 0)
        changed = {**values, **self._changes, **_CHECKED}
        then = SimulatorParameters.from_mapping(changed)
        if episode > perturbation.episode or step == 1:
            return Phases(then, None, 0)
        return Phases(first, then, step)
