"""Rerun's server: keeps what was shown, and serves it and the page to browsers of this machine.

It is a process of its own, as Rerun's library can serve on all network interfaces only. Nothing
but this machine reaches it.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
from pathlib import Path
import socket
import tempfile
import time
from types import TracebackType
from typing import Literal
from urllib.parse import urlencode

from spikelane import interruption
from spikelane.processes import ProcessError, Processes
from spikelane_sim.errors import SpikelaneError

HOST = '127.0.0.1'
WEB_PORT = 9090  # Rerun's own
GRPC_PORT = 9876
MEMORY_MB = 512
BAG_MEMORY_MB = 2048  # more than `playback.MOST_BYTES`

_NAME = 'rerun'
_START_DEADLINE_S = 60.0
_POLL_S = 0.05


class ViewerError(SpikelaneError):
    """What shows things in the browser is not there, or cannot be started."""

    exit_status = 1


class ViewerServer:
    """The server; use it as a context manager.

    Attributes:
        url: Address of the page that shows everything, for a browser.
        address: Where `Scene` sends to.
    """

    def __init__(
        self,
        web_port: int = WEB_PORT,
        grpc_port: int = GRPC_PORT,
        memory_mb: int = MEMORY_MB,
    ) -> None:
        """Find free ports.

        Args:
            web_port: Port of the page; 0: any that is free.
            grpc_port: Port of what is shown; 0: any that is free.
            memory_mb: The oldest is forgotten beyond this [MB].

        Raises:
            ViewerError: A port is in use.
        """
        self._memory_mb = memory_mb
        # Both at the same time, as they must differ.
        with _bound('web_port', web_port) as web, _bound('grpc_port', grpc_port) as grpc:
            self._web_port, self._grpc_port = web, grpc
        self.address = f'rerun+http://{HOST}:{self._grpc_port}/proxy'
        self.url = f'http://{HOST}:{self._web_port}?{urlencode({"url": self.address})}'
        self._processes = Processes()
        self._folder = tempfile.TemporaryDirectory(prefix='spikelane-view-')

    def __enter__(self) -> ViewerServer:
        """Start it and wait until it listens; leaving the block ends it.

        Raises:
            ViewerError: Rerun is not installed.
            ProcessError: It ended, or does not listen.
        """
        command = [str(rerun_program()), '--serve-web', '--bind', HOST]
        command += ['--port', str(self._grpc_port), '--web-viewer-port', str(self._web_port)]
        command += ['--server-memory-limit', f'{self._memory_mb}MB']
        # Rerun sends statistics of its use home, unless it believes to be tested.
        environment = {**os.environ, 'CI': '1'}
        try:
            self._processes.start(_NAME, command, Path(self._folder.name, 'log'), environment)
            self._wait_until_it_listens()
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> Literal[False]:
        """End it."""
        self._end()
        return False

    def check(self) -> None:
        """Check that it runs.

        Raises:
            ProcessError: It has ended.
            Interrupted: A signal has come.
        """
        interruption.check()
        self._processes.check()

    def _end(self) -> None:
        self._processes.stop(_NAME)
        self._folder.cleanup()

    def _wait_until_it_listens(self) -> None:
        deadline_s = time.monotonic() + _START_DEADLINE_S
        for port in (self._web_port, self._grpc_port):
            while not _listens(port):
                self.check()
                if time.monotonic() > deadline_s:
                    raise ProcessError(f'rerun: waited {_START_DEADLINE_S:g} s for port {port}')
                time.sleep(_POLL_S)


def rerun_program() -> Path:
    """Return the path of Rerun's program.

    Raises:
        ViewerError: It is not installed.
    """
    try:
        import rerun_cli
    except ImportError:
        raise ViewerError(
            "viewer: expected the package rerun-sdk, found none: pip install 'spikelane[view]', "
            'or setup/bootstrap view in a checkout'
        ) from None
    return Path(str(rerun_cli.__file__)).parent / 'rerun'


@contextlib.contextmanager
def _bound(name: str, port: int) -> Iterator[int]:
    """Hold a port and give its number."""
    with socket.socket() as sock:
        # As Rerun does: a connection that was closed a moment ago does no harm.
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            sock.bind((HOST, port))
        except OSError as error:
            raise ViewerError(
                f'{name}: expected a free port, got {port}: {error.strerror}'
            ) from None
        yield int(sock.getsockname()[1])


def _listens(port: int) -> bool:
    with socket.socket() as sock:
        return sock.connect_ex((HOST, port)) == 0
