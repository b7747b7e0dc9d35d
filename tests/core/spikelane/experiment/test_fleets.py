"""Experiments in fleets: the same folders as with a process for every run, whatever happens."""

from __future__ import annotations

import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

import pytest
import yaml

from spikelane.commands.experiment import local_engine
from spikelane.experiment.engine import Ended
from spikelane.experiment.file import ExperimentError, read_experiment
from spikelane.experiment.plan import make_plan, make_run_folder
from spikelane.experiment.runner import Runner, RunStatus
from spikelane.experiment.worker import LOG, main
from spikelane.runs.folder import RunFolder
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_sim.errors import CheckpointError

DEADLINE_S = 240.0

#: Short episodes; two courses and two seeds are one fleet.
TEXT = """
name: some
matrix:
  controllers: [rstdp]
  scenarios: [1, 3]
  robots: [kinematic]
  seeds: 2
  variants:
    short: {simulator.episode.max_distance_m: 0.05, training.save_every: 10}
  conditions:
    brief: {simulator.episode.max_steps: 60}
  tasks:
    train: {steps: 3000}
    evaluate: {seeds: 2, lanes: [outer]}
"""

#: What tells when, where and by which version something was done.
TIMES = ('versions', 'wall_time_s', 'processor_s', 'folder', 'checkpoint', 'figures', 'time')


def experiment_in(folder: Path, text: str = TEXT) -> Path:
    """Write an experiment's file; return it."""
    folder.mkdir(exist_ok=True)
    file = folder / 'some.yaml'
    file.write_text(text)
    return file


