"""`spikelane experiment`: real little runs in processes, killed and gone on with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

import pytest

from spikelane.main import run
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_sim.errors import CheckpointError

DEADLINE_S = 240.0

#: Uneven weights that lead off the lane soon: several episodes; laps that end early.
TINY = """
name: tiny
matrix:
  controllers: [rstdp]
  robots: [kinematic]
  seeds: [3]
  variants:
    swerving:
      rstdp.initial_weights.low_pa: 100.0
      rstdp.initial_weights.high_pa: 500.0
      simulator.episode.max_steps: 130
  tasks:
    train: {steps: 60_000}
    evaluate: {lanes: [outer], seeds: 2}
"""
TRAIN, EVALUATE = (
    'train-rstdp-1-kinematic-swerving-seed3',
    ('evaluate-rstdp-1-kinematic-swerving-seed3'),
)
RESULTS = (
    f'{TRAIN}/checkpoint.safetensors',
    f'{TRAIN}/episodes.csv',
    f'{EVALUATE}/metrics.json',
    f'{EVALUATE}/laps/outer-seed3/trajectory.csv',
    f'{EVALUATE}/laps/outer-seed4/trajectory.csv',
)


#: A Q-network that has hardly learnt anything, its policy in spikes, and a lap cut short.
DEEP = """
name: deep
matrix:
  controllers: [dqn, dqn_snn]
  robots: [kinematic]
  seeds: [3]
  variants:
    short:
      dqn.q_learning.random_steps: 40
      dqn.q_learning.learning_rate: 0.01
      transfer.batch_size: 20
  tasks:
    train: {steps: 80}
    transfer: {states: 400, steps: 60}
"""
LEARN, TRANSFER = (
    'train-dqn-1-kinematic-short-seed3',
    'transfer-dqn_snn-1-kinematic-short-seed3',
)
DEEP_RESULTS = (f'{LEARN}/checkpoint.safetensors', f'{LEARN}/states.zst')


class Experiment:
    """An experiment in a folder, by the command.

    Attributes:
        folder: Folder of the experiment.
    """

    def __init__(self, folder: Path, text: str = TINY) -> None:
        self.folder = folder / 'out'
        self._file = folder / 'tiny.yaml'
        self._file.write_text(text)

    def start(self, *options: str) -> subprocess.Popen[str]:
        """Start the command."""
        command = [sys.executable, '-m', 'spikelane.main', 'experiment', str(self._file)]
        return subprocess.Popen(
            [*command, '--out', str(self.folder), '--jobs', '2', *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)},
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )

    def finish(self, *options: str, status: int = 0) -> dict[str, Any]:
        """Run the command to its end; return the one object printed."""
        process = self.start('--json', *options)
        output, errors = process.communicate(timeout=DEADLINE_S)
        assert process.returncode == status, errors
        return dict(json.loads(output))

    def log(self) -> list[dict[str, Any]]:
        """Return the log."""
        return [json.loads(line) for line in (self.folder / 'log.jsonl').read_text().splitlines()]

    def events(self, run: str) -> list[str]:
        """Return what happened to a run."""
        return [entry['event'] for entry in self.log() if entry.get('run') == run]

    def results(self, names: Sequence[str] = RESULTS) -> dict[str, bytes]:
        """Return all that must be the same however it came about."""
        return {name: (self.folder / name).read_bytes() for name in names}

    def saved_steps(self) -> int:
        """Return the steps in the training's checkpoint, -1 where there is none."""
        try:
            return int(read_checkpoint(self.folder / TRAIN, 'rstdp').facts['steps'])
        except CheckpointError:
            return -1

    def workers(self) -> list[int]:
        """Return the processes that do its runs."""
        return [pid for pid, command in commands().items() if self._is_worker(command)]

    def _is_worker(self, command: list[str]) -> bool:
        return 'spikelane.experiment.worker' in command and str(self.folder) in command[-1]


