"""Training the deep Q-network: its procedure, what it leaves, and going on after being killed."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
import yaml

from spikelane.main import run
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import make_training
from spikelane_controllers.checkpoint import read_checkpoint, write_checkpoint
from spikelane_controllers.dqn.training import (
    DqnTraining,
    DqnTrainingParameters,
    Outcome,
)
from spikelane_controllers.dqn.visited_states import read_states
from spikelane_controllers.learning.training import Termination
from spikelane_controllers.registry import make_controller
from spikelane_controllers.weights import export_weights
from spikelane_sim.errors import CheckpointError, SpikelaneError

#: A small network that learns from the beginning, in episodes of at most 12 actions.
SMALL: dict[str, Any] = {
    'simulator.robot.model': 'kinematic',
    'simulator.episode.max_distance_m': 0.05,
    'simulator.episode.max_steps': 120,
    'dqn.network.hidden_1': 8,
    'dqn.network.hidden_2': 6,
    'dqn.q_learning.random_steps': 10,
    'dqn.q_learning.annealing_steps': 50,
    'dqn.q_learning.update_every': 2,
    'dqn.q_learning.buffer_size': 40,
}
STEPS = 95
SAVE_EVERY = 10


def config_of(steps: int = STEPS, seed: int = 3, **parameters: Any) -> TrainConfig:
    """Make the configuration of a small training, often saved."""
    config = TrainConfig.make(Request('1', 'dqn', seed, 'inprocess', SMALL | parameters), steps)
    training = DqnTrainingParameters(steps=steps, save_every=SAVE_EVERY)
    return dataclasses.replace(config, training=training)


def checkpoint_bytes(folder: Path) -> bytes:
    """Return the checkpoint."""
    return (folder / 'checkpoint.safetensors').read_bytes()


def test_steps_are_actions_and_lanes_alternate(whole: Path) -> None:
    """Episodes end with the lane lost or after 12 actions; what they brought is kept."""
    training = make_training(config_of(), RunFolder(whole), resume=True)
    assert isinstance(training, DqnTraining)
    ends, outcomes = training.terminations, training.outcomes
    assert training.steps == STEPS
    assert {each.reason for each in ends} == {'lane_lost', 'step_limit'}
    assert [each.lane for each in ends] == [('outer', 'inner')[n % 2] for n in range(len(ends))]
    assert [each.step for each in ends] == np.cumsum([o.actions for o in outcomes]).tolist()
    for end, outcome in zip(ends, outcomes, strict=True):
        assert outcome.actions == -(-end.episode_steps // 10)
        assert 0 < outcome.reward < 2.66 * outcome.actions
        if end.reason == 'step_limit':
            assert outcome.actions == 12
    assert outcomes[-1].exploration_rate == pytest.approx(0.1)
    assert outcomes[0].loss is None or outcomes[0].actions > 10
    assert outcomes[-1].loss is not None
    assert training.controller.learner.updates == (STEPS - 10) // 2
    assert len(read_states(whole)) == STEPS


def test_the_states_kept_are_those_learnt_from(whole: Path) -> None:
    """As binary they are the last ones of the experience buffer."""
    state = read_checkpoint(whole, 'dqn').arrays
    states = read_states(whole).reshape(STEPS, 512) > 0
    last = [index % 40 for index in range(STEPS - 40, STEPS)]
    packed = state['controller.replay.next_states'][last]
    assert np.array_equal(np.unpackbits(packed, axis=1), states[-40:])
    assert states.any(axis=1).mean() > 0.9


def test_the_seed_determines_everything(whole: Path, tmp_path: Path, train_in: Any) -> None:
    """The same one gives the same files, another one another network."""
    train_in(tmp_path / 'same', config_of())
    assert checkpoint_bytes(tmp_path / 'same') == checkpoint_bytes(whole)
    assert (tmp_path / 'same/states.zst').read_bytes() == (whole / 'states.zst').read_bytes()
    other = train_in(tmp_path / 'other', config_of(steps=1, seed=4))
    mine = train_in(tmp_path / 'mine', config_of(steps=1))
    pairs = zip(other.controller.network, mine.controller.network, strict=True)
    assert not any((one == two).any() for one, two in pairs)


CODE = """
import dataclasses, os, sys
from pathlib import Path
from spikelane.fleet import setting
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train import run
from spikelane_controllers.dqn.training import DqnTrainingParameters
path, steps, save_every, resume, parameters, where, count = sys.argv[1:]
asked = Request('1', 'dqn', 3, 'inprocess', eval(parameters))
config = TrainConfig.make(asked, int(steps))
training = DqnTrainingParameters(steps=int(steps), save_every=int(save_every))
config = dataclasses.replace(config, training=training)
def end_at(now):
    if now == int(count):
        os.kill(os.getpid(), 9)
