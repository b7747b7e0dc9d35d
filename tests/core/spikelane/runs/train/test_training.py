"""Training in-process: its procedure, what it leaves, and going on after being killed."""

from __future__ import annotations

import json
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml

from spikelane.main import run
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import make_training
from spikelane_controllers.checkpoint import read_checkpoint, write_checkpoint
from spikelane_controllers.learning.results import TrainingResults
from spikelane_controllers.learning.training import Termination, TrainingParameters
from spikelane_controllers.rstdp.learnt_weights import WEIGHTS
from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import CheckpointError, ParameterError
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

#: A robot in a file.
SMALL = Path(__file__).parents[5] / 'docs/examples/robot/small.urdf'

#: Uneven weights that lead off the lane soon: short episodes, ended in either way.
SWERVING: dict[str, Any] = {
    'simulator.robot.model': 'kinematic',
    'simulator.episode.max_distance_m': 0.005,
    'simulator.episode.max_steps': 130,
    'rstdp.initial_weights.low_pa': 100.0,
    'rstdp.initial_weights.high_pa': 500.0,
}
STEPS = 650


def config_of(steps: int = STEPS, seed: int = 3, **parameters: Any) -> TrainConfig:
    """Make the configuration of a training that swerves, with other parameters."""
    return TrainConfig.make(Request('1', 'rstdp', seed, 'inprocess', SWERVING | parameters), steps)


def checkpoint_bytes(folder: Path) -> bytes:
    """Return the checkpoint."""
    return (folder / 'checkpoint.safetensors').read_bytes()


def test_lanes_alternate_and_every_termination_is_kept(whole: Path) -> None:
    """With step, episode and place; steps count observations answered that went on."""
    training = make_training(config_of(), RunFolder(whole), resume=True)
    ends = training.terminations
    assert training.steps == STEPS
    assert len(ends) > 4
    assert {each.reason for each in ends} == {'lane_lost', 'step_limit'}
    assert [each.episode for each in ends] == list(range(1, len(ends) + 1))
    assert [each.lane for each in ends] == [('outer', 'inner')[n % 2] for n in range(len(ends))]
    steps = np.cumsum([each.episode_steps for each in ends])
    assert [each.step for each in ends] == steps.tolist()
    for each in ends:
        assert (abs(each.distance_m) > 0.005) == (each.reason == 'lane_lost')


