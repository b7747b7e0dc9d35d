#!/usr/bin/env python3
"""Ships weights from what an experiment has left: of each scenario, those of the median seed.

    source setup/env.sh; docs/results/ship_weights.py runs/rstdp    # R-STDP
    source setup/env.sh; docs/results/ship_weights.py runs/paper    # DQN and DQN-SNN

They are of the variant `paper`. The seed of R-STDP is the one whose last lane loss is the (lower)
median of seeds 0 to 9, and that of the Q-network the one with the (lower) median error on the
outer lane, of those that complete both lanes: neither the best nor the worst. The network with
spikes is the one that took over this Q-network's policy.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import sys

from spikelane.report.collect import collect
from spikelane.report.comparisons import median_run
from spikelane.report.groups import by_key
from spikelane.report.runs import Runs, TrainingRun
from spikelane_controllers.dqn_snn.transferred import export_transferred
from spikelane_controllers.registry import card
from spikelane_controllers.weights import export_weights

VARIANT = 'paper'


def main() -> None:
    """Write a file of weights for each controller and scenario."""
    if len(sys.argv) != 2:
        sys.exit('usage: ship_weights.py RUNS')
    runs = collect([Path(sys.argv[1])])
    trainings = [run for run in runs.trainings if runs.variants.get(run.folder) == VARIANT]
    for (controller, scenario, _), group in by_key(trainings).items():
        run = _median(runs, group) if controller == 'dqn' else _median_of_ten(group)
        command = (
            f'spikelane train {controller} --scenario {scenario} --seed {run.seed} '
            f'--steps {run.results.steps}'
        )
        export_weights(controller, run.folder, _file(controller, scenario), command)
        print(f'{_file(controller, scenario)}: {command}')
        _ship_transfers(runs, run)


def _median_of_ten(group: Sequence[TrainingRun]) -> TrainingRun:
    """Return the training of median last lane loss."""
    return median_run([run for run in group if run.seed < 10], lambda run: run.results.sort_key())


def _median(runs: Runs, group: Sequence[TrainingRun]) -> TrainingRun:
    """Return the training of median error, of those that complete both lanes."""
    errors_m = {}
    for run in group:
        laps = [lap.metrics for lap in runs.laps if Path(lap.training).name == run.folder.name]
        outer = [lap['mean_abs_distance_m'] for lap in laps if lap['lane'] == 'outer']
        if laps and all(lap['completed'] for lap in laps):
            errors_m[run.seed] = float(outer[0])
    done = [run for run in group if run.seed in errors_m]
    return median_run(done, lambda run: errors_m[run.seed])


def _ship_transfers(runs: Runs, run: TrainingRun) -> None:
    """Ship what took over a training's policy."""
    for transfer in runs.transfers:
        is_of_it = Path(transfer.config['checkpoint']).name == run.folder.name
        if is_of_it and runs.variants.get(transfer.folder) == VARIANT:
            scenario, seed = transfer.scenario, transfer.seed
            trained = f'runs/train-{run.controller}-{scenario}-seed{seed}'
            states = transfer.metrics['states_from']['gathered']
            command = (  # from where the training's command leaves it
                f'spikelane transfer --checkpoint {trained} --scenario {scenario} '
                f'--seed {seed} --states {states}'
            )
            file = _file(transfer.controller, scenario)
            export_transferred(transfer.folder, file, command)
            print(f'{file}: {command}')


def _file(controller: str, scenario: str) -> Path:
    folder = card(controller).weights
    assert folder is not None  # of each controller whose weights are shipped
    return folder / f'scenario_{scenario}.safetensors'


if __name__ == '__main__':
    main()
