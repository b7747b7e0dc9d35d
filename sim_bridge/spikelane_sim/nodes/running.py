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
    try:
        rclpy.init(args=arguments)
    except RuntimeError as error:  # of several kinds: arguments or a parameter file it cannot read
        return _refuse(' '.join(str(error).split()))
    node = None
    try:
        node = make_node()
        rclpy.spin(node)
    except SpikelaneError as error:
        return _refuse(str(error))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except Exception:
        if rclpy.ok():
            raise
        # A signal came in the middle of something that needs the middleware.
    finally:
        # A second Ctrl-C must not cut the clean-up short.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return int(getattr(node, 'exit_status', 0))


def _refuse(reason: str) -> int:
    print(f'error: {reason}', file=sys.stderr)
    return 2
