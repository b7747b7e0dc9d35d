"""`spikelane train`: a controller learns by driving."""

from __future__ import annotations

import argparse
import json
import time
from typing import Any

from spikelane.commands.arguments import add_configuration_arguments, given_parameters, progress
from spikelane.lap import Show
from spikelane.lock import locked
from spikelane.run_folder import RunFolder, RUNS
from spikelane.training import (
    make_config,
    report_training,
    train,
    TrainConfig,
)
from spikelane.transport import over_ros
from spikelane_controllers.registry import training_class, training_names
from spikelane_controllers.training import Training
from spikelane_sim.errors import CheckpointChoiceError, ParameterError


def _usual_steps() -> str:
    """Return what --steps are and how many are usual, in words."""
    rstdp, dqn = (training_class(name).parameters_class.steps for name in ('rstdp', 'dqn'))
    return (
        f'steps to drive: for rstdp of 50 ms each (default: {rstdp}), for dqn of one action, '
        f'10 times as long, each (default: {dqn})'
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('controller', choices=training_names(), help='what learns')
    parser.add_argument('--steps', type=int, help=_usual_steps())
    parser.add_argument(
        '--device',
        choices=('cpu', 'cuda'),
        help='where the Q-network learns, for dqn (default: cpu)',
    )
    parser.add_argument(
        '--resume',
        action='store_true',
        help='go on with the training in the folder, stopped or done',
    )
    add_configuration_arguments(parser, transport='inprocess', out='runs/train-...')


def run(options: argparse.Namespace) -> int:
    """Train.

    Returns:
        0.

    Raises:
        SpikelaneError: An option is wrong, or something failed.
    """
    config = make_config(
        options.scenario,
        options.controller,
        options.seed,
        options.transport,
        given_parameters(options) | _device(options),
        options.steps,
    )
    folder = _folder(config, options)
    with locked(folder.path):
        start_s = time.monotonic()
        with progress(options.json) as show:
            training = _train(config, folder, show, options.resume)
        if options.resume:  # perhaps for more steps than before
            folder.write_config(config.to_dict())
        wall_time_s = None if options.resume else time.monotonic() - start_s
        result = report_training(config, training, folder, wall_time_s)
    print(json.dumps(result) if options.json else _summary(result))
    return 0


def _device(options: argparse.Namespace) -> dict[str, str]:
    """Return the parameter that a given device is."""
    if options.device is None:
        return {}
    if options.controller != 'dqn':
        raise ParameterError(f'--device: expected the controller dqn, got {options.controller}')
    return {'dqn.q_learning.device': options.device}


def _folder(config: TrainConfig, options: argparse.Namespace) -> RunFolder:
    if not options.resume:
        return RunFolder.begin(config, options.out)
    folder = RunFolder(options.out or RUNS / config.usual_name)
    if not folder.checkpoint.exists():
        raise CheckpointChoiceError(f'{folder.checkpoint}: expected a checkpoint, got none')
    return folder


def _train(config: TrainConfig, folder: RunFolder, show: Show, resume: bool) -> Training:
    if config.transport == 'inprocess':
        return train(config, folder, show, resume=resume)
    training: Training = over_ros('training', 'train_over_ros')(
        config, folder, show, resume=resume
    )
    return training


def _summary(result: dict[str, Any]) -> str:
    """Return the results for people, one line each."""
    lines = {
        'steps': f'{result["steps"]}',
        'lane lost': f'{result["lane_losses"]} times, the last at step '
        f'{result["last_lane_loss_step"]}{"" if result["settled"] else " (not settled)"}',
        **(_full_episodes(result) if result['controller'] == 'dqn' else _laps(result)),
        'checkpoint': result['checkpoint'],
        'figures': ', '.join(result['figures']),
    }
    return '\n'.join(f'{name:15} {value}' for name, value in lines.items())


def _laps(result: dict[str, Any]) -> dict[str, str]:
    laps = ', '.join(f'{count} {lane}' for lane, count in result['laps_since'].items())
    return {'laps since': laps or 'none'}


def _full_episodes(result: dict[str, Any]) -> dict[str, str]:
    solved = 'no three in a row on both lanes'
    if result['solved_at'] is not None:
        solved = f'three in a row on both lanes from step {result["solved_at"]}'
    return {'full episodes': f'{result["full_episodes"]}, {solved}'}