def commands() -> dict[int, list[str]]:
    """Return the command lines of all processes."""
    found = {}
    for path in Path('/proc').glob('[0-9]*/cmdline'):
        try:
            found[int(path.parent.name)] = path.read_text().rstrip('\0').split('\0')
        except OSError:
            continue
    return found


def wait_until(is_so: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    """Wait while a process runs."""
    deadline_s = time.monotonic() + DEADLINE_S
    while not is_so():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline_s, 'waited in vain'
        time.sleep(0.005)


def wait_while(is_so: Callable[[], bool]) -> None:
    """Wait until something is no longer so."""
    deadline_s = time.monotonic() + DEADLINE_S
    while is_so():
        assert time.monotonic() < deadline_s, 'waited in vain'
        time.sleep(0.005)


@pytest.fixture(scope='module')
def whole(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """Give an experiment that nobody disturbed."""
    experiment = Experiment(tmp_path_factory.mktemp('whole'))
    experiment.finish()
    return experiment


def test_a_run_is_what_the_command_for_it_leaves(whole: Experiment, tmp_path: Path) -> None:
    """Training and evaluation with the same parameters, one after the other."""
    common = ['--seed', '3', '--robot', 'kinematic', '--json']
    for each in ('initial_weights.low_pa=100', 'initial_weights.high_pa=500'):
        common += ['--param', f'rstdp.{each}']
    common += ['--param', 'simulator.episode.max_steps=130']
    trained, evaluated = tmp_path / 'trained', tmp_path / 'evaluated'
    before = signal.getsignal(signal.SIGTERM)
    try:
        assert run(['train', 'rstdp', '--steps', '60000', '--out', str(trained), *common]) == 0
        evaluate = ['evaluate', '--controller', 'rstdp', '--checkpoint', str(trained)]
        evaluate += ['--lanes', 'outer', '--seeds', '2', '--out', str(evaluated), *common]
        assert run(evaluate) == 0
    finally:
        signal.signal(signal.SIGTERM, before)
    folders = {TRAIN: trained, EVALUATE: evaluated}
    for name, content in whole.results().items():
        folder, _, rest = name.partition('/')
        assert (folders[folder] / rest).read_bytes() == content


def test_everything_is_told_in_the_log_and_the_results(whole: Experiment) -> None:
    """In the order in which it happened."""
    events = [(entry['event'], entry.get('run')) for entry in whole.log()]
    assert events[:6] == [
        ('begin', None),
        ('start', TRAIN),
        ('done', TRAIN),
        ('start', EVALUATE),
        ('done', EVALUATE),
        ('finish', None),
    ]
    results = json.loads((whole.folder / 'results.json').read_text())
    states = {each['name']: each['state'] for each in results['runs']}
    assert states == {TRAIN: 'done', EVALUATE: 'done'}
    train, evaluate = results['groups']
    assert (train['task'], train['robots'], train['seeds']) == ('train', 'kinematic', [3])
    assert train['metrics']['steps']['mean'] == 60_000
    assert evaluate['laps']['all']['completed'] == {
        'n': 2,
        'successes': 0,
        'share': 0.0,
        'ci_low': 0.0,
        'ci_high': pytest.approx(0.657620, abs=1e-6),
    }


def test_what_is_finished_is_not_done_again(whole: Experiment) -> None:
    """Nothing is started, whatever it is called; a dry run says so."""
    before = {path: path.stat().st_mtime_ns for path in whole.folder.glob('*/*')}
    result = whole.finish()
    assert {each['state'] for each in result['runs']} == {'found'}
    assert {path: path.stat().st_mtime_ns for path in whole.folder.glob('*/*')} == before
    renamed = Experiment(whole.folder.parent, TINY.replace('swerving', 'other'))
    listed = renamed.finish('--dry-run')
    assert [(each['name'], each['state'], each['folder']) for each in listed['runs']] == [
        ('train-rstdp-1-kinematic-other-seed3', 'finished', TRAIN),
        ('evaluate-rstdp-1-kinematic-other-seed3', 'finished', EVALUATE),
    ]


@pytest.mark.slow
def test_killed_again_and_again_the_results_are_the_same(
    whole: Experiment, tmp_path: Path
) -> None:
    """A worker, the command, a Ctrl-C: each time it goes on where the checkpoint stands."""
    experiment = Experiment(tmp_path)
    process = experiment.start()
    wait_until(lambda: experiment.saved_steps() >= 100, process)
    (worker,) = experiment.workers()
    os.kill(worker, signal.SIGKILL)
    wait_until(lambda: experiment.events(TRAIN) == ['start', 'retry', 'start'], process)
    wait_until(lambda: worker not in experiment.workers() != [], process)
    process.kill()
    process.wait()
    kept = experiment.saved_steps()
    assert 100 <= kept < 60_000

    process = experiment.start()
    wait_until(lambda: experiment.saved_steps() > kept, process)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 130, errors
    assert 'stopped, 0 of 2 runs are finished; the same command goes on' in errors
    assert experiment.workers() == []
    assert experiment.log()[-1]['event'] == 'interrupt'

    experiment.finish()
    assert experiment.results() == whole.results()
    assert experiment.events(TRAIN)[-3:] == ['start', 'start', 'done']


def parent_of(pid: int) -> int:
    """Return the process that started another."""
    return int(Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[1])


@pytest.mark.slow
def test_a_cluster_gives_the_same_results_though_a_worker_is_killed(
    whole: Experiment, tmp_path: Path
) -> None:
    """Ray on this machine with two workers, both at work; the run of the one killed goes on."""
    pytest.importorskip('ray')
    # Long enough to be at work when the other worker begins, however late Ray starts it.
    other = """
  - controllers: [braitenberg]
    robots: [kinematic]
    tasks: {evaluate: {seeds: 20}}
"""
    matrix = TINY.replace('\n  controllers', '\n  - controllers').splitlines()
    block = [
        line if line.startswith((' ' * 2 + '-', 'name', 'm')) else f'  {line}' for line in matrix
    ]
    experiment = Experiment(tmp_path, '\n'.join(block) + other)
    process = experiment.start('--engine', 'ray', '--json')
    wait_until(lambda: len(experiment.workers()) == 2, process)
    wait_until(lambda: experiment.saved_steps() >= 100, process)
    training = next(pid for pid in experiment.workers() if TRAIN in commands()[pid][-1])
    os.kill(parent_of(training), signal.SIGKILL)
    output, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0, errors
    assert {each['state'] for each in json.loads(output)['runs']} == {'done'}
    assert experiment.events(TRAIN) == ['start', 'retry', 'start', 'done']
    assert experiment.results() == whole.results()


@pytest.fixture(scope='module')
def deep(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """Give an experiment with a transfer that nobody disturbed."""
    pytest.importorskip('torch')
    experiment = Experiment(tmp_path_factory.mktemp('deep'), DEEP)
    experiment.finish()
    return experiment


@pytest.mark.slow
def test_a_transfer_is_what_the_command_for_it_leaves(deep: Experiment, tmp_path: Path) -> None:
    """The networks bit for bit, and what is said of them; its accuracy is among the results."""
    alone = tmp_path / 'alone'
    command = ['transfer', '--checkpoint', str(deep.folder / LEARN), '--states', '400']
    command += ['--steps', '60', '--param', 'transfer.batch_size=20', '--robot', 'kinematic']
    before = signal.getsignal(signal.SIGTERM)
    try:
        assert run([*command, '--seed', '3', '--out', str(alone)]) == 0
    finally:
        signal.signal(signal.SIGTERM, before)
    weights = 'checkpoint.safetensors'
    assert (alone / weights).read_bytes() == (deep.folder / TRANSFER / weights).read_bytes()
    measured, expected = (
        {
            name: value
            for name, value in json.loads((folder / 'metrics.json').read_text()).items()
            if name not in ('folder', 'checkpoint', 'figures')
        }
        for folder in (deep.folder / TRANSFER, alone)
    )
    assert measured == expected
    assert measured['states_from'] == {'training': 80, 'gathered': 400}
    _, group = json.loads((deep.folder / 'results.json').read_text())['groups']
    assert (group['task'], group['controller']) == ('transfer', 'dqn_snn')
    assert group['metrics']['accuracy']['mean'] == measured['accuracy']
    progress = json.loads((deep.folder / TRANSFER / 'progress.json').read_text())
    assert progress == {'steps': 400 * 10 + 60, 'share': 1.0}


@pytest.mark.slow
def test_a_transfer_that_is_killed_is_done_again(deep: Experiment, tmp_path: Path) -> None:
    """With the same results, and the training before it not once more."""
    experiment = Experiment(tmp_path, DEEP)
    process = experiment.start()
    wait_until(lambda: (experiment.folder / TRANSFER / 'progress.json').exists(), process)
    process.kill()
    process.wait()
    wait_while(lambda: experiment.workers() != [])
    assert not (experiment.folder / TRANSFER / 'metrics.json').exists()
    experiment.finish()
    assert experiment.events(LEARN) == ['start', 'done']
    assert experiment.events(TRANSFER) == ['start', 'start', 'done']
    assert experiment.results(DEEP_RESULTS) == deep.results(DEEP_RESULTS)
    # That of a transfer says whose policy it is, by its folder.
    one, other = (
        read_checkpoint(each.folder / TRANSFER, 'dqn_snn') for each in (experiment, deep)
    )
    assert one.arrays.keys() == other.arrays.keys()
    assert all((one.arrays[name] == other.arrays[name]).all() for name in other.arrays)


FAILING = """
name: failing
matrix:
  - controllers: [rstdp]
    variants: {odd: {simulator.robot.physics_step_s: 0.007}}
    tasks: {train: {steps: 100}, evaluate: {}}
  - controllers: [braitenberg]
    robots: [kinematic]
    variants: {short: {simulator.episode.max_steps: 30}}
    tasks: [evaluate]
"""


def test_a_failed_run_is_reported_and_the_others_go_on(tmp_path: Path) -> None:
    """Exit status 1; it is tried again by the next call, and only it."""
    experiment = Experiment(tmp_path, FAILING)
    for _ in range(2):
        failed, blocked, other = experiment.finish(status=1)['runs']
        assert (failed['state'], blocked['state']) == ('failed', 'blocked')
        assert failed['message'].startswith('physics_step_s: expected a whole fraction of 0.05 s')
        assert blocked['message'] == 'needs train-rstdp-1-odd-seed0'
    assert other['state'] == 'found'
    assert experiment.events('train-rstdp-1-odd-seed0') == ['start', 'fail', 'start', 'fail']
    assert experiment.events('evaluate-braitenberg-1-kinematic-short-seed0') == ['start', 'done']


def test_a_folder_is_used_by_one_command_at_a_time(tmp_path: Path) -> None:
    """The other is told so."""
    experiment = Experiment(tmp_path)
    first = experiment.start()
    wait_until(lambda: (experiment.folder / 'log.jsonl').exists(), first)
    # It does not finish before the other one has begun, however slow that is.
    first.send_signal(signal.SIGSTOP)
    second = experiment.start()
    _, errors = second.communicate(timeout=DEADLINE_S)
    assert second.returncode == 1
    assert errors == (
        f'spikelane experiment: {experiment.folder}: another process works here: {first.pid}\n'
    )
    first.send_signal(signal.SIGTERM)
    first.send_signal(signal.SIGCONT)
    first.communicate(timeout=DEADLINE_S)
    assert first.returncode == 143


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        (['--jobs', '0'], '--jobs: expected a whole number from 1 to 10000, got 0'),
        (['--retries', '-1'], '--retries: expected a whole number from 0 to 1000, got -1'),
        (['--address', 'auto'], '--address: expected together with --engine ray'),
    ],
)
def test_wrong_use_is_told_in_one_line(tmp_path: Path, options: list[str], message: str) -> None:
    """Exit status 2, and nothing is made."""
    process = Experiment(tmp_path).start(*options)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, errors) == (2, f'spikelane experiment: {message}\n')
    assert not (tmp_path / 'out').exists()
