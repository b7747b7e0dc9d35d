"""`spikelane reproduce`: what it does, and a tiny one that is killed and gone on with."""

from __future__ import annotations

from collections import Counter
import json
import os
from pathlib import Path
import subprocess
import sys
import time

import pytest

from spikelane.commands.reproduce import _note, experiment_file
from spikelane.experiment.file import read_experiment, with_robot, with_seeds
from spikelane.experiment.plan import make_plan, Plan, PlannedRun

ROOT = Path(__file__).parents[4]
DEADLINE_S = 300.0

#: The command, with files of ours in the place of its own.
COMMAND = """
from pathlib import Path
import sys
from spikelane.commands import reproduce
from spikelane.main import main
reproduce.experiment_file = lambda name: Path(sys.argv[1]) / f'{name}.yaml'
main(['reproduce', *sys.argv[2:]])
"""

TINY = """
name: tiny
description: A look only.
matrix:
  - controllers: [dqn, dqn_snn]
    robots: [kinematic]
    variants:
      short:
        simulator.episode.max_steps: 60
        dqn.network.initial_bound: 0.3     # so that it does now this, now that
    tasks:
      train: {steps: 200}
      transfer: {states: 60, steps: 40}
      evaluate: &a_lap {lanes: [outer]}
  - controllers: [rstdp]
    robots: [kinematic]
    variants: {short: {simulator.episode.max_steps: 60}}
    tasks: {train: {steps: 300}, evaluate: *a_lap}
"""
TRAIN = 'train-dqn-1-rigid-short-seed0'
ORDER = [
    TRAIN,
    'transfer-dqn_snn-1-rigid-short-seed0',
    'evaluate-dqn-1-rigid-short-seed0',
    'evaluate-dqn_snn-1-rigid-short-seed0',
    'train-rstdp-1-rigid-short-seed0',
    'evaluate-rstdp-1-rigid-short-seed0',
]

FAILING = """
name: failing
matrix:
  - controllers: [rstdp]
    variants: {odd: {simulator.robot.physics_step_s: 0.007}}
    tasks: {train: {steps: 100}}
"""


def plan_of(name: str) -> Plan:
    """Return the plan of a file that comes along."""
    return make_plan(read_experiment(ROOT / f'experiments/{name}.yaml'))


def start(folder: Path, *options: str) -> subprocess.Popen[str]:
    """Start the command with files in a folder."""
    return subprocess.Popen(
        [sys.executable, '-c', COMMAND, str(folder), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)},
    )


def steps_of(run: PlannedRun) -> int:
    """Return how long a training is."""
    return int(run.identity['configuration']['training']['steps'])


@pytest.mark.parametrize('name', ['paper', 'paper_quick'])
def test_the_files_are_those_in_the_folder_of_experiments(name: str) -> None:
    """Linked into the package, which takes them along where it is installed."""
    assert experiment_file(name).resolve() == ROOT / f'experiments/{name}.yaml'


@pytest.mark.parametrize('name', ['paper', 'paper_quick'])
def test_all_that_the_paper_has_is_done(name: str) -> None:
    """Every controller learns and drives in every scenario, in two settings."""
    runs = plan_of(name).runs
    seeds = {'paper': 3, 'paper_quick': 1}[name]
    settings = Counter((run.task, run.point.controller, run.point.scenario) for run in runs)
    assert settings == {
        (task, controller, scenario): seeds * count
        for scenario in ('1', '2', '3')
        for task, controller, count in (
            ('train', 'dqn', 1),
            ('transfer', 'dqn_snn', 2),
            ('train', 'rstdp', 2),
            ('evaluate', 'dqn', 1),
            ('evaluate', 'dqn_snn', 2),
            ('evaluate', 'rstdp', 2),
            ('evaluate', 'braitenberg', 1),
        )
    }
    lanes = {
        tuple(run.identity['configuration']['evaluation']['lanes'])
        for run in runs
        if run.task == 'evaluate'
    }
    assert lanes == {{'paper': (), 'paper_quick': ('outer',)}[name]}  # none: every lane
    assert {run.identity['configuration']['simulator']['robot.engine'] for run in runs} == {
        {'paper': 'pybullet', 'paper_quick': 'kinematic'}[name]
    }


