#!/usr/bin/env python3
"""Ships weights from what `spikelane reproduce` has left: of each scenario, the median seed's.

    source setup/env.sh; docs/results/dqn_weights.py [runs/paper]

With the paper's settings; the seed is that whose Q-network has the (lower) median error on the
outer lane, of those that complete both lanes: neither the best nor the worst.
"""

from __future__ import annotations

from pathlib import Path
import statistics
import sys

from dqn_runs import read_learnt

import spikelane_controllers
from spikelane_controllers.dqn_snn.transferred import export_transferred
from spikelane_controllers.weights import export_weights

SHIPPED = Path(spikelane_controllers.__file__).parent / 'weights'


def main() -> None:
    """Write two files of weights for each scenario."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else 'runs/paper')
    transfers = read_learnt(folder, 'dqn_snn', 'paper')
    for scenario, runs in read_learnt(folder, 'dqn', 'paper').items():
        errors_m = {run.seed: run.error_m('outer') for run in runs if run.completes}
        median_m = statistics.median_low(list(filter(None, errors_m.values())))
        learnt = next(run for run in runs if errors_m.get(run.seed) == median_m)
        seed, name = learnt.seed, f'scenario_{scenario}.safetensors'
        trained = (
            f'spikelane train dqn --scenario {scenario} --seed {seed} '
            f'--steps {learnt.metrics["steps"]}'
        )
        export_weights('dqn', learnt.folder, SHIPPED / f'dqn_{name}', trained)
        print(f'dqn_{name}: {trained} (error {median_m:.4f} m, of {len(errors_m)} seeds)')
        transfer = next(run for run in transfers[scenario] if run.seed == seed)
        states = transfer.metrics['states_from']['gathered']
        transferred = (  # from where the training's command leaves it
            f'spikelane transfer --checkpoint runs/train-dqn-{scenario}-seed{seed} '
            f'--scenario {scenario} --seed {seed} --states {states}'
        )
        export_transferred(transfer.folder, SHIPPED / f'dqn_snn_{name}', transferred)
        print(f'dqn_snn_{name}: {transferred}')


if __name__ == '__main__':
    main()
