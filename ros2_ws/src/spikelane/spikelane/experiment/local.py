"""Runs as processes of this machine, each of one run or of a fleet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import os
from pathlib import Path

from spikelane.experiment.engine import (
    Ended,
    ended_run,
    worker_command,
    worker_environment,
)
from spikelane.experiment.worker import LOG
from spikelane.processes import Processes
from spikelane.runs.folder import RunFolder


class LocalEngine:
    """Starts processes that do a run each, or several together; an `Engine`.

    Every process has one thread: what a run does outside the kernel, as its checkpoints and
    figures, could not be shared among threads.
    """

    def __init__(
        self, jobs: int, *, does_together: bool = False, is_in_kernel: bool = False
    ) -> None:
        """Begin without processes.

        Args:
            jobs: How many processes there are at a time.
            does_together: Whether a process does several runs of one setting.
            is_in_kernel: As of `worker_command`.
        """
        self._is_in_kernel = is_in_kernel
        self._jobs = jobs
        self._does_together = does_together
        self._processes = Processes()
        self._running: dict[str, Mapping[str, Path]] = {}  # by the first of a process's runs

    @property
    def slots(self) -> int:
        """How many processes there are at a time."""
        return self._jobs

    @property
    def busy(self) -> int:
        """How many processes are at work."""
        return len(self._running)

    @property
    def does_together(self) -> bool:
        """Whether a process does several runs of one setting."""
        return self._does_together

    def start(self, runs: Mapping[str, Path]) -> None:
        """Start a process; see `Engine`."""
        environment = worker_environment(os.environ)
        name, folder = next(iter(runs.items()))
        command = worker_command(*runs.values(), is_in_kernel=self._is_in_kernel)
        self._processes.start(name, command, folder / LOG, environment)
        self._running[name] = dict(runs)

    def ended(self) -> Iterator[Ended]:
        """Yield what has ended; see `Engine`."""
        for name, status in self._processes.statuses().items():
            if name in self._running and status is not None:
                runs = self._running.pop(name)
                for run, folder in runs.items():
                    # Some runs of a process can be finished although another one failed.
                    is_done = len(runs) > 1 and RunFolder(folder).metrics.exists()
                    yield ended_run(run, 0 if is_done else status, folder)

    def stop(self) -> None:
        """End all processes; see `Engine`."""
        self._processes.stop(*self._running)
        self._running.clear()