def test_trainings_are_as_long_as_what_they_are_to_show() -> None:
    """They are as long as the aims for the steps to a solved task require."""
    runs = [run for run in plan_of('paper').runs if run.task == 'train']
    steps = {
        (run.point.controller, run.point.scenario, run.labels['variants']): steps_of(run)
        for run in runs
    }
    assert steps == {
        ('dqn', '1', 'paper'): 60_000,
        ('dqn', '2', 'paper'): 60_000,
        ('dqn', '3', 'paper'): 100_000,
        ('rstdp', '1', 'paper'): 30_000,
        ('rstdp', '2', 'paper'): 40_000,
        ('rstdp', '3', 'paper'): 120_000,
        ('rstdp', '1', 'best'): 30_000,
        ('rstdp', '2', 'best'): 30_000,
        ('rstdp', '3', 'best'): 30_000,
    }
    deep = [steps_of(run) for run in runs if run.point.controller == 'dqn']
    assert deep == sorted(deep, reverse=True)  # what takes longest begins first


def test_the_paper_s_settings_are_the_default_ones() -> None:
    """The exception is the number of states gathered, which the paper does not give."""
    runs = {run.name: run for run in plan_of('paper').runs}
    transfer = runs['transfer-dqn_snn-2-paper-seed1'].identity['configuration']
    assert (transfer['transfer']['steps'], transfer['transfer']['batch_size']) == (10_000, 50)
    assert transfer['transfer']['learning_rate'] == 1e-4
    assert transfer['transfer']['normalisation'] == 'model'
    best = runs['transfer-dqn_snn-2-best-seed1'].identity['configuration']
    assert (best['transfer']['normalisation'], best['transfer']['decays']) == ('data', True)
    drive = runs['evaluate-dqn_snn-2-best-seed1']
    assert drive.before == 'transfer-dqn_snn-2-best-seed1'
    assert drive.identity['configuration']['dqn_snn']['encoding.frames'] == 10
    assert drive.identity['configuration']['seed'] == 101


def test_a_look_says_that_it_is_one() -> None:
    """The experiment's description on the page says so, also with other seeds."""
    record = read_experiment(ROOT / 'experiments/paper_quick.yaml')
    assert record.description.startswith('A look only, not the reproduction: the outer lane')
    assert _note(record).endswith(' exploration that falls sooner. Robot: kinematic.')
    assert len(make_plan(with_seeds(record, 2)).runs) == 2 * len(make_plan(record).runs)


@pytest.mark.parametrize('name', ['paper', 'paper_quick'])
@pytest.mark.parametrize(
    ('given', 'label', 'expected'),
    [
        ({'simulator.robot.engine': 'rigid'}, 'rigid', ('p3dx', 'rigid')),
        ({'simulator.robot.model': 'rigid'}, 'rigid', ('p3dx', 'rigid')),
        (
            {'simulator.robot.model': 'turtlebot4', 'simulator.robot.engine': 'rigid'},
            'turtlebot4-rigid',
            ('turtlebot4', 'rigid'),
        ),
    ],
)
def test_another_engine_moves_the_robot_in_all_runs(
    name: str, given: dict[str, str], label: str, expected: tuple[str, str]
) -> None:
    """All else is as it was; the runs' names, the folder and the page tell what moves it."""
    usual = read_experiment(ROOT / f'experiments/{name}.yaml')
    record = with_robot(usual, given)
    plan, before = make_plan(record), make_plan(usual)
    assert plan.name == f'{name}_{label}'
    assert _note(record).endswith(f' Robot: {label}.')
    assert _note(usual).endswith({'paper': ' Robot: pybullet.'}.get(name, ' Robot: kinematic.'))
    assert len(plan.runs) == len(before.runs)
    for run, other in zip(plan.runs, before.runs, strict=True):
        simulator = run.identity['configuration']['simulator']
        assert (simulator['robot.model'], simulator['robot.engine']) == expected
        assert f'-{label}-' in run.name
        if expected[0] == 'p3dx':
            before_it = other.identity['configuration']['simulator']
            assert {each for each in simulator if simulator[each] != before_it[each]} == {
                'robot.engine'
            }


