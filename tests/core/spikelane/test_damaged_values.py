"""Values of a wrong kind in the files of runs are named with their file, in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from spikelane.experiment.file import read_experiment
from spikelane.experiment.plan import make_plan
from spikelane.experiment.results import experiment_results
from spikelane.experiment.runner import RunStatus, Status
from spikelane.experiment.worker import Progress, read_progress, read_run
from spikelane.runs.configuration import Request
from spikelane.runs.evaluate.config import EvaluateConfig
from spikelane.runs.evaluate.run import evaluate
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.trajectory import COLUMNS, read_csv, TrajectoryError
from spikelane_sim.files import FileError
from spikelane_sim.parsing import parse_json, parse_yaml, ParseError

_LAP: dict[str, Any] = {
    'course': '1',
    'lane': 'outer',
    'seed': 1,
    'completed': True,
    'steps': 4000,
    'lap_time_s': 200.0,
    'mean_abs_distance_m': 0.02,
    'max_abs_distance_m': 0.1,
    'mean_distance_m': 0.01,
    'std_distance_m': 0.01,
    'mean_speed_m_s': 0.3,
    'progress_m': 60.0,
    'operations': None,
}


@pytest.mark.parametrize(
    ('name', 'value', 'expected'),
    [
        ('lane', ['outer'], 'lane: expected a text'),
        ('steps', '4000', 'steps: expected a whole number'),
        ('steps', -1, 'steps: expected a whole number of at least 0, got -1'),
        ('progress_m', None, 'progress_m: expected a number'),
        ('lap_time_s', None, 'lap_time_s: expected a number'),
        ('operations', {'synapses': 1}, 'operations.synapses: expected one of decisions'),
        ('operations', {'synaptic': 10**400}, 'whole numbers of at most 64 bits'),
    ],
)
def test_a_resumed_evaluation_names_what_is_wrong_with_a_lap(
    name: str, value: Any, expected: str, tmp_path: Path
) -> None:
    """One that was driven before, and is not driven again."""
    config = EvaluateConfig.make(
        Request('1', 'braitenberg', 1, 'inprocess', {}), {'lanes': ['outer']}
    )
    lap = tmp_path / 'laps/outer-seed1'
    lap.mkdir(parents=True)
    (lap / 'metrics.json').write_text(json.dumps(_LAP))
    show = lambda *progress: None  # noqa: E731
    assert evaluate(config, RunFolder(tmp_path), show)['laps'] == [_LAP]
    (lap / 'metrics.json').write_text(json.dumps(_LAP | {name: value}))
    with pytest.raises(FileError, match=rf'laps/outer-seed1/metrics\.json: .*{expected}'):
        evaluate(config, RunFolder(tmp_path), show)


def _finished(folder: Path, task: str, metrics: dict[str, Any]) -> list[Status]:
    """Return an experiment's one run with what came out of it."""
    controller = 'rstdp' if task == 'train' else 'braitenberg'
    (folder / 'tiny.yaml').write_text(
        f'name: tiny\nmatrix: {{controllers: [{controller}], seeds: 1, tasks: {{{task}: {{}}}}}}\n'
    )
    (folder / 'metrics.json').write_text(json.dumps(metrics))
    [run] = make_plan(read_experiment(folder / 'tiny.yaml')).runs
    return [Status(run, RunStatus.DONE, RunFolder(folder))]


@pytest.mark.parametrize(
    ('task', 'metrics', 'expected'),
    [
        ('train', {'steps': 10, 'last_lane_loss_step': '3'}, 'last_lane_loss_step: expected a'),
        (
            'train',
            {'steps': 10, 'solved_by': [1]},
            'solved_by: expected a whole number or nothing',
        ),
        ('train', {'solved_by': None}, 'steps: expected a whole number, got none'),
        ('train', {'steps': 10**400}, 'expected whole numbers of at most 64 bits'),
        ('train', {'steps': 10, 'episodes': 1e308}, r'episodes: expected a number, got 1e\+308'),
        ('evaluate', {'laps': 3}, 'laps: expected a list, got 3'),
        ('evaluate', {'laps': [{**_LAP, 'seed': {}}]}, r'laps\[0\]\.seed: expected a whole'),
        ('evaluate', {'laps': [{**_LAP, 'lap_time_s': None}]}, r'laps\[0\]\.lap_time_s: expected'),
        ('evaluate', {'operations': {'decisions_per_s': []}}, 'operations.decisions_per_s: exp'),
    ],
)
def test_an_experiment_names_what_is_wrong_with_the_metrics_of_a_run(
    task: str, metrics: dict[str, Any], expected: str, tmp_path: Path
) -> None:
    """Its results would have been computed with it."""
    with pytest.raises(FileError, match=rf'metrics\.json: {expected}'):
        experiment_results('tiny', _finished(tmp_path, task, metrics))


