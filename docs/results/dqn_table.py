#!/usr/bin/env python3
"""Prints the tables of docs/results/dqn.md from what `spikelane reproduce` has left.

source setup/env.sh; docs/results/dqn_table.py [runs/paper]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
import sys
from typing import Any

from dqn_runs import LANES, Learnt, read_learnt, VARIANTS
from tables import print_row, share_in_words, verdict

from spikelane.report.quantities import COUNT, METRES, NOTHING, PERCENT, Quantity
from spikelane.statistics import mean_statistics

Cells = tuple[str, ...]

#: Aims by scenario: action steps until solved, mean errors on the outer lane, accuracies.
AIMS_OF_STEPS = {'1': 60_000, '2': 60_000, '3': 100_000}
AIMS_OF_ERRORS_M = {'dqn': {'1': 0.020, '2': 0.030, '3': 0.025}, 'dqn_snn': {'2': 0.040}}
AIMS_OF_ACCURACY = {'1': 0.931, '2': 0.92, '3': 0.90}


def main() -> None:
    """Print the tables."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'runs/paper')
    learnt = read_learnt(folder, 'dqn', 'paper')
    print_tables(
        learnt,
        ('action steps', 'solved', 'solved by: median (range)'),
        lambda runs: (
            f'{runs[0].metrics["steps"]:,}',
            share_in_words(sum(times(runs)[1]), len(runs)),
            COUNT.median(*times(runs)),
        ),
        ('solved by', 'full episodes', 'wall time'),
        lambda run: (
            _number(run.metrics['solved_by']),
            str(run.metrics['full_episodes']),
            _minutes(run.metrics['wall_time_s']),
        ),
    )
    print_aims(learnt, 'dqn', AIMS_OF_STEPS, lambda runs: mean_statistics(_solved(runs), low=0.0))
    for variant, title in VARIANTS.items():
        print(f'## DQN-SNN, {title}\n')
        transferred = read_learnt(folder, 'dqn_snn', variant)
        print_tables(
            transferred,
            ('states', 'accuracy, held out: mean ± s (95 %)', 'median (range)')
            + ('accuracy, trained with: median (range)',),
            lambda runs: (
                COUNT.median([run.metrics['states'] for run in runs]),
                PERCENT.mean([run.metrics['accuracy'] for run in runs]),
                PERCENT.median([run.metrics['accuracy'] for run in runs]),
                PERCENT.median([run.metrics['training_accuracy'] for run in runs]),
            ),
            ('accuracy, held out',),
            lambda run: (PERCENT.show(run.metrics['accuracy']),),
        )
        print_aims(
            transferred,
            'dqn_snn',
            AIMS_OF_ACCURACY,
            lambda runs: mean_statistics(
                [run.metrics['accuracy'] for run in runs], low=0.0, high=1.0
            ),
        )


def times(runs: list[Learnt]) -> tuple[list[int], list[bool]]:
    """Return by when trainings were solved; those that were not are censored at their end."""
    solved = [run.metrics['solved_by'] for run in runs]
    ends = [run.metrics['steps'] for run in runs]
    return (
        [end if step is None else step for step, end in zip(solved, ends, strict=True)],
        [step is not None for step in solved],
    )


def print_tables(
    scenarios: dict[str, list[Learnt]],
    titles: Cells,
    cells: Callable[[list[Learnt]], Cells],
    titles_of_one: Cells,
    cells_of_one: Callable[[Learnt], Cells],
) -> None:
    """Print a row for each scenario, then every seed."""
    lanes = tuple(f'mean error, {lane}' for lane in LANES)
    of_lanes = tuple(
        f'{name}: {what}' for name in lanes for what in ('mean ± s (95 %)', 'median (range)')
    )
    print_row('scenario', 'seeds', *titles, *of_lanes, 'both lanes')
    print_row(*['---'] * (len(titles) + 7))
    for name, runs in scenarios.items():
        errors_m = [errors_of(runs, lane) for lane in LANES]
        print_row(
            *(name, str(len(runs)), *cells(runs)),
            *(cell for each in errors_m for cell in (METRES.mean(each), METRES.median(each))),
            share_in_words(sum(run.completes for run in runs), len(runs)),
        )
    print()
    print_row('scenario', 'seed', *titles_of_one, *lanes)
    print_row(*['---'] * (len(titles_of_one) + 4))
    for name, runs in scenarios.items():
        for run in runs:
            cells_of_lanes = tuple(run.told_m(lane) for lane in LANES)
            print_row(name, str(run.seed), *cells_of_one(run), *cells_of_lanes)
    print()


def errors_of(runs: list[Learnt], lane: str) -> list[float]:
    """Return the mean errors of the trainings that completed a lane."""
    return [error_m for run in runs if (error_m := run.error_m(lane)) is not None]


def print_aims(
    scenarios: dict[str, list[Learnt]],
    controller: str,
    aims: Mapping[str, float],
    describe: Callable[[list[Learnt]], Mapping[str, Any] | None],
) -> None:
    """Print what 95 % intervals of means say of the aims."""
    is_dqn = controller == 'dqn'
    quantity = COUNT if is_dqn else PERCENT
    print_row('scenario', 'mean of', 'aim', '95 %', 'aim reached?')
    print_row(*['---'] * 5)
    for name, runs in scenarios.items():
        found = describe(runs)
        words = ('solved by', '≤') if is_dqn else ('accuracy, held out', '≥')
        aim = aims[name]
        print_row(
            *(name, words[0], f'{words[1]} {quantity.show(aim)}', _interval(found, quantity)),
            verdict(found, aim, at_least=not is_dqn),
        )
        if (aim_m := AIMS_OF_ERRORS_M[controller].get(name)) is not None:
            found = mean_statistics(errors_of(runs, 'outer'), low=0.0)
            print_row(
                *(name, 'mean error, outer', f'≤ {METRES.show(aim_m)}', _interval(found, METRES)),
                verdict(found, aim_m),
            )
    print()


def _interval(found: Mapping[str, Any] | None, quantity: Quantity) -> str:
    if found is None or found['ci_low'] is None:
        return NOTHING
    return f'{quantity.show(found["ci_low"])} to {quantity.show(found["ci_high"])}'


def _solved(runs: list[Learnt]) -> list[float]:
    """Return by when all were solved; nothing where one was not: then there is no mean."""
    found, reached = times(runs)
    return list(found) if all(reached) else []


def _number(value: int | None) -> str:
    return 'never' if value is None else f'{value:,}'


def _minutes(time_s: float | None) -> str:
    return 'resumed' if time_s is None else f'{time_s / 60:.1f} min'


if __name__ == '__main__':
    main()
