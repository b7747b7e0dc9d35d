"""`spikelane node`: run one node, as `ros2 run` does where it is installed."""

from __future__ import annotations

import argparse
import os

from spikelane.executables import executables, node_command
from spikelane.interruption import hand_over


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('node', metavar='NODE', help=f'one of {", ".join(executables())}')
    parser.add_argument(
        'arguments',
        nargs=argparse.REMAINDER,
        metavar='...',
        help='arguments for the node: --ros-args -p NAME:=VALUE, --params-file FILE, -r FROM:=TO',
    )


def run(options: argparse.Namespace) -> int:
    """Become the node.

    Raises:
        SpikelaneError: There is no such node.
    """
    command = node_command(options.node)
    hand_over()
    os.execv(command[0], [*command, *options.arguments])
