#!/usr/bin/env python3
"""Prints the tables of docs/results/dqn.md from what dqn.sh and dqn_snn.sh have left.

source setup/env.sh; docs/results/dqn_table.py DQN [DQN_SNN]
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import sys
from typing import Any, NamedTuple

from tables import print_row, read_json, spread

LANES = ('outer', 'inner')
SETTINGS = {'paper': "The paper's settings", 'best': 'The best settings found'}


class Run(NamedTuple):
    """What was learnt with a seed, and the laps it drove."""

    seed: int
    learnt: dict[str, Any]  # what the command that taught it printed
    laps: dict[str, dict[str, Any]]  # by lane; empty where they are not driven yet

    @property
    def completes(self) -> bool:
        """Whether a lap of each lane was completed."""
        return all(lap.get('completed') for lap in self.laps.values())

    def error_m(self, lane: str) -> float | None:
        """Mean distance from the lane's centre in a completed lap."""
        lap = self.laps[lane]
        return float(lap['mean_abs_distance_m']) if lap.get('completed') else None

    def told_m(self, lane: str) -> str:
        """Return the error, or how far the robot came."""
        lap, error_m = self.laps[lane], self.error_m(lane)
        if error_m is not None:
            return f'{error_m:.4f} m'
        return f'lost after {lap["distance_m"]:.1f} m' if lap else 'not driven yet'


def main() -> None:
    """Print the tables."""
    if len(sys.argv) not in (2, 3):
        sys.exit('usage: dqn_table.py DQN [DQN_SNN]')
    print_dqn(dict(by_scenario(Path(sys.argv[1]), 'train')))
    for setting, title in SETTINGS.items() if len(sys.argv) == 3 else ():
        scenarios = dict(by_scenario(Path(sys.argv[2], setting), 'transfer'))
        if scenarios:
            print(f'### {title}\n')
            print_transfers(scenarios)


def by_scenario(folder: Path, command: str) -> Iterator[tuple[str, list[Run]]]:
    """Read the runs of each scenario, by seed."""
    for path in sorted(folder.glob('?')):
        runs = [
            Run(
                int(file.name.split('.')[0]),
                read_json(file),
                {lane: read_json(Path(str(file).replace(command, lane))) for lane in LANES},
            )
            for file in sorted(path.glob(f'*.{command}.json'))
        ]
        if runs:
            yield path.name, runs


def print_dqn(scenarios: dict[str, list[Run]]) -> None:
    """Print a row for each scenario, then every seed."""
    print_row(
        *('scenario', 'seeds', 'action steps', 'solved', 'solved by', 'mean error, outer'),
        *('mean error, inner', 'both lanes'),
    )
    print_row(*['---'] * 8)
    for name, runs in scenarios.items():
        solved = [run.learnt['solved_by'] for run in runs]
        print_row(
            name,
            str(len(runs)),
            f'{runs[0].learnt["steps"]:,}',
            f'{sum(each is not None for each in solved)} of {len(runs)}',
            spread(solved, ','),
            *(spread([run.error_m(lane) for run in runs], '.4f', ' m') for lane in LANES),
            f'{sum(run.completes for run in runs)} of {len(runs)}',
        )
    print()
    print_row('scenario', 'seed', 'solved by', 'outer', 'inner', 'wall time')
    print_row(*['---'] * 6)
    for name, runs in scenarios.items():
        for run in runs:
            solved_by, time_s = run.learnt['solved_by'], run.learnt['wall_time_s']
            print_row(
                name,
                str(run.seed),
                'never' if solved_by is None else f'{solved_by:,}',
                *(run.told_m(lane) for lane in LANES),
                'resumed' if time_s is None else f'{time_s / 60:.0f} min',
            )
    print()


def print_transfers(scenarios: dict[str, list[Run]]) -> None:
    """Print a row for each scenario, then every seed."""
    print_row(
        *('scenario', 'seeds', 'states', 'accuracy, held out', 'mean error, outer'),
        *('mean error, inner', 'both lanes'),
    )
    print_row(*['---'] * 7)
    for name, runs in scenarios.items():
        print_row(
            name,
            str(len(runs)),
            spread([run.learnt['states'] for run in runs], ','),
            spread([100 * run.learnt['accuracy'] for run in runs], '.1f', ' %'),
            *(spread([run.error_m(lane) for run in runs], '.4f', ' m') for lane in LANES),
            f'{sum(run.completes for run in runs)} of {len(runs)}',
        )
    print()
    print_row('scenario', 'seed', 'accuracy', 'outer', 'inner')
    print_row(*['---'] * 5)
    for name, runs in scenarios.items():
        for run in runs:
            accuracy = f'{100 * run.learnt["accuracy"]:.2f} %'
            print_row(name, str(run.seed), accuracy, *(run.told_m(lane) for lane in LANES))
    print()


if __name__ == '__main__':
    main()
