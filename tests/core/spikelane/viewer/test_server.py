"""Rerun's server: whom it serves, how it starts and how it ends."""

from __future__ import annotations

from pathlib import Path
import socket
import subprocess
import sys
from types import ModuleType
from urllib.parse import parse_qs, urlsplit
from urllib.request import urlopen

import pytest

from spikelane.processes import ProcessError
from spikelane.viewer.server import rerun_program, ViewerError, ViewerServer

LISTENING = '0A'  # as the kernel numbers the states of connections


def listening_addresses(port: int) -> set[str]:
    """Return the local addresses on which somebody listens to a port, as the kernel tells."""
    found = set()
    for table in ('/proc/net/tcp', '/proc/net/tcp6'):
        for line in Path(table).read_text().splitlines()[1:]:
            _, local, _, state, *_ = line.split()
            address, _, number = local.rpartition(':')
            if int(number, 16) == port and state == LISTENING:
                found.add(address)
    return found


def ports_of(server: ViewerServer) -> tuple[int, int]:
    """Return the ports of page and data."""
    ports = urlsplit(server.url).port, urlsplit(server.address).port
    assert None not in ports
    return ports  # type: ignore[return-value]


def test_the_page_is_served_to_this_machine_alone() -> None:
    """It listens on 127.0.0.1 and on nothing else; the page comes from the package."""
    with ViewerServer(0, 0) as server:
        for port in ports_of(server):
            assert listening_addresses(port) == {'0100007F'}
        with urlopen(server.url) as page:
            assert b're_viewer.js' in page.read()
    assert parse_qs(urlsplit(server.url).query) == {'url': [server.address]}
    assert server.address.startswith('rerun+http://127.0.0.1:')
    for port in ports_of(server):
        assert listening_addresses(port) == set()


@pytest.mark.parametrize('which', ['web_port', 'grpc_port'])
def test_a_port_in_use_is_told(which: str) -> None:
    """In one line that names it, before anything is started."""
    with socket.socket() as other:
        other.bind(('127.0.0.1', 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(ViewerError, match=rf'^{which}: expected a free port, got {port}: '):
            ViewerServer(**{'web_port': 0, 'grpc_port': 0, which: port})


def test_without_rerun_it_is_told_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line with the command."""
    monkeypatch.setitem(sys.modules, 'rerun_cli', None)
    with pytest.raises(
        ViewerError, match=r'^viewer: expected the package rerun-sdk, .* setup/bootstrap view '
    ):
        rerun_program()


def test_a_program_that_cannot_be_started_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It may be built for another kind of machine, or be missing."""
    package = ModuleType('rerun_cli')
    package.__file__ = str(tmp_path / '__init__.py')
    monkeypatch.setitem(sys.modules, 'rerun_cli', package)
    with pytest.raises(ProcessError, match=r'^rerun: cannot be started: '), ViewerServer(0, 0):
        pass


def test_viewing_needs_no_rerun_until_it_begins() -> None:
    """All of its modules can be imported without."""
    program = (
        'import sys; sys.modules |= dict.fromkeys(("rerun", "rerun_cli", "pyarrow"));'
        'import spikelane.viewer.scene, spikelane.viewer.server, spikelane.commands.view'
    )
    subprocess.run([sys.executable, '-c', program], check=True)