def start(file: Path, out: Path, *options: str, engine: str = 'fleet') -> subprocess.Popen[str]:
    """Start the command."""
    command = [sys.executable, '-m', 'spikelane.main', 'experiment', str(file), '--out', str(out)]
    return subprocess.Popen(
        [*command, '--json', '--engine', engine, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def finish(process: subprocess.Popen[str], status: int = 0) -> dict[str, Any]:
    """Wait for the command; return the object printed."""
    output, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == status, errors
    return dict(json.loads(output))


def log_of(out: Path) -> list[dict[str, Any]]:
    """Return an experiment's log."""
    return [json.loads(line) for line in (out / 'log.jsonl').read_text().splitlines()]


def files_in(out: Path) -> dict[str, Any]:
    """Return all that runs left, without times and places."""
    found: dict[str, Any] = {}
    for file in sorted(out.glob('*/**/*')):
        name = str(file.relative_to(out))
        if file.is_dir() or name.endswith(('processor_time.json', '.nc')):
            continue
        content: Any = file.read_bytes()
        if file.name in ('metrics.json', 'config.yaml'):
            values = yaml.safe_load(content)
            content = {key: value for key, value in values.items() if key not in TIMES}
            if 'rstdp' in content:  # the weights' place is the experiment's folder
                content['rstdp'] = {**content['rstdp'], 'checkpoint': ''}
            for entry in ('given', 'inputs'):
                content[entry] = json.dumps(content.get(entry)).replace(str(out.absolute()), '')
        elif file.suffix == '.svg':
            content = len(content)
        found[name] = content
    return found


@pytest.fixture(scope='module')
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the folder of the experiment with a process for every run."""
    folder = tmp_path_factory.mktemp('alone')
    finish(start(experiment_in(folder), folder / 'out', '--jobs', '2', engine='local'))
    return folder / 'out'


def assert_same(out: Path, alone: Path) -> None:
    """Assert that an experiment left what the other one did."""
    mine, expected = files_in(out), files_in(alone)
    assert sorted(mine) == sorted(expected)
    assert [name for name in expected if mine[name] != expected[name]] == []
    ours, theirs = (json.loads((each / 'results.json').read_text()) for each in (out, alone))
    assert ours == theirs


def test_killed_fleets_go_on_and_leave_the_same_folders(tmp_path: Path, alone: Path) -> None:
    """Everything is killed amid the trainings; the same command goes on."""
    file, out = experiment_in(tmp_path), tmp_path / 'out'
    process = start(file, out, '--jobs', '1')
    name = 'train-rstdp-1-kinematic-short-seed0'
    deadline_s = time.monotonic() + DEADLINE_S
    while not 100 <= _steps_of(out / name) < 2500:
        assert process.poll() is None
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    process.kill()
    process.wait()
    finish(start(file, out, '--jobs', '1'))
    begun = [each for each in log_of(out) if each['event'] == 'start']
    # On one processor, all runs of a setting are together, on both courses.
    trainings = [each for each in begun if each['run'].startswith('train')]
    assert [(each['together'], each['is_continued']) for each in trainings] == (
        [(4, False)] * 4 + [(4, True)] * 4
    )
    laps = [each['together'] for each in begun if each['run'].startswith('evaluate')]
    assert laps == [4] * 4
    assert_same(out, alone)


def _steps_of(folder: Path) -> int:
    """Return at how many steps a training stands."""
    try:
        return int(read_checkpoint(folder, 'rstdp').facts['steps'])
    except CheckpointError:
        return -1


def test_short_runs_leave_the_same_without_a_kernel(tmp_path: Path, alone: Path) -> None:
    """By default they are done one after the other in one process."""
    file, out = experiment_in(tmp_path), tmp_path / 'out'
    finish(start(file, out, '--jobs', '1', engine='auto'))
    assert {each['together'] for each in log_of(out) if each['event'] == 'start'} == {4}
    assert_same(out, alone)


@pytest.mark.parametrize('engine', ['auto', 'fleet'])
def test_one_that_fails_does_not_lose_the_others(engine: str, tmp_path: Path) -> None:
    """It is begun again alone, then reported; the others are done in their fleet."""
    text = TEXT.replace('3000', '200').replace('scenarios: [1, 3]', 'scenarios: [1]')
    text = text.replace('    evaluate: {seeds: 2, lanes: [outer]}\n', '')
    file, out = experiment_in(tmp_path, text), tmp_path / 'out'
    out.mkdir()
    runner = Runner(make_plan(read_experiment(file)), out, 2)
    broken, fine = runner.statuses
    make_run_folder(out, runner.statuses[broken].run, None).checkpoint.write_bytes(b'nothing')
    results = finish(start(file, out, '--jobs', '1', engine=engine), status=1)
    states = {each['name']: each['state'] for each in results['runs']}
    assert states == {broken: 'failed', fine: 'done'}
    events = [each for each in log_of(out) if each.get('run') == broken]
    assert [each['event'] for each in events] == ['start', 'retry', 'start', 'fail']
    assert [each.get('together') for each in events] == [2, None, 1, None]
    assert all('checkpoint.safetensors' in each['message'] for each in events[1::2])


class _Engine:
    """Notes what it is given, and ends all at once."""

    slots, does_together = 2, True

    def __init__(self) -> None:
        self.started: list[int] = []
        self.first: list[tuple[str, int]] = []  # the first run of each process, and how many
        self._runs: list[dict[str, Path]] = []

    @property
    def busy(self) -> int:
        return len(self._runs)

    def start(self, runs: dict[str, Path]) -> None:
        self.started.append(len(runs))
        self.first.append((next(iter(runs)), len(runs)))
        self._runs.append(dict(runs))

    def ended(self) -> Any:
        for name, folder in (item for runs in self._runs for item in runs.items()):
            RunFolder(folder).write_metrics({})
            yield Ended(name, 0, '')
        self._runs = []

    def stop(self) -> None:
        pass


@pytest.mark.parametrize(
    ('slots', 'seeds', 'robot', 'expected'),
    [
        (1, 20, 'kinematic', [20]),
        (2, 20, 'kinematic', [10, 10]),
        (64, 20, 'kinematic', [1] * 20),
        (1, 70, 'kinematic', [64, 6]),
        (1, 20, 'pybullet', [8, 8, 4]),
        (4, 20, 'pybullet', [5] * 4),
    ],
)
def test_runs_are_divided_among_the_processes(
    slots: int, seeds: int, robot: str, expected: list[int], tmp_path: Path
) -> None:
    """What can be begun is divided by how many there are; physics engines need memory."""
    text = """
name: some
matrix:
  controllers: [rstdp]
  robots: [ROBOT]
  seeds: SEEDS
  tasks: {train: {steps: 100}}
"""
    text = text.replace('SEEDS', str(seeds)).replace('ROBOT', robot)
    plan = make_plan(read_experiment(experiment_in(tmp_path, text)))
    engine = _Engine()
    engine.slots = slots
    runner = Runner(plan, tmp_path, 0)
    runner.run(engine, lambda status: None)
    assert engine.started == expected
    assert {status.state for status in runner.statuses.values()} == {RunStatus.DONE}


@pytest.mark.parametrize(
    ('settings', 'seeds', 'expected'),
    [
        (2, 6, [('a', 3), ('b', 3), ('a', 2), ('b', 2), ('a', 1), ('b', 1)]),
        (12, 3, [(name, 3) for name in 'abcdefgh']),
    ],
)
def test_few_settings_are_divided_and_many_are_not(
    settings: int, seeds: int, expected: list[tuple[str, int]], tmp_path: Path
) -> None:
    """Two processes begin with two settings, so that each compiles a kernel of its own."""
    names = 'abcdefghijkl'[:settings]
    variants = ', '.join(f'{name}: {{rstdp.c_r: 0.0{ord(name)}}}' for name in names)
    text = f"""
name: some
matrix:
  controllers: [rstdp]
  robots: [kinematic]
  seeds: {seeds}
  variants: {{{variants}}}
  tasks: {{train: {{steps: 100}}}}
"""
    plan = make_plan(read_experiment(experiment_in(tmp_path, text)))
    engine = _Engine()
    Runner(plan, tmp_path, 0).run(engine, lambda status: None)
    begun = [(name.split('-')[4], number) for name, number in engine.first]
    assert begun[: len(expected)] == expected


def test_what_the_kernel_lacks_is_done_alone(tmp_path: Path) -> None:
    """Such as a network that learns on a GPU; it has no setting in common with anything."""
    text = """
name: some
matrix:
  controllers: [rstdp, dqn]
  robots: [kinematic, pybullet]
  variants: {plain: {}, filtered: {filter.chain: refractory}, gpu: {dqn.q_learning.device: cuda}}
  tasks: {train: {steps: 100}}
"""
    plan = make_plan(read_experiment(experiment_in(tmp_path, text)))
    assert {run.name for run in plan.runs if not run.setting} == {
        'train-dqn-1-kinematic-gpu-seed0',
        'train-dqn-1-pybullet-gpu-seed0',
    }
    together = {run.setting: run.most_together for run in plan.runs if run.setting}
    assert len(together) == 8
    assert sorted(together.values()) == [8] * 4 + [64] * 4
    assert local_engine(3).does_together
    assert local_engine(3, 'fleet').does_together
    assert not local_engine(3, 'local').does_together


def test_each_of_several_says_why_it_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first in the process's output, which is its log, the others in their own."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        for name in 'ab':
            (tmp_path / name).mkdir()
        assert main([str(tmp_path / 'a'), str(tmp_path / 'b')]) == 1
    finally:
        signal.signal(signal.SIGTERM, before)
    assert 'a/run.json: cannot be read' in capsys.readouterr().err
    assert 'b/run.json: cannot be read' in (tmp_path / 'b' / LOG).read_text()


def test_runs_that_record_are_others_and_are_done_alone(tmp_path: Path) -> None:
    """Trainings and laps leave recordings; the controller must offer what is asked for."""
    text = """
name: some
matrix:
  controllers: [rstdp]
  robots: [kinematic]
  conditions: {brief: {simulator.episode.max_steps: 20}}
  tasks:
    train: {steps: 50, record: [weights]}
    evaluate: {lanes: [outer], record: [spikes]}
"""
    file, out = experiment_in(tmp_path, text), tmp_path / 'out'
    plan = make_plan(read_experiment(file))
    assert [run.setting for run in plan.runs] == ['', '']
    plain = make_plan(read_experiment(experiment_in(tmp_path, text.replace('[weights]', '[]'))))
    assert plain.runs[0].key != plan.runs[0].key
    experiment_in(tmp_path, text)
    finish(start(file, out, '--jobs', '2'))
    recordings = sorted(str(each.relative_to(out)) for each in out.glob('**/recording.nc'))
    assert recordings == [
        'evaluate-rstdp-1-kinematic-brief-seed0/laps/outer-seed0/recording.nc',
        'train-rstdp-1-kinematic-seed0/recording.nc',
    ]
    with pytest.raises(ExperimentError, match=r'evaluate rstdp: record: expected .*, got dreams'):
        make_plan(read_experiment(experiment_in(tmp_path, text.replace('[spikes]', '[dreams]'))))
