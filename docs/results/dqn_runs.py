"""What `spikelane reproduce` has left of deep Q-learning and its transfers."""

from __future__ import annotations

import json
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
    runs = json.loads((folder / 'results.json').read_text('utf-8'))['runs']
    own = [
        run
        for run in runs
        if (run['controller'], run.get('variants')) == (controller, variant)
        and run['state'] in ('done', 'found')
    ]
    driven = {
        (run['scenario'], run['seed']): read_json(folder / run['folder'] / 'metrics.json')['laps']
        for run in own
        if run['task'] == 'evaluate'
    }
    found: dict[str, list[Learnt]] = {}
    for run in own:
        laps = driven.get((run['scenario'], run['seed']))
        if run['task'] == _TASKS[controller] and laps is not None:
            path = folder / run['folder']
            by_lane = {lap['lane']: lap for lap in laps}
            learnt = Learnt(run['seed'], path, read_json(path / 'metrics.json'), by_lane)
            found.setdefault(run['scenario'], []).append(learnt)
    return {
        scenario: sorted(found[scenario], key=lambda each: each.seed) for scenario in sorted(found)
    }
