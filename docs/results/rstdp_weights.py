#!/usr/bin/env python3
"""Ships weights from what docs/results/rstdp.sh has left: of each scenario, the median seed's.

    source setup/env.sh; docs/results/rstdp_weights.py OUT

With the paper's camera and parameters; the seed is that whose last lane loss is the (lower)
median, so neither the best nor the worst.
"""

from __future__ import annotations

import json
from pathlib import Path
import statistics
import sys

import spikelane_controllers
from spikelane_controllers.weights import export_weights

SHIPPED = Path(spikelane_controllers.__file__).parent / 'weights'


def main() -> None:
    """Write a file of weights for each scenario."""
    if len(sys.argv) != 2:
        sys.exit('usage: rstdp_weights.py OUT')
    for folder in sorted(Path(sys.argv[1]).glob('paper/?')):
        runs = [json.loads(path.read_text()) for path in sorted(folder.glob('*.train.json'))]
        if not runs:
            continue
        median = statistics.median_low(run['last_lane_loss_step'] for run in runs)
        run = next(run for run in runs if run['last_lane_loss_step'] == median)
        command = (
            f'spikelane train rstdp --scenario {run["scenario"]} --seed {run["seed"]} '
            f'--steps {run["steps"]}'
        )
        path = SHIPPED / f'rstdp_scenario_{run["scenario"]}.safetensors'
        export_weights('rstdp', folder / str(run['seed']), path, command)
        print(f'{path.name}: {command} (last lane loss {median}, of {len(runs)} seeds)')


if __name__ == '__main__':
    main()