written, replace = 0, os.replace
def replace_unless_killed(*names):
    global written
    if Path(path) in Path(names[1]).parents:  # and not in the cache of compiled functions
        written += 1
        end_at(written)
    replace(*names)
if where == 'writing':
    os.replace = replace_unless_killed
driven = 0
def show(steps, progress_m):
    global driven
    driven += 1
    if where == 'driving':
        end_at(driven)
# While it drives, the kernel shows hundreds of steps at a time.
setting.LEAST_STEPS = float('inf') if where == 'driving' else 0
run.train(config, RunFolder(Path(path)), show, resume=resume == 'True')
"""


@pytest.mark.parametrize(
    ('robot', 'kills'),
    [
        ('kinematic', [('driving', 137), ('writing', 3), ('driving', 1)]),
        ('pybullet', [('driving', 437)]),
    ],
)
def test_a_killed_training_goes_on_bit_for_bit(
    tmp_path: Path, robot: str, kills: list[tuple[str, int]], train_in: Any
) -> None:
    """Killed within an action, between states and checkpoint, and while it repeats an episode."""
    killed, whole = tmp_path / 'killed', tmp_path / 'whole'
    changed = {'simulator.robot.model': robot}
    environment = os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)}
    for number, (where, count) in enumerate(kills):
        arguments = [killed, STEPS, SAVE_EVERY, number > 0, repr(SMALL | changed), where, count]
        ended = subprocess.run(
            [sys.executable, '-c', CODE, *map(str, arguments)],
            capture_output=True,
            env=environment,
        )
        assert ended.returncode == -signal.SIGKILL, ended.stderr
        assert read_checkpoint(killed, 'dqn').facts['steps'] < STEPS
    train_in(killed, config_of(**changed), resume=True)
    train_in(whole, config_of(**changed))
    assert checkpoint_bytes(killed) == checkpoint_bytes(whole)
    assert (killed / 'states.zst').read_bytes() == (whole / 'states.zst').read_bytes()


@pytest.mark.parametrize('steps', range(8, 13))
def test_a_training_that_is_done_can_be_prolonged(
    whole: Path, tmp_path: Path, steps: int, train_in: Any
) -> None:
    """By resuming with more steps, wherever it was done: in an episode or at its end."""
    train_in(tmp_path, config_of(steps=steps))
    prolonged = train_in(tmp_path, config_of(), resume=True)
    assert prolonged.steps == STEPS
    assert checkpoint_bytes(tmp_path) == checkpoint_bytes(whole)
    assert np.array_equal(read_states(tmp_path), read_states(whole))


def test_what_is_no_such_training_is_not_resumed(
    whole: Path, tmp_path: Path, train_in: Any
) -> None:
    """Another configuration, states that are missing, or weights alone."""
    with pytest.raises(CheckpointError, match=r'dqn.q_learning.discount 0.9, got one with 0.99'):
        train_in(whole, config_of(**{'dqn.q_learning.discount': 0.9}), resume=True)
    file = tmp_path / 'checkpoint.safetensors'
    file.write_bytes(checkpoint_bytes(whole))
    with pytest.raises(CheckpointError, match=r'states.zst: expected the states of a training'):
        train_in(tmp_path, config_of(), resume=True)
    export_weights('dqn', whole, file, 'a command')
    with pytest.raises(CheckpointError, match='expected a training, got weights alone'):
        train_in(tmp_path, config_of(), resume=True)


def test_exported_weights_drive(whole: Path, tmp_path: Path) -> None:
    """They are those of the training's two networks, and nothing else but the command."""
    file = tmp_path / 'mine.safetensors'
    export_weights('dqn', whole, file, 'a command')
    arrays, facts = read_checkpoint(file, 'dqn')
    layers = ('weights_1', 'biases_1', 'weights_2', 'biases_2', 'weights_3', 'biases_3')
    assert set(arrays) == {
        f'controller.{network}.{layer}' for network in ('network', 'target') for layer in layers
    }
    assert (facts['command'], facts['steps']) == ('a command', STEPS)
    sizes = {'network.hidden_1': 8, 'network.hidden_2': 6}
    mine, trained = (
        make_controller('dqn', {'checkpoint': str(path), **sizes}) for path in (file, whole)
    )
    for one, other in zip(mine.network, trained.network, strict=True):
        assert np.array_equal(one, other)


