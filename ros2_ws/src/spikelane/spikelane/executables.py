"""Finds the installed nodes, as `ros2 run` does."""

from __future__ import annotations

import os
from pathlib import Path

from spikelane_controllers.registry import CONTROLLERS
from spikelane_sim.errors import SpikelaneError

#: Node executables and the package that has each.
EXECUTABLES = {
    'simulator': 'spikelane_sim',
    **dict.fromkeys(CONTROLLERS, 'spikelane_controllers'),
    'recorder': 'spikelane',
    'replay': 'spikelane',
    'viewer': 'spikelane',
}


def find_executable(name: str) -> Path:
    """Return the path of a node's executable.

    Raises:
        SpikelaneError: There is no such node, or it is not installed.
    """
    if name not in EXECUTABLES:
        raise SpikelaneError(f'node: expected one of {", ".join(EXECUTABLES)}, got {name!r}')
    package = EXECUTABLES[name]
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        marker = Path(prefix, 'share/ament_index/resource_index/packages', package)
        executable = Path(prefix, 'lib', package, name)
        if prefix and marker.exists() and executable.exists():
            return executable
    raise SpikelaneError(
        f'node {name}: package {package} is not in AMENT_PREFIX_PATH; source install/setup.bash'
    )
