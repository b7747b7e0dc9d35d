"""The report's tables: results against the paper's, and every lap and training over its seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from spikelane.report.aims import aims_table
from spikelane.report.conditions import conditions_table
from spikelane.report.groups import by_key, Key, seeds_in_words, Table
from spikelane.report.lap_tables import lap_tables
from spikelane.report.measured import LAP_MEASURES, Measured, measured, values_of
from spikelane.report.paper import paper_value
from spikelane.report.quantities import COUNT, NOTHING
from spikelane.report.runs import NamedSetting, Runs, TrainingRun, TransferRun
from spikelane.report.seeds import seeds_table
from spikelane.runs.evaluate.summary import UNITS
from spikelane_controllers.learning.results import LAST_LANE_LOSS
from spikelane_controllers.registry import cards, title


def all_tables(runs: Runs) -> list[Table]:
    """Return the tables that these runs have something to say in."""
    values = measured(runs)
    success, laps, kept, operations = lap_tables(runs.laps)
    tables = (
        _against_paper(values),
        _of_settings(runs.settings),
        success,
        laps,
        kept,
        _of_trainings(runs.trainings),
        _of_transfers(runs.transfers),
        aims_table(values),
        operations,
        *map(conditions_table, runs.conditions),
        seeds_table(runs),
    )
    return [table for table in tables if table.rows]


def _against_paper(found: Mapping[str, Mapping[Key, Measured]]) -> Table:
    rows = [
        _row_against_paper(name, key, values)
        for name, of_kind in found.items()
        for key, values in of_kind.items()
        if _is_compared(name, key, values)
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
        brief=('measure', 'paper', 'median (range)'),
    )


def _is_compared(measure: str, key: Key, values: Measured) -> bool:
    """Return whether the paper has such a value, or could have: of laps, and of times."""
    if values.reached is not None or measure in [each[0] for each in LAP_MEASURES]:
        return True
    found = cards().get(key.controller)
    papers = found.paper.values if found and found.paper else ()
    return any(each.measure == measure for each in papers)


def _row_against_paper(measure: str, key: Key, found: Measured) -> tuple[str, ...]:
    paper = paper_value(key.controller, key.scenario, measure)
    count = len(found.values) if found.reached is None else sum(found.reached)
    quantity = found.quantity
    return (
        found.words,
        title(key.controller),
        key.scenario,
        key.shown_setting,
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
    shown = {key: _medians(group) for key, group in groups.items()}
    columns = dict.fromkeys(words for cells in shown.values() for words in cells)
    rows = [
        _row_of_trainings(key, group, [shown[key].get(each, NOTHING) for each in columns])
        for key, group in groups.items()
    ]
    steps = {key.controller: group[0].results.step_words for key, group in groups.items()}
    words = '; '.join(f'{title(name)}: {each}' for name, each in steps.items())
    return Table(
        'Trainings',
        f'What a step is: {words}. Last lane loss: Kaplan-Meier median with range over all '
        'seeds, and its 95 % interval (bootstrap, from six seeds on); settled: with a lap of each '
        'lane after it. The last lane loss of one that has not settled is censored ("over"). What '
        'controllers measure in addition: medians with range.',
        ('controller', 'scenario', 'setting', 'steps', 'episodes', 'last lane loss')
        + ('median, 95 %', 'settled', *columns, 'seeds'),
        rows,
        brief=('last lane loss', 'settled'),
    )


def _row_of_trainings(
    key: Key, runs: Sequence[TrainingRun], more: Sequence[str]
) -> tuple[str, ...]:
    results = [run.results for run in runs]
    losses = [each.last_lane_loss_step for each in results]
    settled = [each.has_settled for each in results]
    return (
        title(key.controller),
        key.scenario,
        key.shown_setting,
        COUNT.median([each.steps for each in results]),
        COUNT.median([len(each.terminations) for each in results]),
        COUNT.median(losses, settled),
        COUNT.median_interval(losses, settled),
        f'{sum(settled)} of {len(runs)}',
        *more,
        seeds_in_words([run.seed for run in runs]),
    )


def _medians(group: Sequence[TrainingRun]) -> dict[str, str]:
    """Return what trainings have measured but for their last lane loss, by the words for it."""
    return {
        each.words: each.quantity.median(each.values, each.reached)
        for name, each in values_of(group).items()
        if name != LAST_LANE_LOSS
    }


def _of_transfers(transfers: Sequence[TransferRun]) -> Table:
    groups = by_key(transfers)
    words: dict[str, None] = {}
    cells: list[tuple[Key, Sequence[TransferRun], dict[str, str]]] = []
    for key, group in groups.items():
        shown = _means(group)
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
                key.shown_setting,
                *(shown.get(each, NOTHING) for each in words),
                seeds_in_words([run.seed for run in group]),
            )
            for key, group, shown in cells
        ],
        brief=tuple(words)[:2],
    )


def _means(group: Sequence[TransferRun]) -> dict[str, str]:
    """Return what was measured of a group as it is written, by the words for it."""
    return {
        each.words: each.quantity.median(each.values)
        if each.quantity is COUNT
        else each.quantity.mean(each.values)
        for each in values_of(group).values()
    }
