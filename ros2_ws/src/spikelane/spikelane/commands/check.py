"""`spikelane check`: tests a controller against the whole contract."""

from __future__ import annotations

import argparse
import json

from spikelane.check import check
from spikelane.runs.arguments import add_parameter_arguments, parse_parameters
from spikelane.runs.configuration import TRANSPORTS
from spikelane_controllers.registry import controller_names, usual_controller


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('controller', choices=controller_names(), help='controller to test')
    parser.add_argument(
        '--transport',
        default='inprocess',
        choices=TRANSPORTS,
        help='ros: also drive and train over ROS, with its node; composed: with its node in the '
        'process of the simulator (default: inprocess)',
    )
    add_parameter_arguments(parser, example=f'{usual_controller()}.steering.v_max=2.0')
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(options: argparse.Namespace) -> int:
    """Test the controller.

    Returns:
        0 where it keeps the contract, otherwise 1.

    Raises:
        SpikelaneError: An option is wrong, or there is no ROS where it is asked for.
    """
    violations = check(options.controller, options.transport, parse_parameters(options.param))
    result = {
        'controller': options.controller,
        'transport': options.transport,
        'passed': not violations,
        'violations': violations,
    }
    if options.json:
        print(json.dumps(result))
    else:
        print('\n'.join(violations) or f'{options.controller}: no violation of the contract')
    return 1 if violations else 0
