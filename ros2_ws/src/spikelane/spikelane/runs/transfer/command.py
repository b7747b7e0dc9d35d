"""`spikelane transfer`: the policy of a trained Q-network for a spiking network."""

from __future__ import annotations

import argparse
import json
from typing import Any

from spikelane.requirements import require
from spikelane.runs.arguments import add_configuration_arguments, given_parameters, request_of
from spikelane.runs.command import run_folder
from spikelane.runs.output import in_lines, status_line
from spikelane.runs.transfer.config import TransferConfig
from spikelane.runs.transfer.run import report_transfer, transfer
from spikelane_controllers.learning.gathering import GatheringParameters
from spikelane_controllers.registry import transfer_card, transfer_names

_SHOWN_TIMES = 200  # of each stage


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    names = transfer_names()
    parser.add_argument(
        '--controller',
        choices=names,
        default=names[0],
        help=f'controller that receives the trained policy (default: {names[0]})',
    )
    parser.add_argument(
        '--checkpoint',
        metavar='DIR',
        help='output folder of the training to transfer from, or a checkpoint in it '
        '(default: the weights shipped for the scenario)',
    )
    parser.add_argument(
        '--states',
        type=int,
        help='states to gather by driving with the trained policy '
        f'(default: {GatheringParameters.states})',
    )
    parser.add_argument(
        '--steps',
        type=int,
        help="training steps of the network (default: the value of 'transfer.steps')",
    )
    parser.add_argument(
        '--from-training',
        action=argparse.BooleanOptionalAction,
        help='also use the states that were visited in that training (default: yes if they are in '
        "the checkpoint's folder)",
    )
    add_configuration_arguments(parser, transport=None, out='runs/transfer-...')


def run(options: argparse.Namespace) -> int:
    """Transfer.

    Returns:
        0.

    Raises:
        SpikelaneError: An option is wrong, or something failed.
    """
    require([transfer_card(options.controller).requires])
    counts = {'gathering.states': options.states, 'transfer.steps': options.steps}
    given = {name: count for name, count in counts.items() if count is not None}
    asked = request_of(options, given | given_parameters(options))
    config = TransferConfig.make(asked, options.checkpoint, options.from_training)
    show = status_line(options.json)

    def show_stage(what: str, done: int, of: int) -> None:
        if done % max(of // _SHOWN_TIMES, 1) == 0 or done == of:
            show(f'{done:7d} of {of} {what} ' + '\n' * (done == of))

    with run_folder(options, config) as (folder, _):
        result = report_transfer(config, transfer(config, show_stage), folder)
    print(json.dumps(result) if options.json else _summary(result))
    return 0


def _summary(result: dict[str, Any]) -> str:
    """Return the results for people, one line each."""
    paper = result['paper_accuracy']
    compared = '' if paper is None else f' (paper: {paper:.2%})'
    parts = ', '.join(f'{number} {name}' for name, number in result['states_from'].items())
    shares = ', '.join(f'{share:.0%} {name}' for name, share in result['class_shares'].items())
    lines = {
        'accuracy': f'{result["accuracy"]:.2%} of {result["held_out_states"]} states held '
        f'out{compared}',
        'states': f'{result["states"]}: {parts}',
        'actions': shares,
        'checkpoint': result['checkpoint'],
        'figures': ', '.join(result['figures']),
    }
    return in_lines(lines)
