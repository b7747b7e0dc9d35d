"""What a command needs in addition is installed before it begins: PyTorch is large."""

from __future__ import annotations

from pathlib import Path

import pytest

from spikelane.main import run
from spikelane.requirements import require, SETUP

ROOT = Path(__file__).parents[3]


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give the file in which a set-up that always fails notes what it is asked for."""
    script, file = tmp_path / 'bootstrap', tmp_path / 'asked'
    script.write_text(f'#!/bin/sh\necho "$1" >> "{file}"\nexit 3\n')
    script.chmod(0o755)
    monkeypatch.setenv(SETUP, str(script))
    return file


def arguments(words: str, folder: Path) -> list[str]:
    """Return the words of a command, with the folder of results and that of experiments."""
    folders = {'OUT': str(folder / 'out'), 'EXPERIMENTS': str(ROOT / 'experiments')}
    return [
        '/'.join(folders.get(part, part) for part in word.split('/')) for word in words.split()
    ]


@pytest.mark.parametrize(
    'words',
    [
        'transfer',
        'transfer --scenario 2',
        'reproduce --quick --out OUT',
        'experiment EXPERIMENTS/paper.yaml --out OUT',
    ],
)
def test_a_command_that_needs_pytorch_asks_for_it(
    words: str, asked: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And ends with one line where it cannot be had."""
    assert run(arguments(words, tmp_path)) == 1
    assert asked.read_text() == 'learn\n'
    error = 'setup/bootstrap learn: expected a set-up, got exit status 3'
    assert capsys.readouterr().err == f'spikelane {words.split()[0]}: {error}\n'


@pytest.mark.parametrize(
    'words',
    [
        'experiment EXPERIMENTS/paper.yaml --dry-run',
        'experiment EXPERIMENTS/rstdp.yaml --dry-run',
        'train rstdp --robot kinematic --steps 1 --out OUT',
        'train dqn --robot kinematic --steps 1 --out OUT',
    ],
)
def test_who_does_not_use_pytorch_does_not_wait_for_it(
    words: str, asked: Path, tmp_path: Path
) -> None:
    """Nothing is asked for."""
    assert run(arguments(words, tmp_path)) == 0
    assert not asked.exists()


def test_nothing_is_installed_where_there_is_no_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    """A library never installs anything."""
    monkeypatch.delenv(SETUP, raising=False)
    require(['no_such_list'])
