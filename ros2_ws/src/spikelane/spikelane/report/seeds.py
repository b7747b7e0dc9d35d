"""The table of what every seed came to."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from spikelane.report.groups import by_key, Key, Table
from spikelane.report.lap_tables import units_of
from spikelane.report.measured import QUANTITIES
from spikelane.report.quantities import METRES, MINUTES
from spikelane.report.runs import Lap, Runs, TrainingRun, TransferRun
from spikelane_controllers.learning.results import Measure
from spikelane_controllers.registry import title

_Row = tuple[str, ...]


def seeds_table(runs: Runs) -> Table:
    """Return a row for each measure of a group, with the value of each seed."""
    learnt: list[TrainingRun | TransferRun] = [*runs.trainings, *runs.transfers]
    # Experiments' folders may have been moved: what a lap drove with is known by its name.
    seeds = {run.folder.name: run.seed for run in learnt}
    rows = [
        *(row for key, group in by_key(learnt).items() for row in _of_runs(key, group)),
        *(row for key, group in by_key(runs.laps).items() for row in _of_laps(key, group, seeds)),
    ]
    return Table(
        'Every seed',
        '"over": not reached by then. A lap is of the training whose weights drove it, where that '
        'is among the runs, and otherwise of its own seed or course; the error is the mean of the '
        'completed laps on that lane.',
        ('controller', 'scenario', 'setting', 'measure', 'seed: value'),
        rows,
    )


def _of_runs(key: Key, group: Sequence[TrainingRun | TransferRun]) -> Iterator[_Row]:
    measures: dict[str, list[tuple[int, str]]] = {}
    for run in group:
        for each in run.results.measures():
            measures.setdefault(each.words, []).append((run.seed, _shown(each)))
        time_s = run.metrics.get('wall_time_s')
        if isinstance(time_s, (int, float)):  # a resumed training does not know it
            measures.setdefault('wall time', []).append((run.seed, MINUTES.show(time_s)))
    for words, cells in measures.items():
        yield _row(key, words, cells)


def _shown(measure: Measure) -> str:
    text = QUANTITIES[measure.unit].show(measure.value)
    return f'over {text}' if measure.reached is False else text


def _of_laps(key: Key, laps: Sequence[Lap], seeds: Mapping[str, int]) -> Iterator[_Row]:
    unit, _ = units_of(laps)
    name: Callable[[Lap], Any] = {
        'training': lambda lap: seeds.get(Path(lap.training).name, lap.training),
        'course': lambda lap: lap.config.get('scenario'),
        'seed': lambda lap: seeds.get(Path(lap.training).name, lap.seed),
    }[unit]
    for lane in dict.fromkeys(lap.lane for lap in laps):
        units: dict[Any, list[Lap]] = {}
        for lap in laps:
            if lap.lane == lane:
                units.setdefault(name(lap), []).append(lap)
        cells = [(each, _driven(units[each])) for each in units]
        yield _row(key, f'mean error, {lane} lane', cells)


def _driven(laps: Sequence[Lap]) -> str:
    """Return the mean error of completed laps, and how many were not completed."""
    errors_m = [
        float(lap.metrics['mean_abs_distance_m']) for lap in laps if lap.metrics['completed']
    ]
    lost = len(laps) - len(errors_m)
    if not errors_m:
        return 'lost' if lost == 1 else f'{lost} lost'
    words = METRES.show(sum(errors_m) / len(errors_m))
    return f'{words} ({lost} of {len(laps)} lost)' if lost else words


def _row(key: Key, words: str, cells: Sequence[tuple[Any, str]]) -> _Row:
    values = '; '.join(f'{seed}: {cell}' for seed, cell in cells)
    return title(key.controller), key.scenario, key.shown_setting, words, values
