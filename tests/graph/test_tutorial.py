"""The tutorial's quick commands, run one after the other as it tells people to."""

from __future__ import annotations

import os
from pathlib import Path
import re
import shlex
import subprocess
import sys

import pytest

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(600)]

TUTORIAL = (Path(__file__).parents[2] / 'docs/tutorial.md').read_text('utf-8')
BLOCKS = re.findall(r'^<!-- run -->\n```sh\n(.*?)^```', TUTORIAL, re.M | re.S)
PYTHON = re.findall(r'^```python\n(.*?)^```', TUTORIAL, re.M | re.S)
DEADLINE_S = 300


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder."""
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        env=os.environ | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
    )


def test_the_commands_do_what_the_tutorial_says(tmp_path: Path) -> None:
    """Each ends well, but for laps that are cut short; a replay agrees with its drive."""
    (experiment,) = re.findall(r'^```yaml\n(.*?)^```', TUTORIAL, re.M | re.S)
    (tmp_path / 'robustness.yaml').write_text(experiment, encoding='utf-8')
    said = {}
    for line in ''.join(BLOCKS).splitlines():
        command, *arguments = shlex.split(line, comments=True)
        assert command == './spikelane'
        ended = run(tmp_path, '-m', 'spikelane.main', *arguments)
        is_short = arguments[0] == 'lap' and 'max_steps' in line
        assert ended.returncode == int(is_short), f'{line}\n{ended.stderr}'
        said[line] = ended.stdout
    assert len(said) == 8
    lap, *_ = said.values()
    assert re.search(r'^lap completed +yes', lap, re.M)
    replayed = said['./spikelane replay runs/short/bag']
    assert re.search(r'^agreement +100\.0000%, 20[01] of 20[01] answers$', replayed, re.M)
    for name in ('config.yaml', 'bag', 'trajectory.csv', 'metrics.json', 'figures', 'logs'):
        assert (tmp_path / 'runs/short' / name).exists()
    assert (tmp_path / 'runs/short/parameters.yaml').exists()


@pytest.mark.parametrize('program', PYTHON)
def test_the_programs_run(program: str, tmp_path: Path) -> None:
    """Without a word."""
    ended = run(tmp_path, '-c', program)
    assert ended.returncode == 0, ended.stderr


def test_there_are_commands_and_programs() -> None:
    """So that the tests above are about something."""
    assert (len(BLOCKS), len(PYTHON)) == (4, 2)
