"""How every Spikelane node runs: one error line for a wrong start, a quiet end on a signal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import contextlib
import signal
import sys
from typing import Protocol

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from spikelane_sim.errors import SpikelaneError

_LOOK_EVERY_S = 0.5  # whether a signal came


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
        with _signals_held_back():
            # rclpy's own handler shuts down; a KeyboardInterrupt could come amid anything.
            signal.signal(signal.SIGINT, lambda number, frame: None)
            rclpy.init(args=arguments)
            executor = SingleThreadedExecutor()
    except RuntimeError as error:  # of several kinds: arguments or a parameter file it cannot read
        return _refuse(' '.join(str(error).split()))
    node = None
    try:
        node = make_node()
        _warn_of_unknown_parameters(node)
        executor.add_node(node)
        while rclpy.ok():
            # rclpy wakes the executor before it shuts down: one that is quick to look finds
            # nothing changed, and would wait for ever.
            executor.spin_once(timeout_sec=_LOOK_EVERY_S)
    except SpikelaneError as error:
        return _refuse(str(error))
    except ExternalShutdownException:
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


def _warn_of_unknown_parameters(node: Node) -> None:
    """Name the parameters given that the node does not have, as rclpy ignores them in silence.

    They are no error: one file may be meant for several nodes.
    """
    unknown = [name for name in node._parameter_overrides if not node.has_parameter(name)]
    if unknown:
        node.get_logger().warning(
            f'{", ".join(unknown)}: expected parameters of {node.get_name()}; ignored'
        )


@contextlib.contextmanager
def _signals_held_back() -> Iterator[None]:
    """Let SIGINT and SIGTERM come only when the block is left.

    An executor whose making a signal cuts short says so in a traceback when it is collected. No
    thread but this one, to which they could go, is there yet.
    """
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _refuse(reason: str) -> int:
    print(f'error: {reason}', file=sys.stderr)
    return 2
