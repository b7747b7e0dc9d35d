"""The laps that the README and the tutorial show are completed."""

from __future__ import annotations

import json
from pathlib import Path
import re
import shlex

import pytest

from spikelane.main import run

ROOT = Path(__file__).parents[3]
#: `max_steps` ends a drive early on purpose, and `runs/` is what another command left.
NO_LAPS = ('episode.max_steps=', '--checkpoint runs/')
LAP = re.compile(r'^(?:\./spikelane|ros2 run spikelane spikelane) lap\b(.*)', re.M)


def documented() -> list[str]:
    """Return the arguments of the laps, each once, without the transport."""
    texts = [(ROOT / page).read_text('utf-8') for page in ('README.md', 'docs/tutorial.md')]
    found = [line.partition('#')[0] for text in texts for line in LAP.findall(text)]
    laps = [line for line in found if not any(mark in line for mark in NO_LAPS)]
    return list(dict.fromkeys(line.replace('--transport inprocess', '').strip() for line in laps))


def test_the_laps_are_found() -> None:
    """Otherwise the test below would check nothing."""
    assert len(documented()) >= 6
    assert any('--lane inner' in each for each in documented())


@pytest.mark.parametrize('arguments', documented())
def test_a_documented_lap_is_completed(tmp_path: Path, arguments: str) -> None:
    """With the robot and the seed shown; over ROS it is the same lap bit for bit."""
    folder = tmp_path / 'lap'
    options = ['--transport', 'inprocess', '--json', '--out', str(folder)]
    assert run(['lap', *shlex.split(arguments), *options]) == 0
    result = json.loads((folder / 'metrics.json').read_text('utf-8'))
    assert (result['completed'], result['reason']) == (True, 'laps_complete')
