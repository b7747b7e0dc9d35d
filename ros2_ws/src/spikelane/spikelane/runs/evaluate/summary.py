"""Laps summarised over independent units: what a unit is, and which drives are repeats.

Laps are not independent draws. Those of one training share its weights, and those of one course
share the course; without randomness every seed even gives the same drive. So laps are averaged by
unit, and intervals are over units (`statistics`). The unit is the first of these that there are
several of:

- the training whose weights drove,
- the course,
- the seed of the drive.

An interval over courses or seeds therefore holds for the one training that drove them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any, TypedDict

from spikelane.statistics import effective_units, mean_statistics, share_statistics
from spikelane_sim.kinds import check_kind, KindError

#: What a unit can be, and its plural.
UNITS = {'training': 'trainings', 'course': 'courses', 'seed': 'seeds'}

#: Measured of completed laps, with the smallest possible value: a lap cut short says nothing
#: about the rest of it.
MEASURES = {
    'mean_abs_distance_m': 0.0,
    'max_abs_distance_m': 0.0,
    'mean_distance_m': -math.inf,
    'std_distance_m': 0.0,
    'lap_time_s': 0.0,
    'mean_speed_m_s': 0.0,
}

#: Measured of all laps.
MEASURES_OF_ALL = {'progress_m': -math.inf}


class SummarisedLap(TypedDict):
    """What laps are summarised by."""

    course: str
    lane: str
    seed: int
    completed: bool
    mean_abs_distance_m: float
    max_abs_distance_m: float
    mean_distance_m: float
    std_distance_m: float
    lap_time_s: float | None  # of a completed lap a number
    mean_speed_m_s: float
    progress_m: float


#: What two identical drives differ in all the same.
_NAMES = ('seed', 'training')


def check_lap(row: Mapping[str, Any], name: str = '') -> None:
    """Check what belongs together in a lap: steps are counted, a completed lap has a time.

    Args:
        row: Its metrics, whose kinds are checked.
        name: Name of the lap in the file, with a point after it.

    Raises:
        KindError: Its steps are negative, or it is completed and has no time.
    """
    if (steps := row.get('steps', 0)) < 0:
        raise KindError(f'{name}steps: expected a whole number of at least 0, got {steps}')
    if row['completed']:
        check_kind(row['lap_time_s'], float, f'{name}lap_time_s')


def unit_of(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return what the unit of laps is, one of UNITS.

    Args:
        rows: One row for each lap, at least its seed; `training` and `course` where they are
            known.
    """
    return next((name for name in UNITS if len({row.get(name) for row in rows}) > 1), 'seed')


def laps_by_unit(
    rows: Sequence[Mapping[str, Any]], unit: str
) -> dict[Any, list[Mapping[str, Any]]]:
    """Group laps by their unit; units whose drives are all those of another are left out.

    Args:
        rows: One row for each lap: its course, lane, seed and metrics.
        unit: As `unit_of` has it.

    Returns:
        Laps by the training, course or seed that they are of.
    """
    members: dict[Any, list[Mapping[str, Any]]] = {}
    for row in rows:
        members.setdefault(row.get(unit), []).append(row)
    distinct: dict[tuple[Any, ...], Any] = {}
    for name, laps in members.items():
        distinct.setdefault(tuple(sorted(map(_drive, laps))), name)
    return {name: members[name] for name in distinct.values()}


def _drive(row: Mapping[str, Any]) -> str:
    """Return what is the same of identical drives: full precision tells different ones apart."""
    return repr(sorted((name, value) for name, value in row.items() if name not in _NAMES))


def summarise(rows: Sequence[Mapping[str, Any]], unit: str = '') -> dict[str, Any]:
    """Describe laps as a whole.

    Args:
        rows: One row for each lap: its course, lane, seed and metrics.
        unit: What is independent, one of UNITS; found by `unit_of` without it.

    Returns:
        `unit`: what is independent; `units`: how many distinct ones there are; `laps`: how many
        were driven, and `distinct_laps`: how many of these are no repeat of another, with the
        same drive step by step; of distinct units `completed`: the share of laps, and
        `units_completed`: that of units with all their laps, as `share_statistics` has them; and
        the statistics (`mean_statistics`) of each of MEASURES over the completed laps, and of
        each of MEASURES_OF_ALL over all.
    """
    unit = unit or unit_of(rows)
    units = laps_by_unit(rows, unit)
    laps = [(name, lap) for name, members in units.items() for lap in members]
    done = [(name, lap) for name, lap in laps if lap['completed']]
    drives = set(map(_drive, rows))

    def measured(members: Sequence[tuple[Any, Mapping[str, Any]]], name: str, low: float) -> Any:
        return mean_statistics(
            [lap[name] for _, lap in members], [unit for unit, _ in members], low
        )

    whole = sum(all(lap['completed'] for lap in members) for members in units.values())
    sizes = [len(members) for members in units.values()]
    return {
        'unit': unit,
        'units': len(units),
        'laps': len(rows),
        'distinct_laps': len(drives),
        'completed': share_statistics(len(done), len(laps), effective_units(sizes)),
        'units_completed': share_statistics(whole, len(units)),
        **{name: measured(done, name, low) for name, low in MEASURES.items()},
        **{name: measured(laps, name, low) for name, low in MEASURES_OF_ALL.items()},
    }


def summarise_by_lane(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return `all` laps and those `by_lane`, as `summarise` describes them, with one unit."""
    unit = unit_of(rows)
    lanes = dict.fromkeys(row['lane'] for row in rows)
    return {
        'all': summarise(rows, unit),
        'by_lane': {
            lane: summarise([row for row in rows if row['lane'] == lane], unit) for lane in lanes
        },
    }


def counted(count: int, unit: str) -> str:
    """Return a number of one of UNITS in words: '1 seed', '3 seeds'."""
    return f'{count} {unit if count == 1 else UNITS[unit]}'


def units_in_words(summary: Mapping[str, Any]) -> str:
    """Return how many units laps are of, and how many laps repeat others: '3 seeds'."""
    words = counted(summary['units'], summary['unit'])
    if summary['distinct_laps'] == summary['laps']:
        return words
    return f'{words}; {summary["distinct_laps"]} distinct of {summary["laps"]} laps driven'
