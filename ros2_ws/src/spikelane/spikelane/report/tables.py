"""The report's tables: results against the paper's, and every lap and training over its seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from spikelane.report.groups import by_key, Key, PAPER_LANE, seeds_in_words, Table
from spikelane.report.lap_tables import lap_steps, lap_tables, units_of
from spikelane.report.paper import paper_value
from spikelane.report.quantities import (
    COUNT,
    METRES,
    NOTHING,
    PERCENT,
    Quantity,
    RATE,
)
from spikelane.report.runs import Lap, NamedSetting, Runs, TrainingRun, TransferRun
from spikelane.runs.evaluate.summary import UNITS
from spikelane.statistics import unit_means
from spikelane_controllers.registry import cards, title

#: How the units of measures are written.
QUANTITIES = {'count': COUNT, 'share': PERCENT, 'm': METRES, 'spikes/ms': RATE}

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


def all_tables(runs: Runs) -> list[Table]:
    """Return the tables that these runs have something to say in."""
    success, laps, operations = lap_tables(runs.laps)
    tables = (
        _against_paper(runs),
        _of_settings(runs.settings),
        success,
        laps,
        _of_trainings(runs.trainings),
        _of_transfers(runs.transfers),
        operations,
    )
    return [table for table in tables if table.rows]


def _against_paper(runs: Runs) -> Table:
    rows = [
        _row_against_paper(name, key, values)
        for name, of_kind in _values(runs).items()
        for key, values in of_kind.items()
    ]
    return Table(
        "Results against the paper's",
        'Over independent units, which are trainings where several were driven: mean ± standard '
        "deviation with its 95 % interval (Student's t, on a log or logit scale where a quantity "
        'has bounds), and median with range and its 95 % interval (bootstrap, from six units on). '
        'Times that a training had not reached by its end are censored ("over"), and their median '
        'is the Kaplan-Meier estimate. Units: those that have a value or reached it. A step is '
        "50 ms. Setting: what differs from the paper's parameters, or its name. The paper's "
        'accuracy is on the states trained with, the one here on states held out.',
        (
            'measure',
            'controller',
            'scenario',
            'setting',
            'paper',
            'here: mean ± s (95 %)',
            'median (range)',
            'median, 95 %',
        )
        + ('units', 'seeds', 'place in the paper'),
        rows,
    )


class _Values(NamedTuple):
    """What was measured of a group, a value of each unit."""

    words: str
    quantity: Quantity
    values: Sequence[float]
    reached: Sequence[bool] | None  # of times: whether the value is one, or it was later
    n: int  # units
    unit: str
    seeds: Sequence[int]


def _values(runs: Runs) -> dict[str, dict[Key, _Values]]:
    """Return what was measured, by name and group."""
    found: dict[str, dict[Key, _Values]] = {}
    laps = by_key(lap for lap in runs.laps if lap.lane == PAPER_LANE)
    for name, words, unit, value in LAP_MEASURES:
        quantity = QUANTITIES[unit]
        found[name] = {key: _of_laps(each, words, quantity, value) for key, each in laps.items()}
    learnt: list[TrainingRun | TransferRun] = [*runs.trainings, *runs.transfers]
    for key, group in by_key(learnt).items():
        for measures in zip(*(run.results.measures() for run in group), strict=True):
            first = measures[0]
            is_time = first.reached is not None
            if is_time or _is_in_paper(key.controller, first.name):
                found.setdefault(first.name, {})[key] = _Values(
                    first.words,
                    QUANTITIES[first.unit],
                    [each.value for each in measures],
                    [bool(each.reached) for each in measures] if is_time else None,
                    len(group),
                    'training',
                    [run.seed for run in group],
                )
    return found


def _is_in_paper(controller: str, measure: str) -> bool:
    found = cards().get(controller)
    values = found.paper.values if found and found.paper else ()
    return any(each.measure == measure for each in values)


def _of_laps(
    laps: Sequence[Lap], words: str, quantity: Quantity, value: Callable[[dict[str, Any]], float]
) -> _Values:
    """Return the mean of each unit's completed laps."""
    unit, units = units_of(laps)
    done = [(name, lap) for name, each in units.items() for lap in each if lap['completed']]
    means = unit_means([value(lap) for _, lap in done], [name for name, _ in done])
    seeds = [lap.seed for lap in laps]
    return _Values(words, quantity, means, None, len(units), unit, seeds)


