"""Finds the installed nodes, as `ros2 run` does, and those of controllers that pip installed."""

from __future__ import annotations

import os
from pathlib import Path
import sys

from spikelane_controllers.registry import controller_packages
from spikelane_sim.errors import SpikelaneError

#: What to do where a command needs ROS 2, and there is none.
ROS_ADVICE = 'source install/setup.bash, or use ./spikelane in a checkout, which sets ROS 2 up'

#: Python's arguments that run a controller's node; its name follows.
MODULE_ARGUMENTS = ('-m', 'spikelane_controllers.nodes')
#: Python's arguments that run a simulator and a controller in one process; its name follows.
COMPOSED_ARGUMENTS = ('-m', 'spikelane_controllers.nodes.composed')
_OWN = 'spikelane_controllers'


def executables() -> dict[str, str]:
    """Return the node executables, those of other packages' controllers too, with their package.

    Raises:
        ParameterError: A controller of another package cannot have its name.
    """
    return {
        'simulator': 'spikelane_sim',
        **controller_packages(),
        'camera_calibration': 'spikelane',
        'lane_from_pose': 'spikelane',
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
    if found := _in_prefixes(packages[name], name):
        return found
    raise SpikelaneError(
        f'node {name}: expected package {packages[name]} in AMENT_PREFIX_PATH, got none: '
        f'{ROS_ADVICE}'
    )


def node_command(name: str) -> list[str]:
    """Return the command that runs a node, to which its arguments are added.

    A controller of a package that colcon has not built, since pip has installed it, has no
    executable: this Python, which knows the package, runs its node.

    Raises:
        SpikelaneError: There is no such node, or it or ROS is not installed.
    """
    if is_installed_by_pip(name):
        find_executable('simulator')  # there is ROS
        return [sys.executable, *MODULE_ARGUMENTS, name]
    return [str(find_executable(name))]


def composed_command(controller: str) -> list[str]:
    """Return the command that runs the simulator and a controller as nodes of one process.

    Raises:
        SpikelaneError: As `node_command`, of both nodes.
    """
    for node in ('simulator', controller):
        node_command(node)
    return [sys.executable, *COMPOSED_ARGUMENTS, controller]


def is_installed_by_pip(name: str) -> bool:
    """Whether a node is a controller of another package that ROS does not know.

    Raises:
        ParameterError: As `executables`.
    """
    package = controller_packages().get(name, _OWN)
    return package != _OWN and _in_prefixes(package, name) is None


def _in_prefixes(package: str, name: str) -> Path | None:
    """Return the executable of a package in AMENT_PREFIX_PATH, None where there is none."""
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        marker = Path(prefix, 'share/ament_index/resource_index/packages', package)
        executable = Path(prefix, 'lib', package, name)
        if prefix and marker.exists() and executable.exists():
            return executable
    return None
