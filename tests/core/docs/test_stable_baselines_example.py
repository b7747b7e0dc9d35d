"""The documentation's example with Stable-Baselines3, briefly."""

import json
import os
from pathlib import Path
import subprocess
import sys

import pytest

EXAMPLE = Path(__file__).parents[3] / 'docs' / 'examples' / 'stable_baselines.py'


@pytest.mark.parametrize('algorithm', ['ppo', 'dqn'])
def test_it_learns_in_64_environments_and_drives(algorithm: str, tmp_path: Path) -> None:
    """A round of learning with the kinematic robot, and both lanes with physics."""
    ended = subprocess.run(
        [sys.executable, str(EXAMPLE), algorithm, '--steps', '1088', '--out', str(tmp_path)],
        env=os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    results = json.loads((tmp_path / 'results.json').read_text())
    assert json.loads(ended.stdout) == results
    assert set(results) == {'outer', 'inner'}
    for result in results.values():
        assert 1 <= result['actions'] <= 1000
        assert 0 < result['mean_distance_m'] < 0.5
    assert (tmp_path / 'policy.zip').exists()
