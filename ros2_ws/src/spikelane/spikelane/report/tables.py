"""The report's tables: results against the paper's, and every lap and training over its seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import re
from typing import Any, NamedTuple, TypeVar

from spikelane.report.paper import paper_value
from spikelane.report.quantities import (
    COUNT,
    METRES,
    NOTHING,
    PERCENT,
    Quantity,
    RATE,
    SIGNED_METRES,
)
from spikelane.report.runs import Lap, NamedSetting, Runs, TrainingRun, TransferRun
from spikelane.statistics import share_statistics
from spikelane_controllers.operations import Operations, operations_metrics, sum_operations
from spikelane_sim.contract import STEP_S

#: Order of the controllers, the paper's.
ORDER = ('dqn', 'dqn_snn', 'braitenberg', 'rstdp')
_NAMES = {'dqn': 'DQN', 'dqn_snn': 'DQN-SNN', 'braitenberg': 'Braitenberg', 'rstdp': 'R-STDP'}

#: Simulated times that rates are told after: the paper's 10 ms for each step, and long.
_RATE_TIMES_MS = (10, 1000)

#: The lane on which the paper compares controllers.
PAPER_LANE = 'outer'


class Measure(NamedTuple):
    """What can be compared with the paper.

    Attributes:
        words: What it is.
        quantity: How it is written.
    """

    words: str
    quantity: Quantity


MEASURES = {
    'last_lane_loss_step': Measure('step of the last lane loss of those that settled', COUNT),
    'solved_episode': Measure('first of three full episodes in a row', COUNT),
    'solved_step': Measure('action step at the end of these three', COUNT),
    'accuracy': Measure("accuracy on the policy's states", PERCENT),
    'mean_abs_distance_m': Measure(f'mean error, {PAPER_LANE} lane', METRES),
    'lap_steps': Measure(f'steps of a lap, {PAPER_LANE} lane', COUNT),
}


class Table(NamedTuple):
    """A table of texts.

    Attributes:
        title: Above it.
        note: Below it, '' for none.
        header: Names of the columns.
        rows: The cells.
    """

    title: str
    note: str
    header: tuple[str, ...]
    rows: list[tuple[str, ...]]


class Key(NamedTuple):
    """What runs that differ in nothing but the seed have in common."""

    controller: str
    scenario: str
    setting: str

    @property
    def words(self) -> str:
        """All of it in words."""
        setting = f' ({self.setting})' if self.setting else ''
        return f'{shown_name(self.controller)}, scenario {self.scenario}{setting}'


def shown_name(controller: str) -> str:
    """Return how the paper writes a controller's name, or the name where it has no such one."""
    return _NAMES.get(controller, controller)


def _place(key: Key) -> tuple[str, int, str, list[tuple[float, str]]]:
    """Return what groups are sorted by; numbers in a setting by their value."""
    known = ORDER.index(key.controller) if key.controller in ORDER else len(ORDER)
    parts = re.split(r'(\d+(?:\.\d+)?)', key.setting)
    setting = [(float(part), '') if part[:1].isdigit() else (-1.0, part) for part in parts]
    return key.scenario, known, key.controller, setting


R = TypeVar('R', bound=Any)


def by_key(runs: Iterable[R]) -> dict[Key, list[R]]:
    """Group runs that differ in nothing but the seed; scenario by scenario, the paper's order."""
    groups: dict[Key, list[R]] = {}
    for run in runs:
        groups.setdefault(Key(run.controller, run.scenario, run.setting), []).append(run)
    return {
        key: sorted(groups[key], key=lambda run: run.seed) for key in sorted(groups, key=_place)
    }


def all_tables(runs: Runs) -> list[Table]:
    """Return the tables that these runs have something to say in."""
    tables = (
        _against_paper(runs),
        _of_settings(runs.settings),
        _of_laps(runs.laps),
        _of_trainings(runs.trainings),
        _of_transfers(runs.transfers),
        _of_operations(runs.laps),
    )
    return [table for table in tables if table.rows]


