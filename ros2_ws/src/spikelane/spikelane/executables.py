"""Finds the installed nodes, as `ros2 run` does."""

from __future__ import annotations

import os
from pathlib import Path

from spikelane_controllers.registry import controller_packages
from spikelane_sim.errors import SpikelaneError

#: What to do where a command needs ROS 2, and there is none.
ROS_ADVICE = 'source install/setup.bash, or use ./spikelane in a checkout, which sets ROS 2 up'


def executables() -> dict[str, str]:
    """Return the node executables, those of other packages' controllers too, with their package.

    Raises:
        ParameterError: A controller of another package cannot have its name.
    """
    return {
        'simulator': 'spikelane_sim',
        **controller_packages(),
        'recorder': 'spikelane',
        'replay': 'spikelane',
        'viewer': 'spikelane',
        'wheels_to_twist': 'spikelane',
    }


def find_executable(name: str) -> Path:
    """Return the path of a node's executable.

    Raises:
        SpikelaneError: There is no such node, or it is not installed.
    """
    packages = executables()
    if name not in packages:
        raise SpikelaneError(f'node: expected one of {", ".join(packages)}, got {name!r}')
    package = packages[name]
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        marker = Path(prefix, 'share/ament_index/resource_index/packages', package)
        executable = Path(prefix, 'lib', package, name)
        if prefix and marker.exists() and executable.exists():
            return executable
    raise SpikelaneError(
        f'node {name}: expected package {package} in AMENT_PREFIX_PATH, got none: {ROS_ADVICE}'
    )
