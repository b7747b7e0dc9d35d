"""Which drives the report shows together, and which of a group stands for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

from spikelane.report.groups import by_key, Key, PAPER_LANE, R
from spikelane.report.labels import plain
from spikelane.report.paper import PAPER_SCENARIOS
from spikelane.report.runs import Lap, RANDOM_COURSES

#: Drives in one comparison; more do not fit on a screen together.
_MOST_DRIVES = 4

#: Comparisons for a scenario and lane; an experiment can have dozens of settings.
MOST_COMPARISONS = 3

#: Other courses than the paper's that are compared on.
MOST_OTHER_COURSES = 3


class Place(NamedTuple):
    """Where drives are laid together: those of one group on one lane."""

    key: Key
    lane: str

    @classmethod
    def of(cls, lap: Lap) -> Place:
        """Return that of a lap."""
        return cls(Key(lap.controller, lap.scenario, lap.setting), lap.lane)


def representative_laps(laps: Iterable[Lap]) -> dict[Place, Lap]:
    """Return a lap of each group and lane: completed, of median error."""
    chosen = {}
    for key, group in by_key(laps).items():
        for lane in dict.fromkeys(lap.lane for lap in group):
            on_lane = [lap for lap in group if lap.lane == lane]
            done = [lap for lap in on_lane if lap.metrics['completed']] or on_lane
            chosen[Place(key, lane)] = median_run(
                done, lambda lap: float(lap.metrics['mean_abs_distance_m'])
            )
    return chosen


def median_run(group: Sequence[R], value: Callable[[R], float]) -> R:
    """Return the member in the middle, the lower one of two."""
    return sorted(group, key=value)[(len(group) - 1) // 2]


class Comparison(NamedTuple):
    """Drives that one figure compares, one of each group.

    Attributes:
        scenario: All are of.
        lane: All are of.
        number: Number of this one among the figures of this scenario and lane, from 1.
        of: How many these are.
        keys: Keys of the groups.
    """

    scenario: str
    lane: str
    number: int
    of: int
    keys: tuple[Key, ...]

    @property
    def name(self) -> str:
        """Name of the figure's files."""
        lane = '' if self.lane == PAPER_LANE else f'_{plain(self.lane)}'
        part = '' if self.number == 1 else f'_{self.number}'
        return f'deviation_scenario_{plain(self.scenario)}{lane}{part}'


def comparisons(chosen: Mapping[Place, Lap]) -> list[Comparison]:
    """Lay out which drives are compared with which.

    In the first figure of a scenario and lane are the paper's settings, or what comes nearest:
    of each controller its first group, the paper's setting before others; then the others, as
    many as there are figures for.
    """
    found = []
    for scenario, lane in _compared_places(chosen):
        keys = [
            place.key for place in chosen if (place.key.scenario, place.lane) == (scenario, lane)
        ]
        first = list({key.controller: key for key in reversed(keys)}.values())[::-1]
        rest = [key for key in keys if key not in first]
        parts = [
            tuple(some[start : start + _MOST_DRIVES])
            for some in (first, rest)
            for start in range(0, len(some), _MOST_DRIVES)
        ][:MOST_COMPARISONS]
        found += [
            Comparison(scenario, lane, number, len(parts), part)
            for number, part in enumerate(parts, 1)
        ]
    return found


def _compared_places(chosen: Mapping[Place, Lap]) -> list[tuple[str, str]]:
    """Return the scenarios and lanes compared on; of others than the paper's only the first."""
    places = dict.fromkeys((place.key.scenario, place.lane) for place in chosen)
    # The paper's lane before the other, whichever was driven first.
    ordered = sorted(places, key=lambda each: (each[0], each[1] != PAPER_LANE))
    others = list(dict.fromkeys(s for s, _ in ordered if s not in PAPER_SCENARIOS))
    # Each lap of these is on a course of its own.
    others = [scenario for scenario in others if scenario != RANDOM_COURSES]
    shown = (*PAPER_SCENARIOS, *others[:MOST_OTHER_COURSES])
    return [each for each in ordered if each[0] in shown]
