"""Child processes that live exactly as long as they should.

Each child has a process group of its own, default signal handlers and a log file. It is told to
end when its parent dies, however that happens, so that no node is ever left behind.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
import contextlib
import ctypes
import os
from pathlib import Path
import re
import signal
import subprocess
import time
from types import TracebackType
from typing import Literal

from spikelane.interruption import check
from spikelane_sim.errors import SpikelaneError

_PR_SET_PDEATHSIG = 1  # <linux/prctl.h>
_LIBC = ctypes.CDLL(None, use_errno=True)
_LAST_LINES = 5
_CAUSE = re.compile(r'\[(FATAL|ERROR)\]|^(\w+\.)*\w*(Error|Exception)\b')
_WAIT_S = 0.1  # between two looks whether a signal has come

#: Signals to end a child with, and how long it has to obey each [s].
_ENDINGS = ((signal.SIGINT, 10.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 3.0))


class ProcessError(SpikelaneError):
    """A child process ended when it should not have."""

    exit_status = 1


class Processes:
    """Starts children, notices when one ends, and ends them all."""

    def __init__(self, kept_open: Sequence[int] = ()) -> None:
        """Start with none.

        Args:
            kept_open: File descriptors that the children inherit.
        """
        self._kept_open = tuple(kept_open)
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._logs: dict[str, Path] = {}
        self._told: set[tuple[str, int]] = set()  # children, and the signals they were sent

    def __enter__(self) -> Processes:
        """Return the processes; leaving the block ends them."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> Literal[False]:
        """End what still runs."""
        self.stop(*self._children)
        return False

    def start(
        self, name: str, command: Sequence[str], log: Path, environment: Mapping[str, str]
    ) -> None:
        """Start a child.

        Args:
            name: To speak of it.
            command: Program and arguments.
            log: File its output goes to.
            environment: All of its environment variables.

        Raises:
            ProcessError: It cannot be started.
        """
        parent = os.getpid()
        try:
            log.parent.mkdir(parents=True, exist_ok=True)
            with log.open('wb') as output:
                child = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    env=dict(environment),
                    start_new_session=True,
                    preexec_fn=lambda: end_with(parent),
                    pass_fds=self._kept_open,
                )
        except OSError as error:
            raise ProcessError(f'{name}: cannot be started: {error}') from None
        self._children[name], self._logs[name] = child, log

    def check(self, may_end: Collection[str] = ()) -> None:
        """Check that all children run, but those that may end.

        Raises:
            ProcessError: One has ended; the message has its last lines.
        """
        for name in self._children:
            if name not in may_end:
                self._check(name)

    def wait(self, name: str, timeout_s: float) -> None:
        """Wait until a child ends by itself.

        Raises:
            ProcessError: It takes longer, or ends with an error.
            Interrupted: A signal has come.
        """
        deadline_s = time.monotonic() + timeout_s
        while time.monotonic() < deadline_s:
            check()
            with contextlib.suppress(subprocess.TimeoutExpired):
                if self._children[name].wait(_WAIT_S) == 0:
                    return
                self._check(name)
        raise ProcessError(f'{name}: expected it to end within {timeout_s:g} s, it still runs')

    def stop(self, *names: str) -> None:
        """End children, all at once, the gentle way first.

        Args:
            names: Names of children; those that have ended already, or could not be started, are
                passed over.
        """
        children = {name: self._children[name] for name in names if name in self._children}
        for how, patience_s in _ENDINGS:
            running = {name: child for name, child in children.items() if child.poll() is None}
            for name, child in running.items():
                self._told.add((name, how))
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(child.pid, how)
            deadline_s = time.monotonic() + patience_s
            for child in running.values():
                with contextlib.suppress(subprocess.TimeoutExpired):
                    child.wait(max(0.0, deadline_s - time.monotonic()))

    def check_endings(self) -> None:
        """Check that no child has ended with an error.

        One that `stop` has sent signal n may end with 128 + n.

        Raises:
            ProcessError: Some have; the message has the last lines of each.
        """
        wrong = [
            self._ending(name, status)
            for name, status in self.statuses().items()
            if status and (name, status - 128) not in self._told
        ]
        if wrong:
            raise ProcessError('; '.join(wrong))

    def statuses(self) -> dict[str, int | None]:
        """Return each child's exit status, None where it runs."""
        return {name: child.poll() for name, child in self._children.items()}

    def _check(self, name: str) -> None:
        status = self._children[name].poll()
        if status is not None:
            raise ProcessError(self._ending(name, status))

    def _ending(self, name: str, status: int) -> str:
        """Return how a child has ended, and why."""
        lines = self._logs[name].read_text(errors='replace').splitlines()
        number = -status if status < 0 else status - 128
        if number not in set(signal.Signals):
            return f'{name} ended with status {status}: {_cause_first(lines)}'
        ended = f'{name} ended with status {status} ({signal.Signals(number).name})'
        # What has started handles these signals, and says something.
        is_starting = status < 0 or not lines
        if is_starting and number in (signal.SIGINT, signal.SIGTERM):
            return f'{ended} while it was starting'
        return f'{ended}: {_cause_first(lines)}'


def _cause_first(lines: Sequence[str]) -> str:
    """Return the reason that a log ends with, and after it the lines around it."""
    last = list(lines[-_LAST_LINES:])
    if not last:
        return 'it said nothing'
    # Nodes log a reason before they end; a crash of Python's has it in the last line.
    causes = [line for line in last if _CAUSE.search(line)]
    cause = causes[0] if causes else last[-1]
    last.remove(cause)
    return f'{cause} (log: {" | ".join(last)})' if last else cause


def end_with(parent: int) -> None:
    """End this process when its parent ends, even where that is killed.

    A new child calls it before it runs its program. SIGINT and SIGTERM get their default actions.

    Args:
        parent: Process id of the parent.
    """
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGTERM})
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it died before it could be watched
        os._exit(1)
