"""The command of a run, told from its `config.yaml`."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from spikelane.main import run
from spikelane.report.collect import collect
from spikelane.report.commands import command_of

ASKED = (
    *('lap', '--seed', '4', '--transport', 'inprocess', '--robot', 'kinematic'),
    # The first is the default, and was given all the same.
    *('--param', 'braitenberg.lowest_rows=1', '--param', 'simulator.episode.max_steps=9'),
)
START = (
    './spikelane lap --scenario 1 --seed 4 --controller braitenberg --lane outer '
    '--transport inprocess '
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Drive nine steps of a lap."""
    assert run([*ASKED, '--out', str(tmp_path / 'lap')]) == 1
    return tmp_path / 'lap'


def test_the_command_names_what_was_given(folder: Path) -> None:
    """As the user gave it, a default included; the words themselves are recorded, too."""
    [lap] = collect([folder]).laps
    assert command_of(lap) == (
        f'{START}--param braitenberg.lowest_rows=1 --param simulator.episode.max_steps=9 '
        '--robot kinematic'
    )
    assert lap.config['command_line'] == [*ASKED, '--out', str(folder)]


def test_a_run_of_an_earlier_version_has_a_command_too(folder: Path) -> None:
    """It names what differs from the defaults."""
    file = folder / 'config.yaml'
    config = yaml.safe_load(file.read_text())
    del config['given'], config['command_line']
    file.write_text(yaml.safe_dump(config, sort_keys=False))
    [lap] = collect([folder]).laps
    assert command_of(lap) == (f'{START}--param simulator.episode.max_steps=9 --engine kinematic')
