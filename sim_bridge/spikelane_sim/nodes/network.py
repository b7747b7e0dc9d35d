"""Which network interfaces the nodes use: only the loopback interface by default.

The environment variable SPIKELANE_NETWORK is the option: `loopback` (default) or `all`. Each
selects a profile of Fast DDS, ROS 2 Jazzy's usual middleware. Other middlewares ignore it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from spikelane_sim.errors import SpikelaneError

NETWORK = 'SPIKELANE_NETWORK'
PROFILE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'

_PROFILES = {
    name: Path(__file__).parent / 'fastdds' / f'spikelane_{name}.xml'
    for name in ('loopback', 'all')
}


def network_variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the environment variables that give a node the network interfaces it may use.

    Args:
        environment: The variables so far. A profile of the user's own is kept.

    Returns:
        The variables to add or to change.

    Raises:
        SpikelaneError: SPIKELANE_NETWORK has another value than those allowed.
    """
    network = environment.get(NETWORK) or 'loopback'
    if network not in _PROFILES:
        expected = ' or '.join(_PROFILES)
        raise SpikelaneError(f'{NETWORK}: expected {expected}, got {network!r}')
    given = environment.get(PROFILE)
    if given and Path(given).name not in {path.name for path in _PROFILES.values()}:
        return {}
    variables = {PROFILE: str(_PROFILES[network])}
    is_local = network == 'loopback' and environment.get(RANGE) == 'LOCALHOST'
    if is_local and _is_fast_dds(environment):
        # For the range LOCALHOST the middleware adds a transport with sockets on all interfaces.
        # The subnet of the loopback interface is this machine.
        variables[RANGE] = 'SUBNET'
    return variables


def _is_fast_dds(environment: Mapping[str, str]) -> bool:
    return environment.get('RMW_IMPLEMENTATION', '') in ('', 'rmw_fastrtps_cpp')
