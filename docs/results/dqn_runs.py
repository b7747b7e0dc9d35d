"""What `spikelane reproduce` has left of deep Q-learning and its transfers."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from tables import read_json

LANES = ('outer', 'inner')

#: The settings of experiments/paper.yaml that a policy is transferred with.
VARIANTS = {'paper': "the paper's settings", 'best': 'the best settings found'}

_TASKS = {'dqn': 'train', 'dqn_snn': 'transfer'}


class Learnt(NamedTuple):
    """What a seed's training or transfer came to, and the laps driven after it."""

    seed: int
    folder: Path
    metrics: dict[str, Any]  # of the training or transfer
    laps: dict[str, dict[str, Any]]  # by lane

    @property
    def completes(self) -> bool:
        """Whether a lap of each lane was completed."""
        return all(lap['completed'] for lap in self.laps.values())

    def error_m(self, lane: str) -> float | None:
        """Mean distance from the lane's centre in a completed lap."""
        lap = self.laps[lane]
        return float(lap['mean_abs_distance_m']) if lap['completed'] else None

    def told_m(self, lane: str) -> str:
        """Return the error, or how far the robot came."""
        error_m = self.error_m(lane)
        if error_m is None:
            return f'lost after {self.laps[lane]["progress_m"]:.1f} m'
        return f'{error_m:.4f} m'


def read_learnt(folder: Path, controller: str, variant: str) -> dict[str, list[Learnt]]:
    """Read the finished runs of a controller by scenario; those without laps are left out."""
    found: dict[str, list[Learnt]] = {}
    for path in folder.glob(f'{_TASKS[controller]}-{controller}-?-{variant}-seed*'):
        # As an experiment names its runs: TASK-CONTROLLER-SCENARIO-VARIANT-seedSEED.
        _, place = path.name.split(f'-{controller}-')
        driven = folder / f'evaluate-{controller}-{place}' / 'metrics.json'
        if driven.exists():
            scenario, _, seed = place.split('-')
            laps = {lap['lane']: lap for lap in read_json(driven)['laps']}
            metrics = read_json(path / 'metrics.json')
            learnt = Learnt(int(seed.removeprefix('seed')), path, metrics, laps)
            found.setdefault(scenario, []).append(learnt)
    return {
        scenario: sorted(found[scenario], key=lambda each: each.seed) for scenario in sorted(found)
    }
