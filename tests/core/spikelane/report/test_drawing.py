"""Figures drawn by one process and by two."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import sys
import tempfile
import time

import pytest

from spikelane.main import run
from spikelane.report import drawing
from spikelane.report.drawing import draw_figures, Figures, runs_to_draw
from spikelane.report.runs import Runs
from spikelane_sim.files import WriteError


@pytest.fixture(scope='module')
def lap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Drive for four seconds; return the folder."""
    folder = tmp_path_factory.mktemp('runs') / 'lap'
    options = ['--controller', 'braitenberg', '--engine', 'kinematic', '--transport', 'inprocess']
    options += ['--param', 'simulator.episode.max_steps=80', '--out', str(folder)]
    assert run(['lap', *options]) == 1  # not completed
    return folder


@pytest.fixture
def alone(lap: Path, tmp_path: Path) -> Figures:
    """Draw in this process alone."""
    return draw_figures(runs_to_draw([lap]), tmp_path / 'alone', lambda name: None)


@pytest.fixture
def many(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a second process help with few figures on any machine."""
    monkeypatch.setattr(drawing, '_MANY', 1)
    monkeypatch.setattr(drawing.os, 'sched_getaffinity', lambda process: {0, 1})


def contents(figures: Figures) -> dict[str, bytes]:
    """Return what the files hold, by their names."""
    return {file.name: file.read_bytes() for each in figures.drawn for file in each.files}


def wait_for(condition: Callable[[], bool]) -> None:
    """Wait until something is so."""
    deadline_s = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.05)


def words(figures: Figures) -> list[tuple[str, str]]:
    """Return headings and captions in the order of the page."""
    return [(each.heading, each.caption) for each in figures.drawn]


@pytest.mark.usefixtures('many')
def test_two_processes_draw_the_same(
    lap: Path, alone: Figures, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same bytes, in the same order of the page; the second one has drawn some of them."""
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    shown: list[str] = []

    def show(name: str) -> None:
        shown.append(name)
        if len(shown) == 1:  # this process would be done before the other one has started
            wait_for(lambda: len(list(tmp_path.glob('spikelane-*/claims/*'))) > 1)

    together = draw_figures(runs_to_draw([lap]), tmp_path / 'two', show, [lap])
    assert 1 <= len(shown) < len(together.drawn)
    assert words(together) == words(alone)
    assert contents(together) == contents(alone)
    assert together.left_out == alone.left_out
    assert not together.unwritten


@pytest.mark.usefixtures('many')
def test_one_process_draws_what_the_other_one_does_not(
    lap: Path, alone: Figures, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here it takes a figure, and ends with an error."""
    program = tmp_path / 'program'
    program.write_text('#!/bin/sh\ntouch "$4/dqn_reward"\nsleep 1\nexit 1\n')
    program.chmod(0o755)
    monkeypatch.setattr(sys, 'executable', str(program))
    shown: list[str] = []
    together = draw_figures(runs_to_draw([lap]), tmp_path / 'two', shown.append, [lap])
    assert sorted(shown) == sorted(set(shown))
    assert 'dqn_reward' in shown
    assert contents(together) == contents(alone)


@pytest.mark.usefixtures('many')
def test_figures_that_cannot_be_written_are_named_by_both(lap: Path, tmp_path: Path) -> None:
    """A file is where the folder should be."""
    (tmp_path / 'two').write_text('')
    found = draw_figures(runs_to_draw([lap]), tmp_path / 'two', lambda name: None, [lap])
    assert not found.drawn
    assert {'scenarios', 'rstdp_reward', 'deviation_scenario_1'} <= set(found.unwritten)
    assert all(isinstance(error, WriteError) for error in found.unwritten.values())


def test_few_figures_are_drawn_by_one_process(tmp_path: Path) -> None:
    """Without runs there are those of the task and of the controllers."""
    shown: list[str] = []
    found = draw_figures(Runs(), tmp_path, shown.append, [tmp_path])
    assert len(shown) == len(found.drawn) > 0