def _row_against_paper(measure: str, key: Key, found: _Values) -> tuple[str, ...]:
    paper = paper_value(key.controller, key.scenario, measure)
    count = len(found.values) if found.reached is None else sum(found.reached)
    quantity = found.quantity
    return (
        found.words,
        title(key.controller),
        key.scenario,
        key.setting or "the paper's",
        paper.words if paper else NOTHING,
        # Censored times have no mean.
        quantity.mean(found.values) if found.reached is None else NOTHING,
        quantity.median(found.values, found.reached),
        quantity.median_interval(found.values, found.reached),
        f'{count} of {found.n} {found.unit if found.n == 1 else UNITS[found.unit]}',
        seeds_in_words(found.seeds),
        paper.place if paper else NOTHING,
    )


def _of_settings(settings: Sequence[NamedSetting]) -> Table:
    rows = [(title(each.controller), each.kind, each.name, each.words) for each in settings]
    return Table(
        'Settings',
        "What differs from the paper's parameters in the settings that have names.",
        ('controller', 'of', 'setting', 'what differs'),
        sorted(rows),
    )


def _of_trainings(trainings: Sequence[TrainingRun]) -> Table:
    groups = by_key(trainings)
    rows = [_row_of_trainings(key, group) for key, group in groups.items()]
    steps = {key.controller: group[0].results.step_words for key, group in groups.items()}
    words = '; '.join(f'{title(name)}: {each}' for name, each in steps.items())
    return Table(
        'Trainings',
        f'What a step is: {words}. Last lane loss: Kaplan-Meier median with range over all '
        'seeds, and its 95 % interval (bootstrap, from six seeds on); settled: with a lap of each '
        'lane after it. The last lane loss of one that has not settled is censored ("over").',
        ('controller', 'scenario', 'setting', 'steps', 'episodes', 'last lane loss')
        + ('median, 95 %', 'settled', 'seeds'),
        rows,
    )


def _row_of_trainings(key: Key, runs: Sequence[TrainingRun]) -> tuple[str, ...]:
    results = [run.results for run in runs]
    losses = [each.last_lane_loss_step for each in results]
    settled = [each.has_settled for each in results]
    return (
        title(key.controller),
        key.scenario,
        key.setting or "the paper's",
        COUNT.median([each.steps for each in results]),
        COUNT.median([len(each.terminations) for each in results]),
        COUNT.median(losses, settled),
        COUNT.median_interval(losses, settled),
        f'{sum(settled)} of {len(runs)}',
        seeds_in_words([run.seed for run in runs]),
    )


def _of_transfers(transfers: Sequence[TransferRun]) -> Table:
    groups = by_key(transfers)
    words: dict[str, None] = {}
    cells: list[tuple[Key, Sequence[TransferRun], dict[str, str]]] = []
    for key, group in groups.items():
        shown = _measured(group)
        words |= dict.fromkeys(shown)
        cells.append((key, group, shown))
    notes = dict.fromkeys(group[0].results.note for group in groups.values())
    return Table(
        'Transfers',
        f'Medians of counts; otherwise mean ± s (95 %). {" ".join(notes)}',
        ('controller', 'scenario', 'setting', *words, 'seeds'),
        [
            (
                title(key.controller),
                key.scenario,
                key.setting or "the paper's",
                *(shown.get(each, NOTHING) for each in words),
                seeds_in_words([run.seed for run in group]),
            )
            for key, group, shown in cells
        ],
    )


def _measured(group: Sequence[TransferRun]) -> dict[str, str]:
    """Return what was measured of a group as it is written, by the words for it."""
    values: dict[tuple[str, str], list[float]] = {}
    for run in group:
        for each in run.results.measures():
            values.setdefault((each.words, each.unit), []).append(each.value)
    return {
        words: COUNT.median(found) if unit == 'count' else QUANTITIES[unit].mean(found)
        for (words, unit), found in values.items()
    }
