"""How every Spikelane node runs: one error line for a wrong start, a quiet end on a signal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import signal
import sys
from typing import Protocol

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from spikelane_sim.errors import SpikelaneError


class RunnableNode(Protocol):
    """A node that says how its process ends."""

    exit_status: int

    def destroy_node(self) -> None:
        """Release what the node holds."""


def run_node(make_node: Callable[[], Node], arguments: Sequence[str] | None = None) -> int:
    """Make a node, spin it until a signal or its own shutdown, and return the exit status.

    Returns:
        0, or what the node has as `exit_status`, or 2 where it could not be made.
    """
    rclpy.init(args=arguments)
    node = None
    try:
        node = make_node()
        rclpy.spin(node)
    except SpikelaneError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        # A second Ctrl-C must not cut the clean-up short.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return int(getattr(node, 'exit_status', 0))
