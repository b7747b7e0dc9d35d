"""`spikelane train`: a controller learns by driving."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from spikelane.recording.record import parse_names
from spikelane.requirements import require
from spikelane.runs.arguments import (
    add_configuration_arguments,
    add_record_argument,
    given_parameters,
    request_of,
)
from spikelane.runs.command import run_folder
from spikelane.runs.output import in_lines
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import check_training_recordable, train_and_report
from spikelane_controllers.learning.results import FinishedRun
from spikelane_controllers.registry import (
    training_card,
    training_class,
    training_names,
    training_results,
)
from spikelane_sim.errors import ParameterError


def _usual_steps() -> str:
    """Return what --steps are and how many are usual, in words."""
    each = '; '.join(
        f'{name}: {training_results(name).step_words}, '
        f'default {training_class(name).parameters_class.steps}'
        for name in training_names()
    )
    return f'steps to drive; the meaning of a step depends on the controller ({each})'


def _devices() -> str:
    """Return the names of the controllers that take --device."""
    return ', '.join(name for name in training_names() if training_card(name).device)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('controller', choices=training_names(), help='controller to train')
    parser.add_argument('--steps', type=int, help=_usual_steps())
    parser.add_argument(
        '--device',
        choices=('cpu', 'cuda'),
        help=f'device to train on; only for {_devices()} (default: cpu)',
    )
    parser.add_argument(
        '--resume',
        action='store_true',
        help='resume the training in the folder, whether it was interrupted or completed',
    )
    add_record_argument(parser)
    add_configuration_arguments(parser, transport='inprocess', out='runs/train-...')


def run(options: argparse.Namespace) -> int:
    """Train.

    Returns:
        0.

    Raises:
        SpikelaneError: An option is wrong, or something failed.
    """
    require([training_card(options.controller).requires])
    asked = request_of(options, given_parameters(options) | _device(options))
    config = TrainConfig.make(asked, options.steps)
    record = parse_names(options.record)
    check_training_recordable(config, record, resume=options.resume)
    with run_folder(options, config) as (folder, show):
        result = train_and_report(config, folder, show, resume=options.resume, record=record)
        if options.resume:  # perhaps for more steps than before
            folder.write_config(config, options.command_line)
    print(json.dumps(result) if options.json else _summary(config, result))
    return 0


def _device(options: argparse.Namespace) -> dict[str, str]:
    """Return the parameter that a given device is."""
    if options.device is None:
        return {}
    parameter = training_card(options.controller).device
    if not parameter:
        raise ParameterError(
            f'--device: expected a controller that can choose one ({_devices()}), '
            f'got {options.controller}'
        )
    return {f'{options.controller}.{parameter}': options.device}


def _summary(config: TrainConfig, result: dict[str, Any]) -> str:
    """Return the results for people, one line each."""
    run = FinishedRun(config.controller, Path(result['folder']), config.to_dict(), result)
    lines = {
        'steps': f'{result["steps"]}',
        'lane lost': f'{result["lane_losses"]} times, the last at step '
        f'{result["last_lane_loss_step"]}{"" if result["settled"] else " (not settled)"}',
        **training_results(config.controller)(run).summary(),
        'checkpoint': result['checkpoint'],
        'figures': ', '.join(result['figures']),
        **({'recording': result['recording']} if 'recording' in result else {}),
    }
    return in_lines(lines)
