"""Runs as processes of this machine."""

from __future__ import annotations

from collections.abc import Iterator
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


class LocalEngine:
    """Starts a process for every run; an `Engine`."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._processes = Processes()
        self._running: dict[str, Path] = {}

    @property
    def slots(self) -> int:
        """How many processes there are at a time."""
        return self._jobs

    def start(self, name: str, folder: Path) -> None:
        """Start a process; see `Engine`."""
        environment = worker_environment(os.environ)
        self._processes.start(name, worker_command(folder), folder / LOG, environment)
        self._running[name] = folder

    def ended(self) -> Iterator[Ended]:
        """Yield what has ended; see `Engine`."""
        for name, status in self._processes.statuses().items():
            if name in self._running and status is not None:
                yield ended_run(name, status, self._running.pop(name))

    def stop(self) -> None:
        """End all processes; see `Engine`."""
        self._processes.stop(*self._running)
        self._running.clear()
