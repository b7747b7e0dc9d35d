"""What was measured of laps and of runs that learn, a value of each independent unit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from spikelane.report.groups import by_key, Key, PAPER_LANE
from spikelane.report.lap_tables import lap_steps, units_of
from spikelane.report.quantities import CORRELATION, COUNT, METRES, PERCENT, Quantity, RATE
from spikelane.report.runs import Lap, Runs, TrainingRun, TransferRun
from spikelane.statistics import unit_means
from spikelane_controllers.learning.results import Measure

#: How the units of measures are written.
QUANTITIES = {
    'count': COUNT,
    'share': PERCENT,
    'm': METRES,
    'spikes/ms': RATE,
    'correlation': CORRELATION,
}

#: What is compared of laps: name in the metrics, words, unit and the value of a lap.
LAP_MEASURES: tuple[tuple[str, str, str, Callable[[dict[str, Any]], float]], ...] = (
    (
        'mean_abs_distance_m',
        f'mean error, {PAPER_LANE} lane',
        'm',
        lambda lap: float(lap['mean_abs_distance_m']),
    ),
    ('lap_steps', f'steps of a lap, {PAPER_LANE} lane', 'count', lap_steps),
)


class Measured(NamedTuple):
    """What was measured of a group, a value of each unit."""

    words: str
    quantity: Quantity
    values: Sequence[float]
    reached: Sequence[bool] | None  # of times: whether the value is one, or it was later
    n: int  # units
    unit: str
    seeds: Sequence[int]


def measured(runs: Runs) -> dict[str, dict[Key, Measured]]:
    """Return what was measured of laps on the paper's lane, and of runs that learn.

    Returns:
        Values by the name of the measure, and by group.
    """
    found: dict[str, dict[Key, Measured]] = {}
    laps = by_key(lap for lap in runs.laps if lap.lane == PAPER_LANE)
    for name, words, unit, value in LAP_MEASURES:
        quantity = QUANTITIES[unit]
        found[name] = {
            key: laps_measured(each, words, quantity, value) for key, each in laps.items()
        }
    learnt: list[TrainingRun | TransferRun] = [*runs.trainings, *runs.transfers]
    for key, group in by_key(learnt).items():
        for name, values in values_of(group).items():
            found.setdefault(name, {})[key] = values
    return found


def values_of(group: Sequence[TrainingRun | TransferRun]) -> dict[str, Measured]:
    """Return what runs of a group that learn have measured, by the name of the measure."""
    found: dict[str, list[tuple[int, Measure]]] = {}
    for run in group:
        for each in run.results.measures():
            found.setdefault(each.name, []).append((run.seed, each))
    return {name: _of_runs(values, len(group)) for name, values in found.items()}


def _of_runs(values: Sequence[tuple[int, Measure]], n: int) -> Measured:
    first = values[0][1]
    return Measured(
        first.words,
        QUANTITIES[first.unit],
        [each.value for _, each in values],
        None if first.reached is None else [bool(each.reached) for _, each in values],
        n,
        'training',
        [seed for seed, _ in values],
    )


def laps_measured(
    laps: Sequence[Lap], words: str, quantity: Quantity, value: Callable[[dict[str, Any]], float]
) -> Measured:
    """Return the mean of each unit's completed laps.

    Args:
        laps: Laps of one controller, scenario, setting and lane.
        words: What is measured.
        quantity: How it is written.
        value: Returns the measured value, given the metrics of a lap.
    """
    unit, units = units_of(laps)
    done = [(name, lap) for name, each in units.items() for lap in each if lap['completed']]
    means = unit_means([value(lap) for _, lap in done], [name for name, _ in done])
    seeds = [lap.seed for lap in laps]
    return Measured(words, quantity, means, None, len(units), unit, seeds)