def _against_paper(runs: Runs) -> Table:
    rows = []
    for measure, of_kind in _values(runs).items():
        for key, values in of_kind.items():
            rows.append(_row_against_paper(measure, key, values))
    return Table(
        "Results against the paper's",
        'Mean ± standard deviation over the runs that had one, with the 95 % confidence interval '
        "(Student's t, cut to possible values) from two on; median and range. A step is 50 ms. "
        "Setting: what differs from the paper's parameters, or its name. The paper's accuracy is "
        'on the states trained with, the one here on states held out.',
        (
            'measure',
            'controller',
            'scenario',
            'setting',
            'paper',
            'here: mean ± s (95 %)',
            'median (range)',
        )
        + ('runs', 'seeds', 'place in the paper'),
        rows,
    )


def _values(runs: Runs) -> dict[str, dict[Key, list[tuple[int, float | None]]]]:
    """Return seed and value of each run that could have one, by measure and group."""
    laps = by_key(lap for lap in runs.laps if lap.lane == PAPER_LANE)
    trainings, transfers = by_key(runs.trainings), by_key(runs.transfers)
    plastic = {key: each for key, each in trainings.items() if key.controller == 'rstdp'}
    deep = {key: each for key, each in trainings.items() if key.controller == 'dqn'}
    return {
        'mean_abs_distance_m': _of(laps, lambda lap: _if_completed(lap, 'mean_abs_distance_m')),
        'lap_steps': _of(laps, lap_steps),
        'last_lane_loss_step': _of(plastic, _if_settled),
        'solved_episode': _of(deep, lambda run: run.solved_episode),
        'solved_step': _of(deep, lambda run: run.solved_step),
        'accuracy': _of(transfers, lambda run: float(run.metrics['accuracy'])),
    }


def _of(
    groups: dict[Key, list[R]], value: Callable[[R], float | None]
) -> dict[Key, list[tuple[int, float | None]]]:
    return {key: [(run.seed, value(run)) for run in each] for key, each in groups.items()}


