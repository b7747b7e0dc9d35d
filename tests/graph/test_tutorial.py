"""The tutorial's quick commands, run one after the other as it tells people to."""

from __future__ import annotations

import json
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


def follow(block: str, folder: Path) -> dict[str, str]:
    """Run the commands of a block in a folder; return what each said.

    They must end well, but for laps that are cut short.
    """
    said = {}
    for line in block.splitlines():
        command, *arguments = shlex.split(line, comments=True)
        assert command == './spikelane'
        ended = run(folder, '-m', 'spikelane.main', *arguments)
        is_short = arguments[0] == 'lap' and 'max_steps' in line
        assert ended.returncode == int(is_short), f'{line}\n{ended.stderr}'
        said[line] = ended.stdout
    return said


def test_a_first_lap_is_completed(tmp_path: Path) -> None:
    """With one command."""
    (said,) = follow(BLOCKS[0], tmp_path).values()
    assert re.search(r'^lap completed +yes', said, re.M)


def test_what_is_learnt_goes_on_and_drives(tmp_path: Path) -> None:
    """Two trainings in one folder, then a lap."""
    first, second, lap = follow(BLOCKS[1], tmp_path).values()
    assert re.search(r'^steps +1000$', first, re.M)
    assert re.search(r'^steps +2000$', second, re.M)
    assert re.search(r'^steps +100,', lap, re.M)


def test_the_experiment_is_listed(tmp_path: Path) -> None:
    """Trainings of 10 seeds in 2 scenarios, evaluations of 2 controllers in 2 conditions."""
    (experiment,) = re.findall(r'^```yaml\n(.*?)^```', TUTORIAL, re.M | re.S)
    (tmp_path / 'robustness.yaml').write_text(experiment, encoding='utf-8')
    (said,) = follow(BLOCKS[2], tmp_path).values()
    assert said.count('to do') >= 20 + 80


def test_a_drive_is_replayed(tmp_path: Path) -> None:
    """The controller that drove agrees fully, another one does not; the folder is as described."""
    _, same, other = follow(BLOCKS[3], tmp_path).values()
    assert re.search(r'^agreement +100\.0000%, 20[01] of 20[01] answers$', same, re.M)
    assert json.loads(other)['agreement'] < 1.0
    described = re.findall(r'^\| (`.*?) \| (.*)', TUTORIAL.partition('## See it')[0], re.M)
    always = [names for names, what in described if not what.startswith('with `--')]
    for name in re.findall(r'`([\w./]+)`', ' '.join(always)):
        assert (tmp_path / 'runs/short' / name).exists()
    assert (len(described), len(always)) == (5, 4)


def test_both_nodes_drive_in_one_process(tmp_path: Path) -> None:
    """With one command; the log is where the page says."""
    (said,) = follow(BLOCKS[4], tmp_path).values()
    assert re.search(r'^steps +100,', said, re.M)
    (log,) = tmp_path.glob('runs/*/logs/composed.log')
    assert '[simulator]' in log.read_text()
    assert '[braitenberg]' in log.read_text()


@pytest.mark.parametrize('program', PYTHON)
def test_the_programs_run(program: str, tmp_path: Path) -> None:
    """Without a word."""
    ended = run(tmp_path, '-c', program)
    assert ended.returncode == 0, ended.stderr


def test_there_are_commands_and_programs() -> None:
    """Otherwise the tests above would check nothing."""
    assert (len(BLOCKS), len(PYTHON)) == (5, 2)
