#!/usr/bin/env python3
"""Ships weights from what experiments/rstdp.yaml has left: of each scenario, the median seed's.

    source setup/env.sh; docs/results/rstdp_weights.py [runs/rstdp]

With the paper's camera and parameters; the seed is that whose last lane loss is the (lower)
median of seeds 0 to 9, so neither the best nor the worst.
"""

from __future__ import annotations

from pathlib import Path
import statistics
import sys

from tables import read_json

import spikelane_controllers
from spikelane_controllers.weights import export_weights

#: Seeds whose median is shipped.
SEEDS = range(10)

SHIPPED = Path(spikelane_controllers.__file__).parent / 'weights'


def main() -> None:
    """Write a file of weights for each scenario."""
    out = Path(sys.argv[1] if len(sys.argv) > 1 else 'runs/rstdp')
    for scenario in '123':
        paths = [out / f'train-rstdp-{scenario}-paper-seed{seed}' for seed in SEEDS]
        losses = {path: read_json(path / 'metrics.json')['last_lane_loss_step'] for path in paths}
        median = statistics.median_low(losses.values())
        path = next(path for path, loss in losses.items() if loss == median)
        metrics = read_json(path / 'metrics.json')
        command = (
            f'spikelane train rstdp --scenario {scenario} --seed {metrics["seed"]} '
            f'--steps {metrics["steps"]}'
        )
        file = SHIPPED / f'rstdp_scenario_{scenario}.safetensors'
        export_weights('rstdp', path, file, command)
        print(f'{file.name}: {command} (last lane loss {median}, of {len(paths)} seeds)')


if __name__ == '__main__':
    main()