def _row_against_paper(
    measure: str, key: Key, values: Sequence[tuple[int, float | None]]
) -> tuple[str, ...]:
    words, quantity = MEASURES[measure]
    found = [value for _, value in values if value is not None]
    paper = paper_value(key.controller, key.scenario, measure)
    return (
        words,
        shown_name(key.controller),
        key.scenario,
        key.setting or "the paper's",
        paper.words if paper else NOTHING,
        quantity.mean(found),
        quantity.median(found),
        f'{len(found)} of {len(values)}',
        seeds_in_words([seed for seed, _ in values]),
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


def _of_laps(laps: Sequence[Lap]) -> Table:
    rows = []
    for key, group in by_key(laps).items():
        for lane in dict.fromkeys(lap.lane for lap in group):
            rows.append(_row_of_laps(key, lane, [lap for lap in group if lap.lane == lane]))
    return Table(
        'Laps',
        'Errors are over completed laps. Mean deviation: right of the centre is positive. '
        "Completed: with the 95 % confidence interval of the share (Wilson's).",
        ('controller', 'scenario', 'setting', 'lane', 'completed')
        + (
            'mean error ± s (95 %)',
            'median (range)',
            'mean deviation',
            'largest error',
            'steps of a lap',
            'seeds',
        ),
        rows,
    )


def _row_of_laps(key: Key, lane: str, laps: Sequence[Lap]) -> tuple[str, ...]:
    done = [lap for lap in laps if lap.metrics['completed']]
    share = share_statistics(len(done), len(laps))
    errors = [lap.metrics['mean_abs_distance_m'] for lap in done]
    return (
        shown_name(key.controller),
        key.scenario,
        key.setting or "the paper's",
        lane,
        f'{len(done)} of {len(laps)} ({share["ci_low"]:.0%} to {share["ci_high"]:.0%})',
        METRES.mean(errors),
        METRES.median(errors),
        SIGNED_METRES.mean([lap.metrics['mean_distance_m'] for lap in done]),
        METRES.show(max(lap.metrics['max_abs_distance_m'] for lap in done)) if done else NOTHING,
        COUNT.mean([steps for lap in done if (steps := lap_steps(lap)) is not None]),
        seeds_in_words([lap.seed for lap in laps]),
    )


def _of_trainings(trainings: Sequence[TrainingRun]) -> Table:
    rows = [_row_of_trainings(key, group) for key, group in by_key(trainings).items()]
    return Table(
        'Trainings',
        "Steps are of 50 ms with R-STDP, of one action (0.5 s) with DQN, as in the paper's "
        'figures. Last lane loss: median and range; settled: with a lap of each lane after it.',
        ('controller', 'scenario', 'setting', 'steps', 'episodes', 'last lane loss', 'settled')
        + ('seeds',),
        rows,
    )


def _row_of_trainings(key: Key, runs: Sequence[TrainingRun]) -> tuple[str, ...]:
    return (
        shown_name(key.controller),
        key.scenario,
        key.setting or "the paper's",
        COUNT.median([run.steps for run in runs]),
        COUNT.median([len(run.terminations) for run in runs]),
        COUNT.median([run.last_lane_loss_step for run in runs]),
        f'{sum(run.has_settled for run in runs)} of {len(runs)}',
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


def _of_operations(laps: Sequence[Lap]) -> Table:
    counted = by_key(lap for lap in laps if lap.metrics.get('operations'))
    rows = [_row_of_operations(key, group) for key, group in counted.items()]
    return Table(
        'Operations for a decision',
        'A stand-in for energy: a spike counts at each synapse that it reaches, a '
        'multiply-accumulate is a weight of a layer whose inputs are numbers; in brackets '
        'without those of inputs that are 0. Updates of neurons, biases and learning are not '
        'counted. Counted of laps driven in one process; those driven over ROS, and those of '
        'versions that did not count, are not among them.',
        ('controller', 'scenario', 'setting', 'decisions in a second')
        + ('synaptic operations for a decision', 'multiply-accumulates for a decision')
        + ('synaptic operations in a second', 'multiply-accumulates in a second', 'laps'),
        rows,
    )


def _row_of_operations(key: Key, laps: Sequence[Lap]) -> tuple[str, ...]:
    total = sum_operations(Operations(**lap.metrics['operations']) for lap in laps)
    # Of each observation, the one at the reset included.
    time_s = sum(lap.metrics['steps'] + 1 for lap in laps) * STEP_S
    found = operations_metrics(total, time_s)

    def cells(per: str) -> tuple[str, str]:
        synaptic = found.get(f'synaptic_operations_{per}')
        all_, active = (found.get(f'{name}multiply_accumulates_{per}') for name in ('', 'active_'))
        in_brackets = '' if active is None else f' ({COUNT.show(active)})'
        return (
            NOTHING if synaptic is None else COUNT.show(synaptic),
            NOTHING if all_ is None else f'{COUNT.show(all_)}{in_brackets}',
        )

    return (
        shown_name(key.controller),
        key.scenario,
        key.setting or "the paper's",
        f'{found["decisions_per_s"]:.3g}',
        *cells('per_decision'),
        *cells('per_s'),
        str(len(laps)),
    )


def lap_steps(lap: Lap) -> float | None:
    """Return the steps of a drive's first lap, None where it was not completed."""
    time_s = lap.metrics['lap_time_s']
    return None if time_s is None else float(round(time_s / STEP_S))


def seeds_in_words(seeds: Sequence[int]) -> str:
    """Return seeds in order, those in a row as a range: '0 to 2, 7'."""
    ordered = sorted(set(seeds))
    runs: list[list[int]] = []
    for seed in ordered:
        if runs and seed == runs[-1][-1] + 1:
            runs[-1].append(seed)
        else:
            runs.append([seed])
    return ', '.join(str(run[0]) if len(run) == 1 else f'{run[0]} to {run[-1]}' for run in runs)


def _if_completed(lap: Lap, name: str) -> float | None:
    return float(lap.metrics[name]) if lap.metrics['completed'] else None


def _if_settled(run: TrainingRun) -> float | None:
    return float(run.last_lane_loss_step) if run.has_settled else None
