"""The documentation's example with Stable-Baselines3, briefly."""

import json
import os
from pathlib import Path
import subprocess
import sys

import pytest

EXAMPLE = Path(__file__).parents[3] / 'docs' / 'examples' / 'ppo.py'


def test_ppo_learns_and_drives(tmp_path: Path) -> None:
    """One round of learning with the kinematic robot, and both lanes with physics."""
    pytest.importorskip('stable_baselines3')
    ended = subprocess.run(
        [sys.executable, str(EXAMPLE), '--steps', '1024', '--out', str(tmp_path)],
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
