"""The core works where there is no ROS."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys

import pytest

_ROOT = Path(__file__).parents[2]
_PACKAGES = (
    _ROOT / 'sim_bridge/spikelane_sim',
    _ROOT / 'controllers/spikelane_controllers',
    _ROOT / 'ros2_ws/src/spikelane/spikelane',
)

#: Imports the modules in its arguments; whatever belongs to ROS cannot be found.
IMPORT_WITHOUT_ROS = """
import importlib, sys

class NoRos:
    def find_spec(self, name, path=None, target=None):
        top = name.partition('.')[0]
        if (
            top.startswith(('rclpy', 'rpyutils', 'launch', 'ros2', 'rosidl', 'ament', 'domain_co'))
            or top.endswith(('_msgs', '_interfaces', '_srvs'))
        ):
            raise ModuleNotFoundError(f'{name} is not there', name=name)

sys.meta_path.insert(0, NoRos())
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        print(f'{name}: {error}')
"""


def core_modules() -> list[str]:
    """Return the names of all modules outside `nodes` and `launch` folders."""
    names = []
    for package in _PACKAGES:
        for path in sorted(package.rglob('*.py')):
            parts = path.relative_to(package.parent).with_suffix('').parts
            if not {'nodes', 'launch'} & set(parts):
                names.append('.'.join(part for part in parts if part != '__init__'))
    return names


def import_without_ros(names: list[str]) -> str:
    """Import modules in a new process; return what could not be."""
    environment = os.environ | {'PYTHONPATH': os.pathsep.join(map(str, sys.path))}
    return subprocess.run(
        [sys.executable, '-c', IMPORT_WITHOUT_ROS, *names],
        env=environment,
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    ).stdout


def test_every_core_module_can_be_imported_without_ros() -> None:
    """All that is outside the folders `nodes` and `launch` of the three packages."""
    names = core_modules()
    assert {'spikelane_sim.simulator', 'spikelane_controllers.registry', 'spikelane'} <= set(names)
    assert import_without_ros(names) == ''


@pytest.mark.parametrize('name', ['spikelane_msgs.msg', 'rclpy.node', 'launch_ros'])
def test_ros_is_really_out_of_reach(name: str) -> None:
    """Otherwise the test above would hold for anything."""
    assert import_without_ros([name]).startswith(f'{name}: ')
