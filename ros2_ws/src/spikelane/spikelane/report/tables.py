"""The report's tables: results against the paper's, and every lap and training over its seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from spikelane.report.groups import by_key, Key, PAPER_LANE, seeds_in_words, shown_name, Table
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
from spikelane.statistics import unit_means
from spikelane.summary import UNITS

#: Simulated times that rates are told after: the paper's 10 ms for each step, and long.
_RATE_TIMES_MS = (10, 1000)


class Measure(NamedTuple):
    """What can be compared with the paper.

    Attributes:
        words: What it is.
        quantity: How it is written.
    """

    words: str
    quantity: Quantity


MEASURES = {
    'last_lane_loss_step': Measure('step of the last lane loss', COUNT),
    'solved_episode': Measure('first of three full episodes in a row', COUNT),
    'solved_step': Measure('action step at the end of these three', COUNT),
    'accuracy': Measure("accuracy on the policy's states", PERCENT),
    'mean_abs_distance_m': Measure(f'mean error, {PAPER_LANE} lane', METRES),
    'lap_steps': Measure(f'steps of a lap, {PAPER_LANE} lane', COUNT),
}


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
    rows = []
    for measure, of_kind in _values(runs).items():
        for key, values in of_kind.items():
            rows.append(_row_against_paper(measure, key, values))
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

    values: Sequence[float]
    reached: Sequence[bool] | None  # of times: whether the value is one, or it was later
    n: int  # units
    unit: str
    seeds: Sequence[int]


def _values(runs: Runs) -> dict[str, dict[Key, _Values]]:
    """Return what was measured, by measure and group."""
    laps = by_key(lap for lap in runs.laps if lap.lane == PAPER_LANE)
    trainings, transfers = by_key(runs.trainings), by_key(runs.transfers)
    plastic = {key: each for key, each in trainings.items() if key.controller == 'rstdp'}
    deep = {key: each for key, each in trainings.items() if key.controller == 'dqn'}
    return {
        'mean_abs_distance_m': {
            key: _of_laps(each, lambda lap: float(lap['mean_abs_distance_m']))
            for key, each in laps.items()
        },
        'lap_steps': {key: _of_laps(each, lap_steps) for key, each in laps.items()},
        'last_lane_loss_step': {
            key: _of_times(each, lambda run: (run.last_lane_loss_step, run.has_settled))
            for key, each in plastic.items()
        },
        'solved_episode': {
            key: _of_times(each, lambda run: _or(run.solved_episode, len(run.terminations)))
            for key, each in deep.items()
        },
        'solved_step': {
            key: _of_times(each, lambda run: _or(run.solved_step, run.steps))
            for key, each in deep.items()
        },
        'accuracy': {
            key: _Values(
                [float(run.metrics['accuracy']) for run in each],
                None,
                len(each),
                'training',
                [run.seed for run in each],
            )
            for key, each in transfers.items()
        },
    }


def _of_laps(laps: Sequence[Lap], value: Callable[[dict[str, Any]], float]) -> _Values:
    """Return the mean of each unit's completed laps."""
    unit, units = units_of(laps)
    done = [(name, lap) for name, each in units.items() for lap in each if lap['completed']]
    means = unit_means([value(lap) for _, lap in done], [name for name, _ in done])
    return _Values(means, None, len(units), unit, [lap.seed for lap in laps])


def _of_times(
    runs: Sequence[TrainingRun], time: Callable[[TrainingRun], tuple[float, bool]]
) -> _Values:
    """Return when each training reached something."""
    times, reached = zip(*map(time, runs), strict=True)
    return _Values(times, reached, len(runs), 'training', [run.seed for run in runs])


def _or(time: float | None, end: float) -> tuple[float, bool]:
    """Return a time and that it was reached, or when a training ended without it."""
    return (end, False) if time is None else (time, True)


def _row_against_paper(measure: str, key: Key, found: _Values) -> tuple[str, ...]:
    words, quantity = MEASURES[measure]
    paper = paper_value(key.controller, key.scenario, measure)
    count = len(found.values) if found.reached is None else sum(found.reached)
    return (
        words,
        shown_name(key.controller),
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
    rows = [(shown_name(each.controller), each.kind, each.name, each.words) for each in settings]
    return Table(
        'Settings',
        "What differs from the paper's parameters in the settings that have names.",
        ('controller', 'of', 'setting', 'what differs'),
        sorted(rows),
    )


def _of_trainings(trainings: Sequence[TrainingRun]) -> Table:
    rows = [_row_of_trainings(key, group) for key, group in by_key(trainings).items()]
    return Table(
        'Trainings',
        "Steps are of 50 ms with R-STDP, of one action (0.5 s) with DQN, as in the paper's "
        'figures. Last lane loss: Kaplan-Meier median with range over all seeds, and its 95 % '
        'interval (bootstrap, from six seeds on); settled: with a lap of each lane after it. The '
        'last lane loss of one that has not settled is censored ("over").',
        ('controller', 'scenario', 'setting', 'steps', 'episodes', 'last lane loss')
        + ('median, 95 %', 'settled', 'seeds'),
        rows,
    )


def _row_of_trainings(key: Key, runs: Sequence[TrainingRun]) -> tuple[str, ...]:
    losses = [run.last_lane_loss_step for run in runs]
    settled = [run.has_settled for run in runs]
    return (
        shown_name(key.controller),
        key.scenario,
        key.setting or "the paper's",
        COUNT.median([run.steps for run in runs]),
        COUNT.median([len(run.terminations) for run in runs]),
        COUNT.median(losses, settled),
        COUNT.median_interval(losses, settled),
        f'{sum(settled)} of {len(runs)}',
        seeds_in_words([run.seed for run in runs]),
    )


def _of_transfers(transfers: Sequence[TransferRun]) -> Table:
    rows = [_row_of_transfers(key, group) for key, group in by_key(transfers).items()]
    short, long = (f'{milliseconds:,} ms' for milliseconds in _RATE_TIMES_MS)
    return Table(
        'Transfers',
        'Accuracy: share of states with the action of the Q-network. Agreement: share of states '
        'with most output spikes for the action of the network with activations, after that '
        'simulated time from rest, potentials reset to 0. Difference: between rates and '
        'activations of the output neurons, root mean square.',
        ('scenario', 'setting', 'states', 'accuracy: held out, mean ± s (95 %)', 'median (range)')
        + ('accuracy: trained with', f'agreement after {short}', f'after {long}')
        + (f'difference after {short} [spikes/ms]', f'after {long} [spikes/ms]', 'seeds'),
        rows,
    )


def _row_of_transfers(key: Key, runs: Sequence[TransferRun]) -> tuple[str, ...]:
    held_out = [float(run.metrics['accuracy']) for run in runs]
    rates = [
        quantity.mean([value for run in runs if (value := _rate(run, name, time_ms)) is not None])
        for name, quantity in (('agreement', PERCENT), ('output', RATE))
        for time_ms in _RATE_TIMES_MS
    ]
    return (
        key.scenario,
        key.setting or "the paper's",
        COUNT.median([run.metrics['states'] for run in runs]),
        PERCENT.mean(held_out),
        PERCENT.median(held_out),
        PERCENT.mean([float(run.metrics['training_accuracy']) for run in runs]),
        *rates,
        seeds_in_words([run.seed for run in runs]),
    )


def _rate(run: TransferRun, name: str, time_ms: int) -> float | None:
    """Return what was measured after some simulated time, None where it was not."""
    errors = run.metrics.get('rates', {}).get('reset to 0', ())
    return next((each[name] for each in errors if each['simulated_ms'] == time_ms), None)
