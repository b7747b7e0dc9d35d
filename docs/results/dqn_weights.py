#!/usr/bin/env python3
"""Ships weights from what dqn.sh and dqn_snn.sh have left: of each scenario, the median seed's.

    source setup/env.sh; docs/results/dqn_weights.py DQN DQN_SNN

With the paper's settings; the seed is that whose Q-network has the (lower) median error on the
outer lane, of those that complete both lanes and have been transferred: neither the best nor the
worst.
"""

from __future__ import annotations

from pathlib import Path
import statistics
import sys

from tables import read_json

import spikelane_controllers
from spikelane_controllers.transferred import export_transferred
from spikelane_controllers.weights import export_weights

SHIPPED = Path(spikelane_controllers.__file__).parent / 'weights'
LANES = ('outer', 'inner')


def main() -> None:
    """Write two files of weights for each scenario."""
    if len(sys.argv) != 3:
        sys.exit('usage: dqn_weights.py DQN DQN_SNN')
    dqn, dqn_snn = map(Path, sys.argv[1:])
    for folder in sorted(dqn.glob('?')):
        transfers = dqn_snn / 'paper' / folder.name
        errors = dict(outer_errors_m(folder, transfers))
        if not errors:
            continue
        median = statistics.median_low(errors.values())
        seed = next(seed for seed, error in errors.items() if error == median)
        run = read_json(folder / f'{seed}.train.json')
        trained = (
            f'spikelane train dqn --scenario {folder.name} --seed {seed} --steps {run["steps"]}'
        )
        name = f'scenario_{folder.name}.safetensors'
        export_weights('dqn', folder / seed, SHIPPED / f'dqn_{name}', trained)
        print(f'dqn_{name}: {trained} (error {median:.4f} m, of {len(errors)} seeds)')
        transferred = (  # from where the training's command leaves it
            f'spikelane transfer --checkpoint runs/train-dqn-{folder.name}-seed{seed} '
            f'--scenario {folder.name} --seed {seed}'
        )
        export_transferred(transfers / seed, SHIPPED / f'dqn_snn_{name}', transferred)
        print(f'dqn_snn_{name}: {transferred}')


def outer_errors_m(folder: Path, transfers: Path) -> list[tuple[str, float]]:
    """Return seeds and errors on the outer lane of Q-networks that can be shipped."""
    found = []
    for file in sorted(folder.glob('*.train.json')):
        seed = file.name.split('.')[0]
        outer, inner = (read_json(folder / f'{seed}.{lane}.json') for lane in LANES)
        is_transferred = (transfers / f'{seed}.transfer.json').exists()
        if outer.get('completed') and inner.get('completed') and is_transferred:
            found.append((seed, float(outer['mean_abs_distance_m'])))
    return found


if __name__ == '__main__':
    main()
