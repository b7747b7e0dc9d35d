"""SIGINT and SIGTERM end a command between two steps, never in the middle of one.

A signal handler that raises does so wherever the interpreter happens to be. Within a compiled
kernel, a C++ conversion or an import the exception is lost or comes out as another one. Here a
signal is only noted. Loops call `check` between two steps, which raises `Interrupted`, so that
everything is put in order on the way out.

A phase without such a loop (imports, figures) is ended after `GRACE_S` by a thread, at once and
without clean-up. That loses nothing that a kill would not: files are written whole, the kernel
releases locks, and it tells child processes to end (`spikelane.processes`).

A loop whose way out leaves something that a kill would lose, as a recording, is in a block of
`checking`. There the thread waits up to `LOOP_GRACE_S`, since on a busy machine or a slow disk a
single step can take longer than `GRACE_S`.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
import signal
import socket
import threading
import time
from typing import Any

#: The signals that end a command.
SIGNALS = (signal.SIGINT, signal.SIGTERM)

#: Longest time from a signal to the next `check` [s].
GRACE_S = 2.0

#: The same within a block of `checking` [s].
LOOP_GRACE_S = 60.0

_POLL_S = 0.05

_noted: list[int] = []
_taken = threading.Event()
_loops: list[None] = []  # one for each block of `checking` that has been entered


class Interrupted(BaseException):
    """A signal asked the command to end.

    Attributes:
        number: Number of the signal.
    """

    def __init__(self, number: int) -> None:
        """Say which signal it was."""
        super().__init__(f'ended by {signal.Signals(number).name}')
        self.number = number

    @property
    def exit_status(self) -> int:
        """Exit status of a command ended by this signal, as shells have it: 128 + n."""
        return 128 + self.number


def check() -> None:
    """Raise `Interrupted` where a signal has come; loops call it between two steps.

    It raises once: the clean-up on the way out is not interrupted by a second signal.

    Raises:
        Interrupted: A signal has come since the last call.
    """
    if _noted and not _taken.is_set():
        _taken.set()
        raise Interrupted(_noted[0])


@contextlib.contextmanager
def signals_noted(*, are_ignored_afterwards: bool = False) -> Iterator[None]:
    """Note SIGINT and SIGTERM within the block instead of what they do otherwise.

    A signal that the process was started to ignore stays ignored. Used in the main thread only.

    Args:
        are_ignored_afterwards: Whether a signal after the block is ignored, since the work is
            done then; otherwise it does what it did before the block.
    """
    handlers = {
        number: handler
        for number in SIGNALS
        if (handler := signal.getsignal(number)) is not signal.SIG_IGN
    }
    _noted.clear()
    _taken.clear()
    told, teller = socket.socketpair()
    teller.setblocking(False)
    # Python's handlers run between two bytecodes of the main thread. The signal's number is
    # written to this socket at once.
    descriptor_before = signal.set_wakeup_fd(teller.fileno(), warn_on_full_buffer=False)
    for number in handlers:
        signal.signal(number, _note)
    thread = threading.Thread(target=_watch, args=(told,), daemon=True)
    thread.start()
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, signal.SIG_IGN if are_ignored_afterwards else handler)
        signal.set_wakeup_fd(descriptor_before)
        _taken.set()  # the thread has nothing to end any more
        teller.close()
        thread.join()
        told.close()


@contextlib.contextmanager
def checking() -> Iterator[None]:
    """Say that the block calls `check` again and again, and leaves something on its way out.

    A signal waits up to `LOOP_GRACE_S` for the next call.
    """
    _loops.append(None)
    try:
        yield
    finally:
        _loops.pop()


@contextlib.contextmanager
def handlers_kept() -> Iterator[None]:
    """Keep the handlers of SIGINT and SIGTERM through a call that would replace them."""
    handlers: dict[int, Any] = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def hand_over() -> None:
    """Prepare for another program in this process: from now on a signal ends the process.

    It does so once the program lets signals come, as `spikelane_sim_entry.take_signals` does: one
    that came while Python starts would show a traceback.

    Raises:
        Interrupted: A signal has come already.
    """
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    check()
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)


def _note(number: int, frame: object) -> None:
    del frame
    _noted.append(number)


def _watch(told: socket.socket) -> None:
    """Wait for a signal, and end the process where nothing takes note of it in time."""
    while content := told.recv(1):
        number = content[0]
        if number not in SIGNALS:
            continue
        # The main thread may be amid a long call in C, where its handler cannot run.
        _noted.append(number)
        latest_s = time.monotonic() + LOOP_GRACE_S - GRACE_S
        while _loops and time.monotonic() < latest_s and not _taken.wait(_POLL_S):
            pass
        if not _taken.wait(GRACE_S):
            os._exit(128 + number)
        return