def test_a_network_that_diverges_is_reported(tmp_path: Path, train_in: Any) -> None:
    """The checkpoint before stays."""
    train_in(tmp_path, config_of(10))
    found = read_checkpoint(tmp_path, 'dqn')
    # Squares of such values are beyond the largest number of single precision.
    arrays = {
        name: array * np.float32(1e20) if array.dtype == np.float32 else array
        for name, array in found.arrays.items()
    }
    write_checkpoint(tmp_path / 'checkpoint.safetensors', 'dqn', arrays, found.facts)
    with pytest.raises(
        SpikelaneError, match=r'the loss is .* after \d+ updates: expected a q_lea'
    ):
        train_in(tmp_path, config_of(), resume=True)
    assert read_checkpoint(tmp_path, 'dqn').facts['steps'] == 10


def test_solved_is_three_full_episodes_in_a_row(finish_training: Any) -> None:
    """From where the first of them began."""

    def metrics_of(*episodes: tuple[int, str]) -> dict[str, Any]:
        """Measure a training of episodes of these actions, which ended so."""
        ends, outcomes, steps = [], [], 0
        for number, (actions, reason) in enumerate(episodes):
            steps += actions
            lane = ('outer', 'inner')[number % 2]
            ends.append(Termination(steps, number + 1, lane, 'A', 0.0, 0.0, 10 * actions, reason))
            outcomes.append(Outcome(actions, 2.0 * actions, 0.1, None, 0))
        return finish_training('dqn', ends, steps=steps, outcomes=outcomes).metrics()

    full, lost = (1000, 'step_limit'), (500, 'lane_lost')
    metrics = metrics_of(full, full, lost, full, full, full, lost)
    assert (metrics['solved_at'], metrics['solved_by']) == (2500, 5500)
    assert (metrics['full_episodes'], metrics['reward_per_action']) == (5, 2.0)
    metrics = metrics_of(full, full, lost, full, full)
    assert (metrics['solved_at'], metrics['solved_by']) == (None, None)
    assert metrics_of()['reward_per_action'] is None


def test_tensorboard_reads_the_log(whole: Path) -> None:
    """Under the names that Stable-Baselines3 has, at the steps where episodes ended."""
    log = EventAccumulator(str(whole / 'tensorboard'))
    log.Reload()
    assert set(log.Tags()['scalars']) == {
        'rollout/ep_len_mean',
        'rollout/ep_rew_mean',
        'rollout/exploration_rate',
        'time/fps',
        'train/learning_rate',
        'train/loss',
        'train/n_updates',
    }
    facts = read_checkpoint(whole, 'dqn').facts
    lengths = log.Scalars('rollout/ep_len_mean')
    ends = [Termination(*each).step for each in facts['terminations']]
    assert [each.step for each in lengths] == ends
    assert lengths[-1].value == pytest.approx(ends[-1] / len(ends))
    assert log.Scalars('train/learning_rate')[0].value == pytest.approx(1e-4)


