"""Damaged runs are left out of a report with one line, and the report of the others is made."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from spikelane.report.collect import collect

LAP = {
    'completed': True,
    'steps': 4000,
    'lap_time_s': 200.0,
    'mean_abs_distance_m': 0.02,
    'max_abs_distance_m': 0.1,
    'mean_distance_m': 0.01,
}


def write_lap(folder: Path, seed: int, **others: Any) -> Path:
    """Write the folder of a lap, with other metrics by name."""
    folder.mkdir(parents=True)
    config = {'scenario': '1', 'controller': 'braitenberg', 'seed': seed, 'lane': 'outer'}
    (folder / 'config.yaml').write_text(yaml.safe_dump(config))
    (folder / 'metrics.json').write_text(json.dumps(LAP | others))
    return folder


@pytest.mark.parametrize(
    ('name', 'value', 'expected'),
    [
        ('completed', 'yes', 'completed: expected true or false'),
        ('steps', float('nan'), 'not JSON: expected finite numbers, got nan'),
        ('steps', 2.5, 'steps: expected a whole number'),
        ('steps', 2**63, 'steps: expected a whole number, got one beyond 64 bits'),
        ('steps', 10**400, 'expected whole numbers of at most 64 bits'),
        ('lap_time_s', None, 'lap_time_s: expected a number'),
        ('lap_time_s', float('inf'), 'not JSON: expected finite numbers, got inf'),
        ('mean_abs_distance_m', '0.02', 'mean_abs_distance_m: expected a number'),
        ('mean_distance_m', [[]], 'mean_distance_m: expected a number'),
        ('max_abs_distance_m', True, 'max_abs_distance_m: expected a number'),
        ('operations', [1], 'operations: expected names and values'),
        ('operations', {'decisions': 'x'}, 'decisions: expected a whole number'),
    ],
)
def test_a_lap_with_a_value_of_a_wrong_kind_is_left_out(
    tmp_path: Path, name: str, value: Any, expected: str
) -> None:
    """The other lap is used."""
    good = write_lap(tmp_path / 'a', 1)
    bad = write_lap(tmp_path / 'b', 2, **{name: value})
    found = collect([tmp_path])
    assert [lap.folder for lap in found.laps] == [good]
    [left_out] = found.left_out
    assert left_out.what == str(bad)
    assert expected in left_out.why
    assert '\n' not in left_out.why
