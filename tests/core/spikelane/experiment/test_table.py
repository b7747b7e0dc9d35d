"""What people see of an experiment."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from spikelane.experiment.file import read_experiment
from spikelane.experiment.plan import make_plan
from spikelane.experiment.runner import Runner, RunStatus
from spikelane.experiment.table import render, shown, time_left_s
from spikelane.experiment.worker import Progress

MATRIX = '{controllers: [rstdp], seeds: 5, tasks: [train]}'


@pytest.fixture
def runner(tmp_path: Path) -> Runner:
    """Give an experiment of five runs: one finished, one failed, two running, one waiting."""
    file = tmp_path / 'some.yaml'
    file.write_text(f'name: some\nmatrix: {MATRIX}')
    made = Runner(make_plan(read_experiment(file)), tmp_path / 'out', 0)
    finished, failed, fast, silent, _ = made.statuses.values()
    finished.state, failed.state, failed.message = RunStatus.DONE, RunStatus.FAILED, 'no such lane'
    fast.state = silent.state = RunStatus.RUNNING
    # A quarter of it in ten seconds: 30 left of 40.
    fast.first = (100.0, Progress(1000, 0.0))
    fast.last = (110.0, Progress(13_500, 0.25))
    return made


def text_of(runner: Runner) -> str:
    """Return the table as a text."""
    console = Console(file=io.StringIO(), width=100)
    console.print(render(runner, 2))
    output = console.file
    assert isinstance(output, io.StringIO)
    return output.getvalue()


def test_the_table_tells_what_runs_how_fast_and_how_long_it_will_take(runner: Runner) -> None:
    """Speed and time left are unknown for a run that has not reported yet."""
    lines = text_of(runner).splitlines()
    assert lines[0].split() == ['running', 'done', 'steps/s', 'left']
    assert lines[1].split()[0] == 'train-rstdp-1-seed2'
    assert lines[1].split()[-4:] == ['25', '%', '1,250', '0:30']
    assert lines[2].split()[0] == 'train-rstdp-1-seed3'
    assert lines[2].split()[-2:] == ['0', '%']
    assert lines[3] == '1 of 5 runs finished, 1 failed, about 0:55 left'
    assert len(lines) == 4


def test_the_time_left_counts_runs_like_those_that_run(runner: Runner) -> None:
    """30 s of one; 40 s each of the one that is silent and the one that waits; two at a time."""
    assert time_left_s(runner, 1) == pytest.approx(110.0)
    assert time_left_s(runner, 2) == pytest.approx(55.0)


def test_the_time_left_counts_runs_like_those_that_are_done(runner: Runner) -> None:
    """100 s and the 40 s of the one at work: 30 s of it, and 70 s each of two others."""
    runner.statuses['train-rstdp-1-seed0'].took_s = 100.0
    assert time_left_s(runner, 1) == pytest.approx(170.0)


def test_runs_of_another_controller_tell_nothing(tmp_path: Path, runner: Runner) -> None:
    """Their runs can take many times as long."""
    file = tmp_path / 'both.yaml'
    file.write_text(f'name: both\nmatrix: {MATRIX.replace("[rstdp]", "[rstdp, dqn]")}')
    both = Runner(make_plan(read_experiment(file)), tmp_path / 'out', 0)
    both.statuses |= runner.statuses
    assert time_left_s(both, 2) is None
    for name in range(5):
        both.statuses[f'train-dqn-1-seed{name}'].state = RunStatus.DONE
    assert time_left_s(both, 2) == pytest.approx(55.0)


def test_nothing_is_estimated_from_nothing(runner: Runner) -> None:
    """Before a run has said anything twice."""
    for status in runner.statuses.values():
        status.last = status.first
    assert time_left_s(runner, 2) is None
    assert text_of(runner).splitlines()[-1] == '1 of 5 runs finished, 1 failed'


def test_where_there_is_no_terminal_lines_are_written(runner: Runner) -> None:
    """One for each run that begins or ends."""
    console = Console(file=io.StringIO(), width=40)
    statuses = list(runner.statuses.values())
    with shown(runner, 2, False, console) as show:
        show(None)
        for status in statuses[:3]:
            show(status)
    output = console.file
    assert isinstance(output, io.StringIO)
    assert output.getvalue().splitlines() == [
        '   1/5 done    train-rstdp-1-seed0',
        '   1/5 FAILED  train-rstdp-1-seed1: no such lane',
        '   1/5 began   train-rstdp-1-seed2',
    ]
