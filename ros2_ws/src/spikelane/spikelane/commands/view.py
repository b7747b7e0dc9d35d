"""`spikelane view`: show in the browser what a robot does, or did in a recorded bag."""

from __future__ import annotations

import argparse
import json
import math
import os
from pathlib import Path
import signal
import sys
import time
from typing import Any

from spikelane.bag.drive import RecordedDrive
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
from spikelane.viewer.server import BAG_MEMORY_MB, GRPC_PORT, ViewerServer, WEB_PORT
from spikelane_controllers.registry import controller_names, training_card, training_names
from spikelane_sim.errors import ParameterError

_CHECK_PERIOD_S = 0.2
_SENDING_S = 120.0  # until all of a bag is sent


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.epilog = (
        'Without BAG and --controller it shows the nodes that run, those of --domain and '
        '--namespace. A bag can be played, paused and sought in; it needs no ROS.'
    )
    parser.add_argument(
        'bag',
        nargs='?',
        type=Path,
        metavar='BAG',
        help="show a recorded drive or a real event camera's recording: a bag's folder, one of "
        'its files, or the folder of a recorded lap',
    )
    parser.add_argument(
        '--events',
        metavar='TOPIC',
        help="topic of a bag's event packets (default: /event_camera/events, or the only one)",
    )
    parser.add_argument(
        '--start',
        type=float,
        metavar='S',
        help='show a bag from this time on, in seconds after its first step (default: 0)',
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
    parser.set_defaults(scenario=None)  # a bag says its own


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
    if options.bag is not None:
        return _show_bag(options)
    if options.events is not None or options.start is not None:
        raise ParameterError('--events, --start: expected together with a bag')
    options.scenario = options.scenario or '1'
    if not options.controller:
        return _become_viewer(options)
    if options.train and (options.checkpoint or options.lane):
        raise ParameterError('--checkpoint, --lane: expected no --train together with them')
    if options.domain is not None or options.namespace:
        raise ParameterError('--domain, --namespace: expected no --controller together with them')
    if options.transport == 'inprocess':
        raise ParameterError('--transport: expected ros or composed, got inprocess')
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
                _wait(server)
    except Interrupted as interrupted:
        if interrupted.number != signal.SIGINT:
            raise
    return 0


def _wait(server: ViewerServer) -> None:
    """Wait for Ctrl-C, while the page is looked at."""
    print('all of it can be played there again; Ctrl-C ends', file=sys.stderr)
    while True:
        server.check()
        time.sleep(_CHECK_PERIOD_S)


def _show_bag(options: argparse.Namespace) -> int:
    """Show a recorded drive."""
    from spikelane.viewer.playback import bag_of, play
    from spikelane.viewer.scene import connect, Scene

    for name in ('controller', 'train', 'checkpoint', 'lane', 'domain', 'namespace', 'steps'):
        if getattr(options, name):
            raise ParameterError(f'--{name}: expected no bag together with it')
    start_s = options.start or 0.0
    if not 0.0 <= start_s < math.inf:
        raise ParameterError(f'--start: expected seconds from 0 on, got {start_s}')
    drive = RecordedDrive(bag_of(options.bag), options.events)
    try:
        with ViewerServer(options.port, options.data_port, BAG_MEMORY_MB) as server:
            print(f'open {server.url} in a browser', file=sys.stderr)
            scene = Scene(connect(server.address), is_recorded=True)
            try:
                played = play(drive, scene, scenario=options.scenario, start_s=start_s)
            finally:
                scene.close(_SENDING_S)
            for note in played.notes:
                print(f'{options.bag}: {note}', file=sys.stderr)
            result = {'bag': str(options.bag), **played._asdict()}
            print(
                json.dumps(result)
                if options.json
                else f'bag: {options.bag}, {played.steps} steps, {played.duration_s:.1f} s',
                flush=True,
            )
            if not options.once:
                _wait(server)
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