def test_weights_are_kept_every_hundred_steps(whole: Path) -> None:
    """They begin with the initial weights, and each differs from the one before."""
    training = make_training(config_of(), RunFolder(whole), resume=True)
    assert np.shape(training.weight_history) == (1 + STEPS // 100, 2, 32)
    first, *_, last = training.weight_history
    assert 100.0 <= first.min() < 150.0 < 450.0 < first.max() <= 500.0
    assert all(
        (a != b).any()
        for a, b in zip(training.weight_history, training.weight_history[1:], strict=False)
    )
    assert np.abs(training.controller.weights_pa - last).max() < 50.0


def test_the_seed_determines_everything(whole: Path, tmp_path: Path, train_in: Any) -> None:
    """The same one gives the same file, another one other initial weights."""
    train_in(tmp_path / 'same', config_of())
    assert checkpoint_bytes(tmp_path / 'same') == checkpoint_bytes(whole)
    other = train_in(tmp_path / 'other', config_of(steps=1, seed=4))
    mine = make_training(config_of(), RunFolder(whole), resume=True)
    assert (other.weight_history[0] != mine.weight_history[0]).all()


CODE = """
import os, sys
from pathlib import Path
from spikelane.fleet import setting
from spikelane.runs.folder import RunFolder
from spikelane.runs.configuration import Request
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train import run
path, steps, resume, parameters, is_in_kernel, where, count, number = sys.argv[1:]
setting.LEAST_STEPS = 0 if is_in_kernel == 'True' else float('inf')
asked = Request('1', 'rstdp', 3, 'inprocess', eval(parameters))
config = TrainConfig.make(asked, int(steps))
def end_at(now):
    if now >= int(count):
        os.kill(os.getpid(), int(number))
written, replace = 0, os.replace
def replace_unless_killed(*names):
    global written
    if Path(path) in Path(names[1]).parents:  # and not in the cache of compiled functions
        written += 1
        end_at(written)
    replace(*names)
if where == 'writing':
    os.replace = replace_unless_killed
show = lambda steps, _: end_at(steps) if where == 'driving' else None
run.train(config, RunFolder(Path(path)), show, resume=resume == 'True')
"""


class Kill(NamedTuple):
    """How a training ends before its time."""

    where: str  # driving: at this step; writing: its so manieth checkpoint
    count: int
    number: int = signal.SIGKILL


def train_until(
    kill: Kill, folder: Path, robot: str, steps: int, *, resume: bool, is_in_kernel: bool
) -> int:
    """Train in a process of its own that ends itself; return the steps in its checkpoint."""
    parameters = repr(SWERVING | {'simulator.robot.model': robot})
    arguments = [
        str(folder),
        str(steps),
        str(resume),
        parameters,
        str(is_in_kernel),
        *map(str, kill),
    ]
    ended = subprocess.run(
        [sys.executable, '-c', CODE, *arguments],
        capture_output=True,
        env=os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert ended.returncode == -kill.number, ended.stderr
    return int(read_checkpoint(folder, 'rstdp').facts['steps'])


@pytest.mark.parametrize(
    ('robot', 'is_in_kernel', 'steps', 'kills'),
    [
        (
            'kinematic',
            True,
            STEPS,
            [
                # The kernel drives up to a checkpoint or the end of an episode at once.
                (Kill('driving', 70), 100),
                (Kill('writing', 2), 200),
                (Kill('driving', 262, signal.SIGINT), 300),
                (Kill('writing', 1), 300),
                (Kill('driving', 555, signal.SIGTERM), 500),
            ],
        ),
        (
            'kinematic',
            False,
            STEPS,
            [
                (Kill('driving', 70), 0),
                (Kill('driving', 199), 100),
                (Kill('driving', 262, signal.SIGINT), 200),
                (Kill('writing', 2), 300),
                (Kill('driving', 300), 300),  # while it repeats an episode
                (Kill('driving', 555, signal.SIGTERM), 500),
            ],
        ),
        ('pybullet', False, 300, [(Kill('driving', 260), 200)]),
        ('rigid', False, 300, [(Kill('driving', 260), 200)]),
    ],
)
def test_a_killed_training_goes_on_bit_for_bit(
    tmp_path: Path,
    robot: str,
    is_in_kernel: bool,
    steps: int,
    kills: list[tuple[Kill, int]],
    train_in: Any,
) -> None:
    """Killed again and again, anywhere: the checkpoint at the end is that of one never stopped."""
    killed, whole = tmp_path / 'killed', tmp_path / 'whole'
    for count, (kill, kept) in enumerate(kills):
        assert kept == train_until(
            kill, killed, robot, steps, resume=count > 0, is_in_kernel=is_in_kernel
        )
    config = config_of(steps, **{'simulator.robot.model': robot})
    train_in(killed, config, resume=True)
    train_in(whole, config)
    assert checkpoint_bytes(killed) == checkpoint_bytes(whole)


def test_a_training_that_is_done_can_be_prolonged(
    whole: Path, tmp_path: Path, train_in: Any
) -> None:
    """By resuming with more steps; with the same ones nothing happens."""
    train_in(tmp_path, config_of(steps=370))
    train_in(tmp_path, config_of(), resume=True)
    assert checkpoint_bytes(tmp_path) == checkpoint_bytes(whole)
    train_in(tmp_path, config_of(), resume=True)
    assert checkpoint_bytes(tmp_path) == checkpoint_bytes(whole)


def test_nothing_depends_on_the_time_an_episode_begins() -> None:
    """This also holds for a real sensor's pixels with all their state; resuming relies on it."""
    pixels = {
        'model': 'esim',
        'esim.refractory_s': 0.003,
        'esim.shot_rate_hz': 5.0,
        'esim.latency_s': 0.07,
    }
    parameters = SimulatorParameters.from_mapping(
        {'robot.model': 'kinematic', 'pixels': pixels, 'episode.max_steps': 30}
    )
    wheels = [WheelVelocities(1.0 + 0.01 * n, 1.2) for n in range(30)]
    with Simulator(parameters) as late, Simulator(parameters) as early:
        seen = late.reset(seed=7)
        for command in wheels:
            seen = late.step(command)
        begun_ns = seen.stamp_ns
        pairs = [(late.reset(), early.reset('inner', 7, episode=2))]
        pairs += [(late.step(command), early.step(command)) for command in wheels]
    assert sum(len(one.events) for one, _ in pairs) > 1000
    for one, other in pairs:
        assert one.lane == other.lane
        assert one.stamp_ns == other.stamp_ns + begun_ns
        shifted = other.events.copy()
        shifted['t'] += begun_ns
        assert one.events.tolist() == shifted.tolist()


@pytest.mark.parametrize(
    ('config', 'message'),
    [
        (config_of(seed=4), 'expected a training with seed 4, got one with 3'),
        (
            config_of(**{'simulator.camera.fov_deg': 80.0}),
            'a training with simulator.camera.fov_deg 80.0, got one with',
        ),
        (config_of(**{'rstdp.c_r': 0.02}), 'with rstdp.c_r 0.02, got one with 0.01'),
    ],
)
def test_another_training_is_not_resumed(
    whole: Path, config: TrainConfig, message: str, train_in: Any
) -> None:
    """The line says in what it differs."""
    with pytest.raises(CheckpointError, match=message):
        train_in(whole, config, resume=True)


def test_what_is_no_training_is_not_resumed(whole: Path, tmp_path: Path, train_in: Any) -> None:
    """Nothing, a truncated checkpoint, one with NaN, and weights alone."""
    file = tmp_path / 'checkpoint.safetensors'
    with pytest.raises(CheckpointError, match=f'{file}: expected a checkpoint, got none'):
        train_in(tmp_path, config_of(), resume=True)
    file.write_bytes(checkpoint_bytes(whole)[:-1])
    with pytest.raises(CheckpointError, match=f'{file}: expected a whole safetensors file'):
        train_in(tmp_path, config_of(), resume=True)
    arrays, facts = read_checkpoint(whole, 'rstdp')
    arrays['controller.network.eligibility'][0, 0] = np.nan
    write_checkpoint(file, 'rstdp', arrays, facts)
    with pytest.raises(CheckpointError, match=r'network\.eligibility: expected finite numbers'):
        train_in(tmp_path, config_of(), resume=True)
    write_checkpoint(file, 'rstdp', {WEIGHTS: np.ones((2, 32))}, {})
    with pytest.raises(CheckpointError, match='expected a training, got weights alone'):
        train_in(tmp_path, config_of(), resume=True)


def test_an_episode_that_is_not_the_same_again_is_noticed(
    whole: Path, tmp_path: Path, train_in: Any
) -> None:
    """As with another version of something: the robot is somewhere else in the end."""
    arrays, facts = read_checkpoint(whole, 'rstdp')
    arrays['training.answers'][0, 0] += 0.01
    file = tmp_path / 'checkpoint.safetensors'
    write_checkpoint(file, 'rstdp', arrays, facts)
    with pytest.raises(CheckpointError, match=r'expected episode .* to be the same again'):
        train_in(tmp_path, config_of(STEPS + 100), resume=True)


def test_a_training_is_not_begun_over_another(whole: Path, train_in: Any) -> None:
    """It would be lost."""
    before = checkpoint_bytes(whole)
    with pytest.raises(CheckpointError, match='expected a folder without a checkpoint'):
        train_in(whole, config_of())
    assert checkpoint_bytes(whole) == before


def test_the_metrics_tell_when_it_had_learnt(finish_training: Any) -> None:
    """Laps count from the last lane loss on."""
    ends = [
        Termination(step, n, lane, 'A', 0.0, 0.0, 10, reason)
        for n, (step, lane, reason) in enumerate(
            [
                (10, 'outer', 'laps_complete'),
                (20, 'inner', 'lane_lost'),
                (30, 'outer', 'laps_complete'),
                (40, 'inner', 'laps_complete'),
                (50, 'outer', 'laps_complete'),
            ],
            1,
        )
    ]
    results = finish_training('rstdp', ends, steps=90)
    assert TrainingResults.metrics(results) == {
        'steps': 90,
        'episodes': 5,
        'lane_losses': 1,
        'last_lane_loss_step': 20,
        'settled': True,
        'laps_since': {'inner': 1, 'outer': 2},
    }


@pytest.fixture
def signals(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command handles SIGTERM; the test runner wants its own way."""
    monkeypatch.setattr(signal, 'signal', lambda number, handler: None)


def command(folder: Path, *options: str) -> int:
    """Run `spikelane train` with the kinematic robot."""
    return run(['train', 'rstdp', '--robot', 'kinematic', '--out', str(folder), *options])


@pytest.mark.usefixtures('signals')
def test_the_command_leaves_a_folder_and_prints_its_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Everything that was asked for, and what came of it."""
    folder = tmp_path / 'run'
    assert command(folder, '--steps', '120', '--seed', '2', '--antialias', '--json') == 0
    result = json.loads(capsys.readouterr().out)
    assert result['wall_time_s'] > 0.0
    asked = {
        'scenario': '1',
        'controller': 'rstdp',
        'seed': 2,
        'transport': 'inprocess',
        'robot': 'p3dx',
        'engine': 'kinematic',
        'pixels': 'coppelia',
        'antialias': True,
        'folder': str(folder),
        'checkpoint': str(folder / 'checkpoint.safetensors'),
    }
    came = {
        'steps': 120,
        'episodes': 0,
        'lane_losses': 0,
        'last_lane_loss_step': 0,
        'laps_since': {},
    }
    assert result.items() >= (asked | came).items()
    assert {Path(figure).name for figure in result['figures']} >= {'weights.svg'}
    assert all(Path(figure).stat().st_size > 1000 for figure in result['figures'])
    assert json.loads((folder / 'metrics.json').read_text()) == result
    assert (folder / 'episodes.csv').read_text() == ','.join(Termination._fields) + '\n'
    config = yaml.safe_load((folder / 'config.yaml').read_text())
    assert config['training'] == {'steps': 120, 'save_every': 100}
    assert config['rstdp']['learning'] is True
    assert config['rstdp']['checkpoint'] == ''
    assert config['simulator']['episode.max_distance_m'] == 0.2


@pytest.mark.usefixtures('signals')
def test_the_command_resumes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With more steps, and says so in one line where it cannot."""
    folder = tmp_path / 'run'
    assert command(folder, '--steps', '10', '--resume') == 2
    assert capsys.readouterr().err.count('expected a checkpoint, got none') == 1
    assert command(folder, '--steps', '10') == 0
    assert 'lane lost' in capsys.readouterr().out
    assert command(folder, '--steps', '20', '--resume', '--json') == 0
    result = json.loads(capsys.readouterr().out)
    assert (result['steps'], result['wall_time_s']) == (20, None)
    assert yaml.safe_load((folder / 'config.yaml').read_text())['training']['steps'] == 20
    assert command(folder, '--steps', '30', '--resume', '--pixels', 'esim') == 2
    error = capsys.readouterr().err
    assert 'simulator.pixels.model esim, got one with coppelia' in error
    assert error.count('\n') == 1
    assert command(folder, '--steps', '10') == 2
    assert 'expected a new or empty folder' in capsys.readouterr().err


@pytest.mark.usefixtures('signals')
def test_two_do_not_train_in_one_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Who is at work there is said."""
    folder = tmp_path / 'run'
    first = [sys.executable, '-m', 'spikelane.main', 'train', 'rstdp', '--steps', '1000000']
    first += ['--robot', 'kinematic', '--out', str(folder)]
    with subprocess.Popen(first) as process:
        try:
            deadline_s = time.monotonic() + 60.0
            while not (folder / 'checkpoint.safetensors').exists():
                assert time.monotonic() < deadline_s
                time.sleep(0.1)
            assert command(folder, '--steps', '1000000', '--resume') == 1
        finally:
            process.kill()
    assert capsys.readouterr().err == (
        f'spikelane train: {folder}: another process works here: {process.pid}\n'
    )


def drive(folder: Path, *options: str) -> dict[str, Any]:
    """Drive 40 steps of a lap in-process; return the controller's parameters."""
    always = ['--transport', 'inprocess', '--robot', 'kinematic', '--out', str(folder)]
    short = ['--param', 'simulator.episode.max_steps=40']
    assert run(['lap', '--controller', 'rstdp', *always, *short, *options]) == 1
    return dict(yaml.safe_load((folder / 'config.yaml').read_text())['rstdp'])


@pytest.mark.usefixtures('signals')
def test_a_lap_is_driven_with_learnt_weights(whole: Path, tmp_path: Path) -> None:
    """Those shipped for the scenario, those of a training, or those named."""
    shipped = drive(tmp_path / 'shipped', '--scenario', '2')
    assert (shipped['checkpoint'], shipped['learning']) == ('scenario_2', False)
    mine = drive(tmp_path / 'mine', '--checkpoint', os.path.relpath(whole, Path.cwd()))
    assert Path(mine['checkpoint']).is_absolute()
    assert Path(mine['checkpoint']).resolve() == whole
    assert drive(tmp_path / 'one', '--checkpoint', 'scenario_3')['checkpoint'] == 'scenario_3'
    course = Path(__file__).parents[5] / 'sim_bridge/spikelane_sim/courses/scenario_3.yaml'
    other = drive(tmp_path / 'other', '--scenario', str(course))
    assert other['checkpoint'] == 'scenario_1'


@pytest.mark.usefixtures('signals')
def test_a_checkpoint_that_cannot_be_used_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one line, before a folder is made."""
    options = ['--transport', 'inprocess', '--checkpoint', str(tmp_path / 'none')]
    out = tmp_path / 'out'
    for controller, message in (
        ('rstdp', 'checkpoint: expected one of scenario_1'),
        ('braitenberg', '--checkpoint: expected a controller that learns, got braitenberg'),
    ):
        assert run(['lap', '--controller', controller, *options, '--out', str(out)]) == 2
        error = capsys.readouterr().err
        assert message in error
        assert error.count('\n') == 1


def test_the_trainings_own_parameters_are_a_group_like_any_other() -> None:
    """Its length can be given as an option too, but not in both ways."""

    def training_of(steps: int | None = None, **parameters: int) -> TrainingParameters:
        """Return what a training of R-STDP is made from; __ stands for a dot."""
        given = {name.replace('__', '.'): value for name, value in parameters.items()}
        return TrainConfig.make(Request('1', 'rstdp', 1, 'inprocess', given), steps).training

    assert training_of(training__save_every=50) == TrainingParameters(save_every=50)
    assert training_of(90) == training_of(training__steps=90) == TrainingParameters(steps=90)
    both = 'training.steps: expected either --steps or the parameter, got both'
    with pytest.raises(ParameterError, match=both):
        training_of(90, training__steps=90)
    with pytest.raises(ParameterError, match=r'training: save_every: .* from 1 .*, got 0'):
        training_of(training__save_every=0)
    known = r'expected simulator\.<name> or rstdp\.<name> or filter\.<name> or training\.<name>'
    with pytest.raises(ParameterError, match=known):
        training_of(trainings__steps=90)


FILTERED: dict[str, Any] = {
    'simulator.pixels.coppelia.noise_rate_hz': 1.0,
    'filter.chain': 'correlation',
    'filter.correlation.window_s': 0.05,
}


def test_a_training_with_filters_goes_on_bit_for_bit(tmp_path: Path, train_in: Any) -> None:
    """In the middle of an episode; other filters, or none, are another training."""
    train_in(tmp_path / 'whole', config_of(steps=300, **FILTERED))
    train_in(tmp_path / 'parts', config_of(steps=170, **FILTERED))
    train_in(tmp_path / 'parts', config_of(steps=300, **FILTERED), resume=True)
    assert checkpoint_bytes(tmp_path / 'parts') == checkpoint_bytes(tmp_path / 'whole')
    noise = {name: value for name, value in FILTERED.items() if 'noise' in name}
    train_in(tmp_path / 'unfiltered', config_of(steps=300, **noise))
    weights = [
        make_training(config_of(steps=300, **given), RunFolder(tmp_path / name), resume=True)
        for name, given in (('whole', FILTERED), ('unfiltered', noise))
    ]
    assert (weights[0].controller.weights_pa != weights[1].controller.weights_pa).any()
    for name, given in (('unfiltered', FILTERED), ('whole', noise)):
        with pytest.raises(CheckpointError, match=r'expected a training with filter'):
            train_in(tmp_path / name, config_of(steps=400, **given), resume=True)


def test_a_robot_whose_urdf_has_changed_is_noticed(tmp_path: Path, train_in: Any) -> None:
    """A training is not resumed with another robot, whatever the file is called."""
    urdf = tmp_path / 'own.urdf'
    text = SMALL.read_text('utf-8')
    urdf.write_text(text, 'utf-8')
    own = {'simulator.robot.model': str(urdf), 'simulator.robot.engine': 'kinematic'}
    train_in(tmp_path / 'run', config_of(100, **own))
    resumed = train_in(tmp_path / 'run', config_of(150, **own), resume=True)
    assert resumed.steps == 150
    urdf.write_text(f'{text}<!-- changed -->', 'utf-8')
    expected = rf'expected a training with inputs\.{re.escape(str(urdf))} [0-9a-f]{{64}}, got one'
    with pytest.raises(CheckpointError, match=expected):
        train_in(tmp_path / 'run', config_of(200, **own), resume=True)


def test_a_checkpoint_that_does_not_tell_what_was_in_files_is_resumed(
    tmp_path: Path, train_in: Any
) -> None:
    """Earlier versions did not write it down."""
    urdf = tmp_path / 'own.urdf'
    urdf.write_bytes(SMALL.read_bytes())
    own = {'simulator.robot.model': str(urdf), 'simulator.robot.engine': 'kinematic'}
    train_in(tmp_path, config_of(100, **own))
    file = RunFolder(tmp_path).checkpoint
    arrays, facts = read_checkpoint(file, 'rstdp')
    config = {name: value for name, value in facts['config'].items() if name != 'inputs'}
    assert len(config) == len(facts['config']) - 1
    write_checkpoint(file, 'rstdp', arrays, {**facts, 'config': config})
    assert train_in(tmp_path, config_of(150, **own), resume=True).steps == 150