@pytest.mark.parametrize(
    ('content', 'expected'),
    [
        ('[]', 'expected names and values, got []'),
        ('{"identity": {"task": "train"}}', 'point: expected names and values, got none'),
        ('{"point": {"seed": 1}}', 'point.controller: expected a text, got none'),
    ],
)
def test_a_worker_names_what_is_wrong_with_its_run(
    content: str, expected: str, tmp_path: Path
) -> None:
    """Before it begins."""
    (tmp_path / 'run.json').write_text(content)
    with pytest.raises(FileError) as caught:
        read_run(RunFolder(tmp_path))
    assert str(caught.value).startswith(f'{tmp_path}/run.json: {expected}')


@pytest.mark.parametrize('content', ['[]', '{"steps": "1", "share": 0}', '{"steps": 1}', '', 'x'])
def test_progress_that_is_none_is_not_shown(content: str, tmp_path: Path) -> None:
    """The run goes on all the same."""
    path = tmp_path / 'progress.json'
    path.write_text('{"steps": 1, "share": 0.5}')
    assert read_progress(RunFolder(tmp_path)) == Progress(1, 0.5)
    path.write_text(content)
    assert read_progress(RunFolder(tmp_path)) is None


@pytest.mark.parametrize(
    ('name', 'text', 'expected'),
    [
        ('events', str(2**63), ':2: events: expected a whole number of 64 bits'),
        ('step', '1.0', ':2: step: expected a whole number of 64 bits'),
        ('distance_m', 'nan', ':2: distance_m: expected a number'),
        ('x_m', '1e999', ':2: x_m: expected a number'),
        (None, '', ': expected at least one observation, got none'),
    ],
)
def test_a_trajectory_names_what_is_wrong_with_it(
    name: str | None, text: str, expected: str, tmp_path: Path
) -> None:
    """With the line; a command that is missing is NaN and no fault."""
    values = dict.fromkeys(COLUMNS, '0') | {'left_rad_s': 'nan'}
    header = ','.join(['lane', *COLUMNS, 'reason'])

    def write(row: dict[str, str] | None) -> Path:
        line = '' if row is None else ','.join(['outer', *row.values(), ''])
        path = tmp_path / 'trajectory.csv'
        path.write_text(f'{header}\n{line}')
        return path

    assert len(read_csv(write(values))) == 1
    path = write(None if name is None else values | {name: text})
    with pytest.raises(TrajectoryError) as caught:
        read_csv(path)
    assert str(caught.value).startswith(f'{path}{expected}')


@pytest.mark.parametrize('text', [str(2**64), str(-(2**63) - 1), '[1, {"a": ' + '9' * 4000 + '}]'])
def test_whole_numbers_of_more_than_64_bits_are_refused(text: str) -> None:
    """In JSON and in YAML; the largest of 64 bits is read."""
    for parse in (parse_json, parse_yaml):
        with pytest.raises(ParseError, match=r'^expected whole numbers of at most 64 bits$'):
            parse(text)
        assert parse(f'[{2**64 - 1}, {-(2**63)}]') == [2**64 - 1, -(2**63)]


@pytest.mark.parametrize('text', ['NaN', '[-Infinity]', '{"a": 1e999}'])
def test_json_with_numbers_that_are_not_finite_is_refused(text: str) -> None:
    """JSON lacks them, though Python reads them."""
    with pytest.raises(ParseError, match=r'^not JSON: expected finite numbers, got '):
        parse_json(text)
