#!/usr/bin/env python3
"""Prints the tables of docs/results/rstdp.md from what docs/results/rstdp.sh has left.

source setup/env.sh; docs/results/rstdp_table.py OUT
"""

from __future__ import annotations

from pathlib import Path
import sys
from typing import Any, NamedTuple

from tables import print_row, read_json, spread

from spikelane.figures.weights import weights_correlation
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.weights import WEIGHTS

LANES = ('outer', 'inner')
SETTINGS = {
    'paper': "The paper's camera",
    'best': 'The best camera setting',
    'reward': "The paper's camera, three times the paper's reward (`rstdp.c_r` 0.03)",
}


class Run(NamedTuple):
    """A training, and the laps driven with what it learnt."""

    seed: int
    training: dict[str, Any]
    laps: dict[str, dict[str, Any]]  # by lane; empty where they are not driven yet
    correlation: float | None  # of the weights with the Braitenberg controller's

    @property
    def last_loss(self) -> int:
        """Step of the last episode that ended with the lane lost."""
        return int(self.training['last_lane_loss_step'])

    @property
    def has_settled(self) -> bool:
        """Whether both lanes were lapped after it."""
        return all(self.training['laps_since'].get(lane) for lane in LANES)

    @property
    def completes(self) -> bool:
        """Whether both lanes were driven three times in a row with learning off."""
        return all(self.error_m(lane) is not None for lane in LANES)

    def error_m(self, lane: str) -> float | None:
        """Mean distance from the lane's centre in three laps in a row, None without."""
        lap = self.laps[lane]
        return float(lap['mean_abs_distance_m']) if lap.get('laps') == 3 else None


def main() -> None:
    """Print a table for each setting."""
    if len(sys.argv) != 2:
        sys.exit('usage: rstdp_table.py OUT')
    out = Path(sys.argv[1])
    for setting, title in SETTINGS.items():
        scenarios = {path.name: read_runs(path) for path in sorted(out.glob(f'{setting}/?'))}
        scenarios = {name: runs for name, runs in scenarios.items() if runs}
        if scenarios:
            print(f'### {title}\n')
            print_summary(scenarios)
            print_seeds(scenarios)


def read_runs(folder: Path) -> list[Run]:
    """Read the runs of a setting and a scenario, by seed."""
    runs = []
    for path in sorted(folder.glob('*.train.json')):
        seed = path.name.split('.')[0]
        laps = {lane: read_json(folder / f'{seed}.{lane}.json') for lane in LANES}
        arrays = read_checkpoint(folder / seed, 'rstdp').arrays
        correlation = weights_correlation(arrays[WEIGHTS], arrays['training.weight_history'][0])
        runs.append(Run(int(seed), read_json(path), laps, correlation['overall']))
    return runs


def print_summary(scenarios: dict[str, list[Run]]) -> None:
    """Print a row for each scenario: median, smallest and largest of its seeds."""
    print(
        '| scenario | seeds | steps | last lane loss | mean error, outer | mean error, inner | ',
        end='',
    )
    print('both lanes 3 times in a row | correlation with Braitenberg |')
    print('|---|---|---|---|---|---|---|---|')
    for name, runs in scenarios.items():
        driven = [run for run in runs if all(run.laps.values())]
        losses = spread([run.last_loss for run in runs], ',')
        errors = [spread([run.error_m(lane) for run in driven], '.4f', ' m') for lane in LANES]
        complete = f'{sum(run.completes for run in driven)} of {len(driven)}'
        correlation = spread([run.correlation for run in runs], '.2f')
        steps = f'{runs[0].training["steps"]:,}'
        row = (name, str(len(runs)), steps, losses, *errors, complete, correlation)
        print_row(*row)
    print()


def print_seeds(scenarios: dict[str, list[Run]]) -> None:
    """Print every seed's last lane loss; `*` where no lap of both lanes came after it."""
    for name, runs in scenarios.items():
        losses = (
            f'{run.seed}: {run.last_loss:,}{"" if run.has_settled else " *"}' for run in runs
        )
        print(f'Scenario {name}, last lane loss by seed: {", ".join(losses)}.')
        failed = [str(run.seed) for run in runs if all(run.laps.values()) and not run.completes]
        if failed:
            print(f'Scenario {name}, lane lost with learning off: seeds {", ".join(failed)}.')
    print()


if __name__ == '__main__':
    main()
