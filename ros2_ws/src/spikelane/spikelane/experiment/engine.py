"""What does the runs of an experiment: processes here, or a cluster."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import os
from pathlib import Path
import shutil
import signal
import sys
from typing import NamedTuple, Protocol

from spikelane.experiment.worker import ALWAYS_IN_KERNEL, LOG, ONE_THREAD

_LAST_CHARACTERS = 4000
_FULL_BYTES = 1_000_000  # left at most on a disk that counts as full

#: A worker that was told to end puts things in order first, and says so as shells do.
_ENDED_BY_SIGNAL = (128 + signal.SIGINT, 128 + signal.SIGTERM)


class Ended(NamedTuple):
    """How a run's process ended.

    Attributes:
        name: Name of the run.
        status: 0 done; negative: killed by that signal, with no fault of its own.
        message: Why it failed, one line.
    """

    name: str
    status: int
    message: str


class Engine(Protocol):
    """Does runs, several at a time."""

    @property
    def slots(self) -> int:
        """How many processes there are at a time."""

    @property
    def busy(self) -> int:
        """How many processes are at work."""

    @property
    def does_together(self) -> bool:
        """Whether a process does several runs of one setting."""

    def start(self, runs: Mapping[str, Path]) -> None:
        """Begin to do runs in one process.

        Args:
            runs: Folders by the runs' names; several only if `does_together`.

        Raises:
            SpikelaneError: It cannot be begun.
        """

    def ended(self) -> Iterator[Ended]:
        """Yield the runs that have ended since they were last asked for."""

    def stop(self) -> None:
        """End all that runs, gently first; what they have saved stays."""


def worker_command(*folders: Path, is_in_kernel: bool = False) -> list[str]:
    """Return the command that does the runs in folders.

    Args:
        folders: Those of the runs.
        is_in_kernel: Whether the kernel is used wherever there is one, also for few steps.
    """
    options = [ALWAYS_IN_KERNEL] if is_in_kernel else []
    command = [sys.executable, '-m', 'spikelane.experiment.worker']
    return [*command, *options, *map(str, folders)]


def worker_environment(own: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of a run's process: ours, one thread, and modules where we have them.

    Args:
        own: Environment of this process.
    """
    path = os.pathsep.join(each for each in sys.path if each)
    return {**own, **ONE_THREAD, 'PYTHONPATH': path, 'PYTHONUNBUFFERED': '1'}


def ended_run(name: str, status: int, folder: Path) -> Ended:
    """Describe how a run's process ended, with the last line it said where it failed."""
    if status == 0:
        return Ended(name, 0, '')
    if status in _ENDED_BY_SIGNAL:
        status = 128 - status
    if status < 0:
        return Ended(name, status, f'killed by signal {-status}')
    try:
        text = (folder / LOG).read_text('utf-8', errors='replace')[-_LAST_CHARACTERS:]
    except OSError:
        text = ''
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return Ended(name, status, lines[-1] if lines else _silent(status, folder))


def _silent(status: int, folder: Path) -> str:
    """Say how a process ended that has left no reason, as on a full disk it cannot."""
    free = shutil.disk_usage(folder).free
    full = '' if free > _FULL_BYTES else f': {folder / LOG} is empty, {free:,} bytes of disk left'
    return f'ended with status {status}{full}'
