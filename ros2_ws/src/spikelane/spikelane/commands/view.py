"""`spikelane view`: show in the browser what a robot does."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from typing import Any

from spikelane.executables import find_executable, node_command
from spikelane.interruption import hand_over, Interrupted
from spikelane.requirements import require
from spikelane.runs.arguments import (
    add_configuration_arguments,
    given_parameters,
    given_weights,
    request_of,
)
from spikelane.runs.command import run_folder
from spikelane.runs.configuration import check_number
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.run import drive, report_lap
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import train_and_report
from spikelane.viewer.server import GRPC_PORT, ViewerServer, WEB_PORT
from spikelane_controllers.registry import controller_names, training_card, training_names
from spikelane_sim.errors import ParameterError

_CHECK_PERIOD_S = 0.2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.epilog = (
        'Without --controller it shows the nodes that run, those of --domain and --namespace.'
    )
    parser.add_argument(
        '--controller',
        choices=controller_names(),
        help='drive a lap with this controller, recorded as by `spikelane lap` '
        '(default: drive nothing)',
    )
    parser.add_argument(
        '--checkpoint',
        metavar='DIR',
        help='weights of a controller that learns, as for `spikelane lap`',
    )
    parser.add_argument('--lane', help="outer or inner (default: the course's first, outer)")
    parser.add_argument(
        '--train', action='store_true', help='let the controller learn instead of driving a lap'
    )
    parser.add_argument(
        '--steps',
        type=int,
        help='training steps, as for `spikelane train` (default: the same as there)',
    )
    parser.add_argument(
        '--once', action='store_true', help='end when the robot has driven, not on Ctrl-C'
    )
    parser.add_argument(
        '--domain', type=int, help='ROS domain of the nodes (default: that of ROS)'
    )
    parser.add_argument('--namespace', default='', help='namespace of the nodes, such as /robot_1')
    parser.add_argument(
        '--port',
        type=int,
        default=WEB_PORT,
        help=f'port of the page; 0: any (default: {WEB_PORT})',
    )
    parser.add_argument(
        '--data-port',
        type=int,
        default=GRPC_PORT,
        help=f'port of the data that the page shows; 0: any (default: {GRPC_PORT})',
    )
    add_configuration_arguments(parser, out='runs/lap-... or runs/train-...')


def run(options: argparse.Namespace) -> int:
    """Show what runs, or drive and show.

    Returns:
        0, also where Ctrl-C ends it, as that is its usual end.

    Raises:
        SpikelaneError: An option is wrong, or something failed.
    """
    if options.steps is not None and not options.train:
        raise ParameterError('--steps: expected together with --train')
    check_number('--port', options.port, 0, 65_535)
    check_number('--data-port', options.data_port, 0, 65_535)
    check_number('--domain', options.domain, 0, 232)
    if not options.controller:
        return _become_viewer(options)
    if options.train and (options.checkpoint or options.lane):
        raise ParameterError('--checkpoint, --lane: expected no --train together with them')
    if options.domain is not None or options.namespace:
        raise ParameterError('--domain, --namespace: expected no --controller together with them')
    if options.transport != 'ros':
        raise ParameterError(f'--transport: expected ros, got {options.transport}')
    for node in ('viewer', 'simulator', options.controller):
        node_command(node)
    if options.train:
        if options.controller not in training_names():
            expected = ', '.join(training_names())
            raise ParameterError(f'--train: expected one of {expected}, got {options.controller}')
        require([training_card(options.controller).requires])
    try:
        with ViewerServer(options.port, options.data_port) as server:
            print(f'open {server.url} in a browser', file=sys.stderr)
            result = _drive(options, server)
            said = json.dumps(result) if options.json else f'results: {result["folder"]}'
            print(said, flush=True)
            if not options.once:
                print('all of it can be played there again; Ctrl-C ends', file=sys.stderr)
                while True:
                    server.check()
                    time.sleep(_CHECK_PERIOD_S)
    except Interrupted as interrupted:
        if interrupted.number != signal.SIGINT:
            raise
    return 0


def _become_viewer(options: argparse.Namespace) -> int:
    """Become the node, which prints the address."""
    if options.train or options.checkpoint or options.once:
        raise ParameterError('--train, --checkpoint, --once: expected --controller, too')
    executable = str(find_executable('viewer'))
    command = [executable, '--ros-args']
    command += ['-p', f'web_port:={options.port}', '-p', f'grpc_port:={options.data_port}']
    if options.namespace:
        command += ['-r', f'__ns:={options.namespace}']
    environment = dict(os.environ)
    if options.domain is not None:
        environment['ROS_DOMAIN_ID'] = str(options.domain)
    hand_over()
    # What this process handles is forgotten by the new program, what it ignores is not.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.stdout.flush()
    os.execve(executable, command, environment)


def _drive(options: argparse.Namespace, server: ViewerServer) -> dict[str, Any]:
    """Let the robot drive or learn before the viewer's eyes; return the results."""
    viewer = {'server': server.address}
    if options.train:
        training = TrainConfig.make(request_of(options, given_parameters(options)), options.steps)
        with run_folder(options, training) as (folder, show):
            return train_and_report(training, folder, show, resume=False, viewer=viewer)
    asked = request_of(options, given_parameters(options) | given_weights(options))
    lap = LapConfig.make(asked, options.lane)
    with run_folder(options, lap) as (folder, show):
        return report_lap(lap, drive(lap, folder, show, viewer), folder)