@pytest.mark.slow
def test_killed_in_the_middle_it_goes_on_and_reports(tmp_path: Path) -> None:
    """What is done is not done again; the page is in the experiment's folder."""
    pytest.importorskip('torch')
    (tmp_path / 'paper_quick.yaml').write_text(TINY)
    out = tmp_path / 'out'
    options = ('--quick', '--seeds', '1', '--jobs', '1', '--out', str(out), '--json')
    options += ('--robot', 'rigid')  # instead of the file's
    process = start(tmp_path, *options)
    deadline_s = time.monotonic() + DEADLINE_S
    while not list(out.glob('transfer-*/progress.json')):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline_s, 'waited in vain'
        time.sleep(0.01)
    process.kill()
    process.wait()
    kept = (out / TRAIN / 'metrics.json').stat().st_mtime_ns

    process = start(tmp_path, *options)
    output, errors = process.communicate(timeout=2 * DEADLINE_S)
    assert process.returncode == 0, errors + output
    result = json.loads(output)
    assert [(each['name'], each['state']) for each in result['runs']] == [
        (name, 'found' if name == TRAIN else 'done') for name in ORDER
    ]
    assert (out / TRAIN / 'metrics.json').stat().st_mtime_ns == kept
    report = result['report']
    assert report['page'] == str(out / 'report/report.html')
    assert '<strong>A look only. Robot: rigid.</strong>' in Path(report['page']).read_text('utf-8')
    assert report['runs'] == len(ORDER)
    lines = (out / 'log.jsonl').read_text().splitlines()
    profile = json.loads(lines[-1])
    assert profile['event'] == 'profile'
    kinds = {each['kind']: each['runs'] for each in profile['costs']}
    assert kinds.pop('report') == 1
    assert kinds == Counter(f'{each["task"]} {each["controller"]}' for each in result['runs'])
    assert sum(each['share'] for each in profile['costs']) == pytest.approx(1.0, abs=1e-3)
    assert all(each['processor_s'] > 0 for each in profile['costs'])
    names = {Path(file).name for file in report['figures']}
    assert {'training_time.png', 'deviation_scenario_1.png', 'scenarios.png'} <= names


def test_where_nothing_can_be_reported_on_the_reason_is_told(tmp_path: Path) -> None:
    """Exit status 1; for machines, too."""
    (tmp_path / 'paper.yaml').write_text(FAILING)
    process = start(tmp_path, '--seeds', '1', '--out', str(tmp_path / 'out'), '--json')
    output, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1, errors
    result = json.loads(output)
    assert result['report'] is None
    (failed,) = result['runs']
    assert failed['message'].startswith('physics_step_s: expected a whole fraction of 0.05 s')


@pytest.mark.parametrize(('option', 'most'), [('--seeds', 100_000), ('--jobs', 10_000)])
def test_wrong_use_is_told_in_one_line(tmp_path: Path, option: str, most: int) -> None:
    """Exit status 2, and nothing is made."""
    process = start(ROOT / 'experiments', option, '0', '--out', str(tmp_path / 'out'))
    _, errors = process.communicate(timeout=DEADLINE_S)
    message = f'spikelane reproduce: {option}: expected a whole number from 1 to {most}, got 0\n'
    assert (process.returncode, errors) == (2, message)
    assert not (tmp_path / 'out').exists()
