"""`spikelane evaluate` over ROS: the evaluation in-process, bit for bit."""

import csv
import json
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

import pytest

pytestmark = pytest.mark.ros

DEADLINE_S = 240


def evaluate(folder: Path, transport: str) -> dict[str, Any]:
    """Evaluate 80 steps of two lanes with late commands, lost events and noise."""
    command = [
        sys.executable,
        '-m',
        'spikelane.main',
        'evaluate',
        '--robot',
        'kinematic',
        '--json',
    ]
    command += ['--param', 'simulator.episode.max_steps=80', '--seed', '4', '--noise-hz', '0.5']
    command += ['--latency-ms', '100', '--event-loss', '0.2', '--transport', transport]
    ended = subprocess.run(
        [*command, '--out', str(folder)],
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        env=os.environ | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
    )
    assert ended.returncode == 0, ended.stderr
    return dict(json.loads(ended.stdout))


def test_over_ros_it_is_the_same_evaluation(tmp_path: Path) -> None:
    """Every trajectory and all numbers but counts of operations, which are made in-process."""
    results = {name: evaluate(tmp_path / name, name) for name in ('inprocess', 'ros')}
    differing = {'transport', 'folder', 'operations'}
    for name, is_counted in (('inprocess', True), ('ros', False)):
        counts = [lap.pop('operations') for lap in results[name]['laps']]
        assert [count is not None for count in counts] == [is_counted] * 2
        assert (results[name]['operations'] is not None) is is_counted
    one, other = (
        {key: value for key, value in result.items() if key not in differing}
        for result in results.values()
    )
    assert one == other
    assert [each['steps'] for each in one['laps']] == [80, 80]
    for lap in ('outer-seed4', 'inner-seed4'):
        rows, same = (
            (tmp_path / name / 'laps' / lap / 'trajectory.csv').read_text() for name in results
        )
        assert rows == same
        assert (tmp_path / 'ros/laps' / lap / 'bag/metadata.yaml').exists()
        # For two steps nothing arrives: the wheels stand still though commands are given.
        progress = [float(row['progress_m']) for row in csv.DictReader(rows.splitlines())]
        assert progress[:3] == [0.0, 0.0, 0.0]
        assert progress[3] > 0.004
