#!/usr/bin/env python3
"""Prints the tables of docs/results/dqn.md from what `spikelane reproduce` has left.

source setup/env.sh; docs/results/dqn_table.py [runs/paper]
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import sys

from dqn_runs import LANES, Learnt, read_learnt, VARIANTS
from tables import print_row, spread

Cells = tuple[str, ...]


def main() -> None:
    """Print the tables."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'runs/paper')
    print_tables(
        read_learnt(folder, 'dqn', 'paper'),
        ('action steps', 'solved', 'solved by'),
        lambda runs: (
            f'{runs[0].metrics["steps"]:,}',
            f'{sum(run.metrics["solved_by"] is not None for run in runs)} of {len(runs)}',
            spread([run.metrics['solved_by'] for run in runs], ','),
        ),
        ('solved by', 'full episodes', 'wall time'),
        lambda run: (
            _number(run.metrics['solved_by']),
            str(run.metrics['full_episodes']),
            _minutes(run.metrics['wall_time_s']),
        ),
    )
    for variant, title in VARIANTS.items():
        print(f'## DQN-SNN, {title}\n')
        print_tables(
            read_learnt(folder, 'dqn_snn', variant),
            ('states', 'accuracy, held out', 'accuracy, trained with'),
            lambda runs: (
                spread([run.metrics['states'] for run in runs], ','),
                spread([100 * run.metrics['accuracy'] for run in runs], '.1f', ' %'),
                spread([100 * run.metrics['training_accuracy'] for run in runs], '.1f', ' %'),
            ),
            ('accuracy, held out',),
            lambda run: (f'{100 * run.metrics["accuracy"]:.2f} %',),
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
    print_row('scenario', 'seeds', *titles, *lanes, 'both lanes')
    print_row(*['---'] * (len(titles) + 5))
    for name, runs in scenarios.items():
        print_row(
            name,
            str(len(runs)),
            *cells(runs),
            *(spread([run.error_m(lane) for run in runs], '.4f', ' m') for lane in LANES),
            f'{sum(run.completes for run in runs)} of {len(runs)}',
        )
    print()
    print_row('scenario', 'seed', *titles_of_one, *lanes)
    print_row(*['---'] * (len(titles_of_one) + 4))
    for name, runs in scenarios.items():
        for run in runs:
            lanes = tuple(run.told_m(lane) for lane in LANES)
            print_row(name, str(run.seed), *cells_of_one(run), *lanes)
    print()


def _number(value: int | None) -> str:
    return 'never' if value is None else f'{value:,}'


def _minutes(time_s: float | None) -> str:
    return 'resumed' if time_s is None else f'{time_s / 60:.1f} min'


if __name__ == '__main__':
    main()
