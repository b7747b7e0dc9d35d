"""The example in the docs of a package with controllers, built by colcon."""

from __future__ import annotations

import json
import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

pytestmark = pytest.mark.ros

EXAMPLE = Path(__file__).parents[2] / 'docs/examples/balance'
DEADLINE_S = 250
#: What `ros2 run` needs in addition, as the page says.
SCRIPT = """
[project.scripts]
balance = 'spikelane_controllers.nodes.main:main'
"""


@pytest.mark.parametrize('addition', ['', SCRIPT], ids=['as it is', 'for ros2 run'])
def test_it_is_built_and_drives_as_in_one_process(tmp_path: Path, addition: str) -> None:
    """The same trajectory over ROS, with or without an executable of its own."""
    if ' ' in sys.executable:
        pytest.skip("colcon's setup files do not work in paths with a space")
    package = tmp_path / 'src/balance'
    shutil.copytree(EXAMPLE, package)
    with (package / 'pyproject.toml').open('a', encoding='utf-8') as file:
        file.write(addition)
    build = [sys.executable, '-m', 'colcon', 'build']
    built = subprocess.run(build, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    executable = tmp_path / 'install/my_controllers/lib/my_controllers/balance'
    assert executable.exists() == bool(addition)
    rows = [trajectory(tmp_path, transport) for transport in ('inprocess', 'ros')]
    assert rows[0] == rows[1]


def trajectory(workspace: Path, transport: str) -> str:
    """Drive 50 steps where what has been built is known; return what was driven."""
    command = f'source install/setup.bash && exec timeout -s INT -k 20 {DEADLINE_S} "$@"'
    lap = ['-m', 'spikelane.main', 'lap', '--controller', 'balance', '--engine', 'kinematic']
    limit = ['--param', 'simulator.episode.max_steps=50', '--transport', transport, '--json']
    ended = subprocess.run(
        ['bash', '-c', command, '', sys.executable, *lap, *limit],
        cwd=workspace,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
    )
    assert ended.returncode == 1, ended.stderr
    result = json.loads(ended.stdout)
    assert (result['controller'], result['steps']) == ('balance', 50)
    return Path(workspace, result['folder'], 'trajectory.csv').read_text('utf-8')
