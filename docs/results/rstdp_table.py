#!/usr/bin/env python3
"""Prints the tables of docs/results/rstdp.md from what experiments/rstdp.yaml has left.

source setup/env.sh; docs/results/rstdp_table.py [runs/rstdp]
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import sys
from typing import Any, NamedTuple

from tables import print_row, read_json, share_in_words, verdict

from spikelane.report.quantities import COUNT, METRES, Quantity
from spikelane.statistics import mean_statistics, time_statistics
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.learning.settling import has_settled, last_lane_loss_step
from spikelane_controllers.learning.training import Termination

LANES = ('outer', 'inner')
SETTINGS = {
    'paper': "The paper's camera",
    'best': 'The best camera setting',
    'c_r_0.03': "The paper's camera, three times the paper's reward (`rstdp.c_r` 0.03)",
}

#: Aims for the median last lane loss [steps] and the mean error on the outer lane [m].
AIMS = {
    'paper': {'1': (9_000, 0.007), '2': (18_000, 0.007), '3': (70_000, 0.010)},
    'best': {'1': (2_500, None), '2': (2_500, None), '3': (12_000, None)},
}

#: A lap that strays farther from its lane's centre is no success [m]: trainings are reset there.
#: The drive itself ends at 0.5 m only.
STRAYED_M = 0.2

_CORRELATION = Quantity('.2f', low=-1.0, high=1.0)


class Run(NamedTuple):
    """A training, and the laps driven with what it learnt."""

    seed: int
    training: dict[str, Any]
    terminations: list[Termination]
    laps: list[dict[str, Any]]  # with learning off; none where they are not driven yet

    @property
    def last_loss(self) -> int:
        """Step of the last episode that ended with the lane lost."""
        return last_lane_loss_step(self.terminations)

    @property
    def has_settled(self) -> bool:
        """Whether both lanes were lapped after it."""
        return has_settled(self.terminations)

    @property
    def succeeds(self) -> bool:
        """Whether every lap with learning off was kept in its lane."""
        return all(map(is_kept, self.laps))

    def error_m(self, lane: str) -> float | None:
        """Mean distance from the lane's centre over the laps kept in a lane."""
        errors_m = [
            float(lap['mean_abs_distance_m'])
            for lap in self.laps
            if lap['lane'] == lane and is_kept(lap)
        ]
        return sum(errors_m) / len(errors_m) if errors_m else None


def is_kept(lap: dict[str, Any]) -> bool:
    """Return whether a lap was completed and never left its lane."""
    return bool(lap['completed']) and float(lap['max_abs_distance_m']) <= STRAYED_M


def main() -> None:
    """Print the tables of each setting."""
    out = Path(sys.argv[1] if len(sys.argv) > 1 else 'runs/rstdp')
    for setting, title in SETTINGS.items():
        scenarios = {name: read_runs(out, name, setting) for name in '123'}
        scenarios = {name: runs for name, runs in scenarios.items() if runs}
        if scenarios:
            print(f'## {title}\n')
            print_summary(scenarios)
            if setting in AIMS:
                print_aims(AIMS[setting], scenarios)
            print_seeds(scenarios)


def read_runs(out: Path, scenario: str, setting: str) -> list[Run]:
    """Read the finished trainings of a scenario and setting, by seed."""
    runs = []
    for path in out.glob(f'train-rstdp-{scenario}-{setting}-seed*'):
        seed = int(path.name.rpartition('seed')[2])
        driven = out / path.name.replace('train-', 'evaluate-', 1) / 'metrics.json'
        if training := read_json(path / 'metrics.json'):
            facts = read_checkpoint(path, 'rstdp').facts
            ends = [Termination(*each) for each in facts['terminations']]
            runs.append(Run(seed, training, ends, read_json(driven).get('laps', [])))
    return sorted(runs, key=lambda run: run.seed)


def print_summary(scenarios: dict[str, list[Run]]) -> None:
    """Print a row for each scenario."""
    print_row(
        *('scenario', 'seeds', 'steps', 'settled', 'last lane loss', 'median, 95 %'),
        *('successful', 'correlation with Braitenberg'),
    )
    print_row(*['---'] * 8)
    for name, runs in scenarios.items():
        driven = [run for run in runs if run.laps]
        correlations = [run.training['braitenberg_correlation']['overall'] for run in runs]
        print_row(
            *(name, str(len(runs)), f'{runs[0].training["steps"]:,}'),
            f'{sum(run.has_settled for run in runs)}',
            COUNT.median(*times(runs)),
            COUNT.median_interval(*times(runs)),
            share_in_words(sum(run.succeeds for run in driven), len(driven)) if driven else '—',
            _CORRELATION.median(correlations),
        )
    print()
    print_row('scenario', 'lane', 'laps kept', 'mean error ± s (95 %)', 'median (range)')
    print_row(*['---'] * 5)
    for name, runs in scenarios.items():
        for lane in LANES:
            laps = [lap for run in runs for lap in run.laps if lap['lane'] == lane]
            errors_m = known_errors_m(runs, lane)
            print_row(
                *(name, lane, f'{sum(map(is_kept, laps))} of {len(laps)}'),
                *(METRES.mean(errors_m), METRES.median(errors_m)),
            )
    print()


def times(runs: Sequence[Run]) -> tuple[list[int], list[bool]]:
    """Return last lane losses, and which are of trainings that have settled."""
    return [run.last_loss for run in runs], [run.has_settled for run in runs]


def known_errors_m(runs: Sequence[Run], lane: str) -> list[float]:
    """Return the error of each training that kept a lap of a lane."""
    return [error_m for run in runs if (error_m := run.error_m(lane)) is not None]


def print_aims(aims: dict[str, tuple[int, float | None]], scenarios: dict[str, list[Run]]) -> None:
    """Print what the intervals say of the aims."""
    print_row('scenario', 'measure', 'aim', '95 %', 'aim reached?')
    print_row(*['---'] * 5)
    for name, runs in scenarios.items():
        step, error_m = aims[name]
        print_row(
            *(name, 'median last lane loss', f'≤ {step:,}', COUNT.median_interval(*times(runs))),
            verdict(time_statistics(*times(runs)), step),
        )
        if error_m is not None:
            found = mean_statistics(known_errors_m(runs, 'outer'), low=0.0)
            ends = (found or {}).get('ci_low'), (found or {}).get('ci_high')
            interval = '—' if None in ends else f'{ends[0]:.4f} to {ends[1]:.4f} m'
            print_row(
                *(name, 'mean error, outer lane', f'≤ {error_m} m', interval),
                verdict(found, error_m),
            )
    print()


def print_seeds(scenarios: dict[str, list[Run]]) -> None:
    """Print every seed's last lane loss; `*` where it has not settled after it."""
    for name, runs in scenarios.items():
        losses = (
            f'{run.seed}: {run.last_loss:,}{"" if run.has_settled else " *"}' for run in runs
        )
        print(f'Scenario {name}, last lane loss by seed: {", ".join(losses)}.')
        for run in runs:
            lost = [
                f'{lap["lane"]} with seed {lap["seed"]}' for lap in run.laps if not is_kept(lap)
            ]
            if lost:
                print(f'Lane left with learning off, training of seed {run.seed}: ', end='')
                print(f'{", ".join(lost)}.')
    print()


if __name__ == '__main__':
    main()
