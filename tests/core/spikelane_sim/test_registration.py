"""The environment is known to Gymnasium, whatever is imported first, and Gymnasium is lazy."""

import subprocess
import sys

import pytest

_NAME = 'print("spikelane/LaneKeeping-v0" in gymnasium.registry)'


@pytest.mark.parametrize(
    'code',
    [
        f'import spikelane_sim, gymnasium; {_NAME}',
        f'import gymnasium, spikelane_sim; {_NAME}',
        f'import gymnasium, spikelane; {_NAME}',
        f'import spikelane_sim; from gymnasium.envs import toy_text; import gymnasium; {_NAME}',
        # Somebody who only asks whether it is there does not load it.
        'import importlib.util, sys, spikelane_sim; importlib.util.find_spec("gymnasium"); '
        f'assert "gymnasium" not in sys.modules; import gymnasium; {_NAME}',
        'import gymnasium; print(gymnasium.make("spikelane_sim:spikelane/LaneKeeping-v0", '
        'simulator={"robot.engine": "kinematic"}).spec.id == "spikelane/LaneKeeping-v0")',
    ],
)
def test_the_environment_is_registered_in_any_order(code: str) -> None:
    """And without a warning that something is registered twice."""
    command = [sys.executable, '-W', 'error::UserWarning', '-c', code]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr, done.returncode) == ('True\n', '', 0)


def test_gymnasium_is_not_loaded_by_us() -> None:
    """And our finder is gone once it has been of use."""
    code = (
        'import sys, spikelane_sim\n'
        'print("gymnasium" in sys.modules)\n'
        'count = len(sys.meta_path)\n'
        'import gymnasium, importlib\n'
        'print(len(sys.meta_path) - count)\n'
        'before = dict(gymnasium.registry)\n'
        'importlib.reload(gymnasium)\n'
        'print(gymnasium.registry == before)\n'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout == 'False\n-1\nTrue\n'
