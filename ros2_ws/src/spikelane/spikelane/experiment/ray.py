"""Runs on a cluster: Ray places each on a machine, where a process of its own does it.

That process is the same as on one machine, so the results are. The experiment's folder must be
one that all machines see under the same path, and Spikelane be installed on each.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import os
from pathlib import Path
import signal
import socket
import time
from typing import Any

from spikelane.experiment.engine import (
    Ended,
    ended_run,
    worker_command,
    worker_environment,
)
from spikelane.experiment.worker import LOG
from spikelane.interruption import handlers_kept
from spikelane.processes import Processes
from spikelane_sim.errors import SpikelaneError

_POLL_S = 0.1
_END_S = 20.0  # for processes to end when they are told to
_CONNECT_S = 10.0  # for a cluster to accept a connection

_ANY = 'auto'  # the cluster of this machine, as Ray says it
_CLIENT = 'ray://'


class RayEngine:
    """Gives runs to a Ray cluster; an `Engine`."""

    def __init__(self, address: str | None, jobs: int | None) -> None:
        """Join a cluster, or begin one on this machine that lets in nobody else.

        Args:
            address: Address of the cluster, as Ray has it; its token, where it wants one, is in
                the environment as Ray has it (RAY_AUTH_TOKEN). None for a cluster of our own.
            jobs: Runs at a time; None for as many as the cluster has processors.

        Raises:
            SpikelaneError: Ray is not installed, or there is no such cluster.
        """
        if address is not None:
            _check_address(address)
        with handlers_kept():  # Ray would end the process on SIGTERM with a status of its own
            self._ray = _import_ray()
            self._join(address, jobs)
        self._slots = jobs or max(1, int(self._ray.cluster_resources().get('CPU', 1)))
        # No retries of Ray's own: the experiment counts and reports them.
        self._do = self._ray.remote(num_cpus=1, max_retries=0)(do_in_process)
        self._running: dict[Any, tuple[str, Path]] = {}

    def _join(self, address: str | None, jobs: int | None) -> None:
        try:
            if address is None:
                os.environ.setdefault('RAY_USAGE_STATS_ENABLED', '0')  # nobody is told of it
                self._ray.init(
                    'local',  # else it would join whatever cluster this machine has
                    num_cpus=jobs or os.cpu_count(),
                    include_dashboard=False,
                    log_to_driver=False,
                    logging_level='error',
                    _node_ip_address='127.0.0.1',
                )
            else:
                self._ray.init(address, log_to_driver=False, logging_level='error')
        except Exception as error:
            # Ray raises whatever it meets, from OSError to bare Exception.
            lines = str(error).strip().splitlines() or [type(error).__name__]
            raise SpikelaneError(
                f'--engine ray: expected a Ray cluster at {address or "this machine"}, got: '
                f'{lines[0]}'
            ) from None

    @property
    def slots(self) -> int:
        """How many runs there are at a time."""
        return self._slots

    @property
    def busy(self) -> int:
        """How many runs are on the cluster."""
        return len(self._running)

    @property
    def does_together(self) -> bool:
        """Each run has a process of its own."""
        return False

    def start(self, runs: Mapping[str, Path]) -> None:
        """Give a run to the cluster; see `Engine`."""
        ((name, folder),) = runs.items()
        reference = self._do.remote(str(folder.absolute()), os.getcwd())
        self._running[reference] = (name, folder)

    def ended(self) -> Iterator[Ended]:
        """Yield what has ended; see `Engine`."""
        if not self._running:
            return
        references = list(self._running)
        done, _ = self._ray.wait(references, num_returns=len(references), timeout=0)
        for reference in done:
            name, folder = self._running.pop(reference)
            yield self._ended(reference, name, folder)

    def stop(self) -> None:
        """End what runs, and leave the cluster; see `Engine`."""
        for reference in self._running:
            # Its process is told to end when the one that watches it is gone.
            self._ray.cancel(reference, force=True)
        if self._running:
            references = list(self._running)
            self._ray.wait(references, num_returns=len(references), timeout=_END_S)
        self._running.clear()
        self._ray.shutdown()

    def _ended(self, reference: Any, name: str, folder: Path) -> Ended:
        errors = self._ray.exceptions
        try:
            return ended_run(name, self._ray.get(reference), folder)
        except (errors.WorkerCrashedError, errors.NodeDiedError, errors.OutOfMemoryError):
            return Ended(name, -signal.SIGKILL, "the cluster's worker was killed")
        except errors.RayError as error:
            lines = str(error).strip().splitlines() or [type(error).__name__]
            return Ended(name, 1, lines[-1])


def _check_address(address: str) -> None:
    """Check that somebody listens at an address, which Ray would try for minutes.

    Raises:
        SpikelaneError: It is no address, or nobody does.
    """
    if address == _ANY:
        return
    host, colon, port = address.removeprefix(_CLIENT).rpartition(':')
    if not (host and colon and port.isdecimal() and 0 < int(port) < 2**16):
        raise SpikelaneError(
            f'--address: expected HOST:PORT, {_CLIENT}HOST:PORT or {_ANY}, got {address!r}'
        )
    try:
        socket.create_connection((host.strip('[]'), int(port)), _CONNECT_S).close()
    except OSError as error:
        why = error.strerror or str(error)
        raise SpikelaneError(
            f'--address: expected a Ray cluster at {address}, got: {why}'
        ) from None


def do_in_process(folder: str, directory: str) -> int:
    """Do a run, on the cluster's side.

    Args:
        folder: The run's.
        directory: To run in, where paths that are not absolute begin.

    Returns:
        The exit status of its process.

    Raises:
        ProcessError: It cannot be started.
    """
    if Path(directory).is_dir():
        os.chdir(directory)
    with Processes() as processes:
        environment = worker_environment(os.environ)
        processes.start('run', worker_command(Path(folder)), Path(folder) / LOG, environment)
        while (status := processes.statuses()['run']) is None:
            time.sleep(_POLL_S)
    return status


def _import_ray() -> Any:
    try:
        import ray
        import ray.exceptions
    except ImportError:
        raise SpikelaneError(
            "--engine ray: expected Ray, which is not installed: pip install 'spikelane[ray]'"
        ) from None
    return ray
