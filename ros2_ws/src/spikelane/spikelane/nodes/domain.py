"""A ROS domain of one's own, so that the graphs on a machine do not meet."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
from pathlib import Path
import socket
import tempfile
from typing import NamedTuple

from spikelane.processes import ProcessError
from spikelane_sim.nodes.network import network_variables, PROFILE, RANGE

#: How long a silent node is taken for alive: usually, and in a domain of our own.
LEASE_S = 20
PATIENT_LEASE_S = 900
#: A domain is reserved by this TCP port plus its number, as ROS's domain_coordinator does it.
_FIRST_PORT = 32768
_DOMAINS = range(1, 101)


class OwnDomain(NamedTuple):
    """A reserved ROS domain.

    Attributes:
        number: Its ROS_DOMAIN_ID.
        environment: The environment variables that keep processes in it.
        reservation: File descriptor that reserves the domain as long as some process has it open.
            The nodes must have it, too: where the command is killed, its nodes live on for some
            seconds, and must not meet those of the next command.
    """

    number: int
    environment: dict[str, str]
    reservation: int


@contextlib.contextmanager
def own_domain() -> Iterator[OwnDomain]:
    """Reserve a ROS domain that nobody else on this machine uses.

    Raises:
        ProcessError: All domains are in use.
    """
    before = dict(os.environ)
    with (
        _reserve() as (number, reservation),
        tempfile.TemporaryDirectory(prefix='spikelane_') as folder,
    ):
        own = {'ROS_DOMAIN_ID': str(number), RANGE: 'LOCALHOST'}
        own |= network_variables(os.environ | own)
        if PROFILE in own:  # and not one of the user's
            own[PROFILE] = str(write_patient_profile(Path(own[PROFILE]), Path(folder)))
        # The supervisor reads them in this process, else it would meet other machines' nodes.
        os.environ |= own
        try:
            yield OwnDomain(number, own, reservation)
        finally:
            os.environ.clear()
            os.environ |= before


def write_patient_profile(profile: Path, folder: Path) -> Path:
    """Write a Fast DDS profile with which nodes do not forget one that was stopped for a while.

    Elsewhere a node that is silent for 20 s is taken for dead: whoever was killed must be
    forgotten. In a domain of our own the end of a process is noticed at once, and a recorder that
    was forgotten while it was stopped would lack what was sent to it before.

    Args:
        profile: The usual one.
        folder: Where to write the other.

    Returns:
        Its path.
    """
    usual = f'<leaseDuration><sec>{LEASE_S}</sec></leaseDuration>'
    text = profile.read_text(encoding='utf-8')
    assert text.count(usual) == 1
    path = folder / 'fastdds.xml'
    longer = usual.replace(f'{LEASE_S}', f'{PATIENT_LEASE_S}')
    path.write_text(text.replace(usual, longer), encoding='utf-8')
    return path


@contextlib.contextmanager
def _reserve() -> Iterator[tuple[int, int]]:
    """Yield the number of a free domain, and the file descriptor that reserves it."""
    for number in _DOMAINS:
        with socket.socket() as holder:
            try:
                holder.bind(('', _FIRST_PORT + number))
            except OSError:
                continue
            yield number, holder.fileno()
            return
    raise ProcessError(
        f'ROS domains: expected a free one of {_DOMAINS[0]} to {_DOMAINS[-1]}, all are in use'
    )
