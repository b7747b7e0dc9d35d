"""Sweeps in experiment files: lists and ranges of a parameter's values."""

from pathlib import Path

import pytest

from spikelane.experiment.file import ExperimentError, ExperimentRecord, read_experiment
from spikelane.experiment.plan import make_plan

BLOCK = """name: a
matrix:
  controllers: [rstdp]
  seeds: 2
  sweep:
    SWEEP
  tasks: [train]
"""


def read(folder: Path, sweep: str) -> ExperimentRecord:
    """Read a file with a sweep."""
    file = folder / 'some.yaml'
    file.write_text(BLOCK.replace('SWEEP', sweep))
    return read_experiment(file)


@pytest.mark.parametrize(
    ('sweep', 'values'),
    [
        ('rstdp.c_r: [0.003, 1e-2]', {'c_r-0.003': 0.003, 'c_r-0.01': 0.01}),
        (
            'rstdp.c_r: {from: 0.001, to: 0.1, count: 3, scale: log}',
            {'c_r-0.001': 0.001, 'c_r-0.01': 0.01, 'c_r-0.1': 0.1},
        ),
        (
            'rstdp.steering.v_max: {from: 1.5, to: 2.5, count: 3}',
            {'v_max-1.5': 1.5, 'v_max-2': 2.0, 'v_max-2.5': 2.5},
        ),
        (
            'rstdp.poisson.max_events: {from: 10, to: 12, count: 5}',
            {'max_events-10': 10, 'max_events-11': 11, 'max_events-12': 12},
        ),
        (
            'simulator.camera.antialias: [false, true]',
            {'antialias-false': False, 'antialias-true': True},
        ),
    ],
)
def test_the_values_are_those_that_are_said(
    tmp_path: Path, sweep: str, values: dict[str, object]
) -> None:
    """Each has a name, and stands for the parameter."""
    (block,) = read(tmp_path, sweep).blocks
    name = sweep.partition(':')[0]
    expected = {label: {name: value} for label, value in values.items()}
    assert block.axes == {f'sweep.{name}': expected}


def test_every_combination_is_a_run(tmp_path: Path) -> None:
    """Two parameters with two values each, and two seeds."""
    sweep = 'rstdp.c_r: [0.01, 0.03]\n    training.save_every: [50, 60]'
    plan = make_plan(read(tmp_path, sweep))
    assert sorted(run.name for run in plan.runs) == [
        f'train-rstdp-1-c_r-{c_r}-save_every-{every}-seed{seed}'
        for c_r in ('0.01', '0.03')
        for every in (50, 60)
        for seed in (0, 1)
    ]
    found = {
        (
            run.point.parameters['rstdp.c_r'],
            run.point.parameters['training.save_every'],
        )
        for run in plan.runs
    }
    assert found == {(0.01, 50), (0.01, 60), (0.03, 50), (0.03, 60)}


@pytest.mark.parametrize(
    ('sweep', 'message'),
    [
        ('rstdp.c_rr: [1]', r":6: unknown parameter 'rstdp.c_rr', expected one of rstdp\."),
        ('c_r: [1]', r":6: unknown parameter 'c_r', expected one of .*, rstdp.<name>, simulator"),
        ('rstdp.c_r: 0.1', r':6: .*\.sweep\.rstdp\.c_r: expected a list'),
        ('rstdp.c_r: []', r':6: .*: expected a list of at least one'),
        ('rstdp.c_r: [fast]', r':6: .*c_r.*: expected a number'),
        ('rstdp.c_r: {from: 0.1, to: 1}', r":6: .*: expected the key 'count'"),
        ('rstdp.c_r: {from: 0, to: 1, count: 3, scale: log}', r':6: rstdp.c_r: expected a range'),
        ('rstdp.c_r: {from: 0.1, to: 1, count: 1}', r':6: .*: expected a whole number from 2'),
        ('simulator.camera.antialias: {from: 0, to: 1, count: 2}', r':6: .* is no number'),
        ('{}', r':6: .*sweep: expected at least one parameter'),
    ],
)
def test_a_wrong_sweep_is_refused(tmp_path: Path, sweep: str, message: str) -> None:
    """In one line, with what is allowed."""
    with pytest.raises(ExperimentError, match=f'some.yaml{message}'):
        read(tmp_path, sweep)