@pytest.fixture
def signals(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command handles SIGTERM; the test runner wants its own way."""
    monkeypatch.setattr(signal, 'signal', lambda number, handler: None)


def command(folder: Path, *options: str) -> int:
    """Run `spikelane train dqn` with the small network."""
    arguments = ['train', 'dqn', '--seed', '3', '--out', str(folder), *options]
    for name, value in SMALL.items():
        arguments += ['--param', f'{name}={value}']
    return run(arguments)


@pytest.mark.usefixtures('signals')
def test_the_command_trains_and_its_network_drives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What it leaves, and the paper's values where none are given."""
    folder = tmp_path / 'run'
    assert command(folder, '--steps', '60', '--json') == 0
    result = json.loads(capsys.readouterr().out)
    assert (result['steps'], result['states'], result['updates']) == (60, 60, 25)
    assert result['solved_by'] is None or result['solved_by'] > result['solved_at']
    with (folder / 'episodes.csv').open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == result['episodes'] > 2
    assert sum(int(row['actions']) for row in rows) == int(rows[-1]['step'])
    assert list(rows[0])[-4:] == ['actions', 'reward', 'exploration_rate', 'loss']
    config = yaml.safe_load((folder / 'config.yaml').read_text())
    assert config['training'] == {'steps': 60, 'save_every': 1000}
    assert config['dqn']['learning'] is True
    assert config['simulator']['episode.max_laps'] == 0
    names = {Path(figure).name for figure in result['figures']}
    assert names == {f'{n}.{e}' for n in ('episodes', 'state_images') for e in ('png', 'svg')}
    assert command(folder, '--steps', '70', '--resume') == 0
    assert 'full episodes' in capsys.readouterr().out

    sizes = [f'--param=dqn.network.hidden_{n}={s}' for n, s in ((1, 8), (2, 6))]
    always = ['--transport', 'inprocess', '--robot', 'kinematic', *sizes]
    lap = ['lap', '--controller', 'dqn', '--checkpoint', str(folder), *always]
    assert run([*lap, '--out', str(tmp_path / 'lap'), '--json']) == 1
    assert json.loads(capsys.readouterr().out)['steps'] > 10


def test_defaults_of_training_are_the_papers() -> None:
    """1,000 actions at most, the lane lost at 0.5 m, no end at a lap."""
    config = TrainConfig.make(Request('1', 'dqn', 0, 'inprocess', {}))
    episode = config.simulator.episode
    assert (episode.max_distance_m, episode.max_laps, episode.max_steps) == (0.5, 0, 10_000)
    assert (config.training.steps, config.training.save_every) == (100_000, 1000)


@pytest.mark.usefixtures('signals')
def test_a_device_that_is_not_there_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one line, as is one for a controller that has none."""
    monkeypatch.setenv('CUDA_VISIBLE_DEVICES', '')
    assert command(tmp_path / 'run', '--device', 'cuda') == 2
    assert 'q_learning.device: expected cpu, as there is no CUDA' in capsys.readouterr().err
    assert not (tmp_path / 'run').exists()  # the same command without it can go there
    assert run(['train', 'rstdp', '--device', 'cuda', '--out', str(tmp_path / 'other')]) == 2
    assert (
        '--device: expected a controller that can choose one (dqn), got rstdp'
        in capsys.readouterr().err
    )


def test_episodes_last_as_long_with_another_control_period() -> None:
    """1000 actions of 0.5 s are 25000 steps of 20 ms."""
    asked = Request('1', 'dqn', parameters={'simulator.period_ms': 20})
    assert TrainConfig.make(asked).simulator.episode.max_steps == 25_000
