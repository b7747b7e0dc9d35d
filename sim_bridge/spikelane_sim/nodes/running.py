"""How every Spikelane node runs: one error line for a wrong start, a quiet end on a signal.

A node that receives a signal to end drives no further, and waits until its published messages have
arrived. The middleware detects lost messages only at its next heartbeat, after some seconds. If
the node is gone by then, they are lost, and a recording would lack the end of a drive.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import contextlib
import os
import signal
import socket
import sys
import threading
import time
from types import TracebackType
from typing import Protocol

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from spikelane_sim.errors import SpikelaneError
from spikelane_sim.nodes.given_parameters import warn_of_unused_parameters
from spikelane_sim.nodes.network import network_variables

_LOOK_EVERY_S = 0.5  # whether the middleware was shut down
_DELIVERY_S = 8.0  # without our profile Fast DDS has 3 s between heartbeats; it may need two
_DELIVERY_PERIOD_S = 0.01
_GRACE_S = 2.0  # for a node that is being made when a signal comes
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_OF_OTHERS = signal.SIGTERM  # what nodes are ended with when another one of the process ends


class RunnableNode(Protocol):
    """A node that says how its process ends.

    A node may also have `halt(number)`: called in another thread when signal `number` has come, it
    stops whatever the node does by itself, at once, and sets `exit_status` to 128 + number where
    that cuts something short. A node that has `is_done` ends by itself, once that is true and what
    it has published has arrived.
    """

    exit_status: int

    def destroy_node(self) -> None:
        """Release what the node holds."""


def run_node(make_node: Callable[[], Node], arguments: Sequence[str] | None = None) -> int:
    """Make a node, spin it until a signal or its own shutdown, and return the exit status.

    Returns:
        What the node has as `exit_status`; 2 where it could not be made; 128 + n where signal n
        came before it was.
    """
    return run_nodes((make_node,), arguments)


def run_nodes(makers: Sequence[Callable[[], Node]], arguments: Sequence[str] | None = None) -> int:
    """Run nodes in one process as `run_node` does one; when one ends, the others are ended.

    Args:
        makers: Make the nodes, in this order.
        arguments: Command-line arguments; None for those of the process.

    Returns:
        As `run_node`; of several nodes, the first status that is not 0.
    """
    try:
        os.environ |= network_variables(os.environ)
        with _signals_held_back():
            ending = _Ending()
            # rclpy's own handlers would shut down before what was published has arrived, and a
            # KeyboardInterrupt could come at any point.
            rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
            executor = SingleThreadedExecutor()
    except SpikelaneError as error:
        return _refuse(str(error))
    except RuntimeError as error:  # of several kinds: arguments or a parameter file it cannot read
        return _refuse(' '.join(str(error).split()))
    nodes: list[Node] = []
    with ending:
        try:
            for make_node in makers:
                nodes.append(make_node())
            ending.nodes = tuple(nodes)
            for node in nodes:
                warn_of_unused_parameters(node, sys.argv if arguments is None else arguments)
                executor.add_node(node)
            while rclpy.ok():
                # rclpy wakes the executor before it shuts down: one that is quick to look finds
                # nothing changed, and would wait for ever.
                executor.spin_once(timeout_sec=_LOOK_EVERY_S)
                if any(map(_is_done, nodes)):
                    ending.end()
        except SpikelaneError as error:
            # One that comes after a signal says only that the middleware was shut down.
            if rclpy.ok() or not ending.number:
                return _refuse(str(error))
        except ExternalShutdownException:
            pass
        except Exception:
            if rclpy.ok():
                raise
            # A signal came in the middle of something that needs the middleware.
        finally:
            # A second Ctrl-C must not cut the clean-up short.
            for number in _SIGNALS:
                signal.signal(number, signal.SIG_IGN)
            for node in nodes:
                node.destroy_node()
            rclpy.try_shutdown()
    if len(nodes) < len(makers):
        return 128 + ending.number
    return next(filter(None, map(ending.status, nodes)), 0)


def _is_done(node: Node) -> bool:
    return bool(getattr(node, 'is_done', False))


class _Ending:
    """Waits in a thread for a signal, then shuts the middleware down; a second one hurries it.

    Attributes:
        nodes: Whose messages are to arrive before; none where they are still being made.
        number: Number of the signal that came; 0 where none has.
    """

    def __init__(self) -> None:
        """Take over SIGINT and SIGTERM, in the main thread."""
        self.nodes: tuple[Node, ...] = ()
        self._ended: tuple[Node, ...] = ()  # as another one had nothing more to do
        self.number = 0
        # Python's own handlers run in the main thread alone, which may be amid a long wait; the
        # signals' numbers are written here at once.
        self._told, teller = socket.socketpair()
        teller.setblocking(False)
        self._teller = teller
        self._is_asked = False
        signal.set_wakeup_fd(teller.fileno(), warn_on_full_buffer=False)
        for number in _SIGNALS:
            signal.signal(number, lambda number, frame: None)
        self._thread = threading.Thread(target=self._run, daemon=True)

    def end(self) -> None:
        """End without a signal, as the node has nothing more to do."""
        if not (self._is_asked or self.number):  # a second byte would hurry it
            self._is_asked = True
            self._teller.send(bytes(1))

    def __enter__(self) -> None:
        """Begin to wait."""
        self._thread.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop waiting."""
        signal.set_wakeup_fd(-1)
        self._teller.close()  # which the thread is told of
        self._thread.join()
        self._told.close()

    def _run(self) -> None:
        number = self._told.recv(1)
        if not number:
            return
        self.number = number[0]
        nodes = self.nodes
        if not self.number:
            self._ended = tuple(node for node in nodes if not _is_done(node))
        for node in nodes if self.number else self._ended:
            with contextlib.suppress(RuntimeError):  # it ends by itself meanwhile
                getattr(node, 'halt', lambda number: None)(self.number or _OF_OTHERS)
        for node in nodes:
            self._deliver(node)
        rclpy.try_shutdown()
        if not nodes:
            self._end_start()

    def status(self, node: Node) -> int:
        """Return the exit status of a node; one that was ended for another one may say so."""
        status = int(getattr(node, 'exit_status', 0))
        return 0 if node in self._ended and status == 128 + _OF_OTHERS else status

    def _end_start(self) -> None:
        """End the process where the node is still being made after a moment.

        Compiled kernels are made or loaded then, for up to a minute on a busy machine, and do not
        ask the middleware whether it was shut down.
        """
        self._told.settimeout(_GRACE_S)
        with contextlib.suppress(TimeoutError):
            if not self._told.recv(1):
                return  # the start was over by itself
        if not self.nodes:
            os._exit(128 + self.number)

    def _deliver(self, node: Node) -> None:
        """Wait until all reliable subscribers have received all messages, or until a time-out."""
        deadline_s = time.monotonic() + _DELIVERY_S
        self._told.settimeout(_DELIVERY_PERIOD_S)
        with contextlib.suppress(RuntimeError):  # it ends by itself meanwhile
            for publisher in list(node.publishers):
                while not publisher.wait_for_all_acked(Duration()):
                    if time.monotonic() > deadline_s or self._is_told():
                        return

    def _is_told(self) -> bool:
        """Return whether a second signal came, or the node has ended, after a moment."""
        try:
            self._told.recv(1)
        except TimeoutError:
            return False
        return True


@contextlib.contextmanager
def _signals_held_back() -> Iterator[None]:
    """Let SIGINT and SIGTERM come only when the block is left.

    An executor whose making a signal cuts short says so in a traceback when it is collected. No
    thread but this one, to which they could go, is there yet.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)


def _refuse(reason: str) -> int:
    print(f'error: {reason}', file=sys.stderr)
    return 2
