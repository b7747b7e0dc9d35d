"""Reaching for ROS only where it is asked for: all else must work where there is none."""

from __future__ import annotations

from collections.abc import Callable
import importlib
from typing import Any

from spikelane.executables import node_command, ROS_ADVICE
from spikelane_sim.errors import SpikelaneError


def over_ros(module: str, function: str, transport: str = 'ros') -> Callable[..., Any]:
    """Return a function of `spikelane.runs`.

    Args:
        module: Its module there.
        function: Its name.
        transport: Which transport is asked for, for the error.

    Raises:
        SpikelaneError: There is no ROS.
    """
    try:
        return getattr(importlib.import_module(f'spikelane.runs.{module}'), function)  # type: ignore[no-any-return]
    except ImportError as error:
        raise SpikelaneError(
            f'--transport {transport}: expected ROS 2 and the built workspace, got {error}: '
            f'{ROS_ADVICE}; --transport inprocess needs none'
        ) from None


def check_transport(transport: str, controller: str) -> None:
    """Check that there is what a run needs to be driven as it is to be.

    Args:
        transport: One of the transports of `spikelane.runs.configuration`.
        controller: What drives.

    Raises:
        SpikelaneError: There is no ROS, or a node is not installed.
    """
    if transport != 'inprocess':
        over_ros('lap.nodes.driving', 'drive_lap_over_ros', transport)
        for node in ('simulator', controller):
            node_command(node)
