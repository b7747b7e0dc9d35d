"""`spikelane train dqn` over ROS: the training in-process, bit for bit."""

import functools
import json
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

import pytest

from spikelane.processes import end_with

pytestmark = pytest.mark.ros

DEADLINE_S = 200.0
STEPS = 60
#: A small network that learns from the beginning, in short episodes.
SMALL = (
    'simulator.episode.max_distance_m=0.05',
    'simulator.episode.max_steps=120',
    'dqn.network.hidden_1=8',
    'dqn.network.hidden_2=6',
    'dqn.q_learning.random_steps=10',
    'dqn.q_learning.update_every=2',
)


def train(folder: Path, transport: str, steps: int, *options: str) -> dict[str, Any]:
    """Train; return the result."""
    command = [sys.executable, '-m', 'spikelane.main', 'train', 'dqn', '--seed', '3', '--json']
    command += ['--robot', 'kinematic', '--transport', transport, '--out', str(folder)]
    for each in SMALL:
        command += ['--param', each]
    process = subprocess.Popen(
        [*command, '--steps', str(steps), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
        preexec_fn=functools.partial(end_with, os.getpid()),
    )
    output, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0, errors
    return dict(json.loads(output))


def test_over_ros_it_is_the_same_training(tmp_path: Path) -> None:
    """Checkpoint, states, episodes and metrics; gone on with over ROS as well."""
    inprocess, ros = tmp_path / 'inprocess', tmp_path / 'ros'
    expected = train(inprocess, 'inprocess', STEPS)
    train(ros, 'ros', STEPS // 2)
    result = train(ros, 'ros', STEPS, '--resume')
    for name in ('checkpoint.safetensors', 'episodes.csv'):
        assert (ros / name).read_bytes() == (inprocess / name).read_bytes()
    differing = {'transport', 'wall_time_s', 'folder', 'checkpoint', 'figures'}
    assert {k: v for k, v in result.items() if k not in differing} == {
        k: v for k, v in expected.items() if k not in differing
    }
    assert result['lane_losses'] > 0
    logs = {path.name: path.read_text() for path in (ros / 'logs').iterdir()}
    assert set(logs) == {'simulator.log', 'dqn.log'}
    assert not any('Traceback' in text or 'ERROR' in text for text in logs.values()), logs
