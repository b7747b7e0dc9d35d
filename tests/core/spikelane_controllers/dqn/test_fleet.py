"""Deep Q-learning in a fleet leaves what it leaves alone, byte for byte."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spikelane.fleet import Fleet
from spikelane.fleet.setting import has_kernel
from spikelane.fleet.training import train_fleet
from spikelane.interruption import Interrupted
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.train import run as training_run
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import make_training, train
from spikelane_controllers.dqn.fleet import DqnFleet
from spikelane_controllers.dqn.parameters import DqnParameters
from spikelane_controllers.dqn.training import DqnTraining
from spikelane_controllers.registry import make_controller
from spikelane_sim.contract import controller_rng
from spikelane_sim.errors import ParameterError
from spikelane_sim.simulator import Simulator

#: The buffer begins anew, updates are frequent, and episodes end by chance and by their length.
PARAMETERS = {
    'simulator.robot.engine': 'rigid',
    'simulator.pixels.coppelia.noise_rate_hz': 0.02,
    'simulator.episode.max_distance_m': 0.1,
    'simulator.episode.max_steps': 235,
    'training.save_every': 30,
    'dqn.q_learning.backend': 'numba',
    'dqn.q_learning.random_steps': 20,
    'dqn.q_learning.annealing_steps': 100,
    'dqn.q_learning.buffer_size': 60,
    'dqn.q_learning.learning_rate': 1e-3,
}
STEPS = 200
FILES = ('checkpoint.safetensors', 'checkpoint.json', 'states.zst')


def make_config(seed: int, scenario: str = '1', **others: Any) -> TrainConfig:
    """Return what determines a short training."""
    asked = Request(scenario, 'dqn', seed, 'inprocess', {**PARAMETERS, **others})
    return TrainConfig.make(asked, STEPS)


def begin(config: TrainConfig, path: Path, *, resume: bool = False) -> DqnTraining:
    """Begin or resume a training in a folder."""
    path.mkdir(exist_ok=True)
    training = make_training(config, RunFolder(path), resume=resume)
    assert isinstance(training, DqnTraining)
    return training


def train_alone(config: TrainConfig, path: Path, *, resume: bool = False) -> DqnTraining:
    """Train observation by observation, without the kernel."""
    path.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training_run, 'has_kernel', lambda config: False)
        training = train(config, RunFolder(path), lambda *_: None, resume=resume)
    assert isinstance(training, DqnTraining)
    return training


@pytest.fixture(scope='module', params=['numba', 'torch'], name='alone')
def both_alone(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> dict[Path, tuple[TrainConfig, DqnTraining]]:
    """Return two trainings with each backend, and their folders."""
    trained = {}
    for seed in (3, 4):
        config = make_config(seed, **{'dqn.q_learning.backend': request.param})
        folder = tmp_path_factory.mktemp('alone')
        trained[folder] = config, train_alone(config, folder)
    return trained


def assert_same(folder: Path, training: DqnTraining, its_folder: Path, alone: DqnTraining) -> None:
    """Assert that a training left what it leaves alone."""
    for name in FILES:
        assert (folder / name).read_bytes() == (its_folder / name).read_bytes(), name
    assert training.terminations == alone.terminations
    assert training.outcomes == alone.outcomes


@pytest.mark.parametrize('threads', [1, 2])
def test_trainings_in_a_fleet_leave_the_same_bytes(
    tmp_path: Path, alone: dict[Path, tuple[TrainConfig, DqnTraining]], threads: int
) -> None:
    """Checkpoints, states and records, with episodes of both kinds."""
    configs = [config for config, _ in alone.values()]
    folders = [tmp_path / str(config.seed) for config in configs]
    trainings = [begin(*each) for each in zip(configs, folders, strict=True)]
    train_fleet(configs, trainings, lambda *_: None, threads=threads)
    for folder, training, (its_folder, (_, its_own)) in zip(
        folders, trainings, alone.items(), strict=True
    ):
        assert_same(folder, training, its_folder, its_own)
        assert training.controller.learner.updates == 45
    reasons = {each.reason for training in trainings for each in training.terminations}
    assert reasons == {'lane_lost', 'step_limit'}


def interrupt_in_a_fleet(config: TrainConfig, folder: Path) -> None:
    """Train until action 60."""
    training = begin(config, folder)

    def stop(robot: int, progress_m: float) -> None:
        del robot, progress_m
        if training.steps >= 60:
            raise Interrupted(2)

    with pytest.raises(Interrupted):
        train_fleet([config], [training], stop)


@pytest.mark.parametrize('goes_on_alone', [True, False])
def test_an_interrupted_fleet_resumes_in_the_middle_of_an_episode(
    tmp_path: Path, alone: dict[Path, tuple[TrainConfig, DqnTraining]], goes_on_alone: bool
) -> None:
    """In the kernel or without it."""
    its_folder, (config, its_own) = next(iter(alone.items()))
    folder = tmp_path / 'fleet'
    interrupt_in_a_fleet(config, folder)
    if goes_on_alone:
        resumed = train_alone(config, folder, resume=True)
    else:
        resumed = begin(config, folder, resume=True)
        assert 0 < len(resumed.answers_to_repeat) < 300
        train_fleet([config], [resumed], lambda *_: None)
    assert_same(folder, resumed, its_folder, its_own)


def test_the_robot_may_be_moved_by_an_engine_that_is_not_compiled(tmp_path: Path) -> None:
    """With pybullet, too, the kernel leaves what is left without it, before and after a stop."""
    config = make_config(3, **{'simulator.robot.engine': 'pybullet'})
    its_folder, folder = tmp_path / 'alone', tmp_path / 'fleet'
    its_own = train_alone(config, its_folder)
    interrupt_in_a_fleet(config, folder)
    resumed = begin(config, folder, resume=True)
    train_fleet([config], [resumed], lambda *_: None)
    assert_same(folder, resumed, its_folder, its_own)


def test_every_checkpoint_is_written_when_it_is_due(tmp_path: Path) -> None:
    """Also where an episode ends with the action at which it is due."""
    kept: dict[str, list[bytes]] = {'alone': [], 'fleet': []}
    # Episodes of five actions, a checkpoint every ten.
    config = make_config(3, **{'simulator.episode.max_steps': 50, 'training.save_every': 10})
    for name, seen in kept.items():
        folder = tmp_path / name
        with pytest.MonkeyPatch.context() as patch:
            save = DqnTraining._save

            def note(training: DqnTraining, save: Any = save, seen: Any = seen) -> None:
                save(training)
                seen.append(training._checkpoint.read_bytes())

            patch.setattr(DqnTraining, '_save', note)
            if name == 'alone':
                train_alone(config, folder)
            else:
                train_fleet([config], [begin(config, folder)], lambda *_: None)
    assert len(kept['fleet']) == 21
    assert kept['fleet'] == kept['alone']


def drive_alone(steps: int) -> tuple[list[tuple[float, float]], Any]:
    """Return the answers and the controller of a drive without learning."""
    controller: Any = make_controller('dqn')
    answers = []
    with Simulator(make_config(0).simulator) as simulator:
        observation = simulator.reset(None, 5)
        controller.reset(controller_rng(5, 1))
        for _ in range(steps):
            lane = observation.lane
            assert lane is not None
            wheels = controller.step(observation)
            if lane.terminated:
                observation = simulator.reset()
                controller.reset(controller_rng(5, lane.episode + 1))
                continue
            answers.append(tuple(wheels))
            observation = simulator.step(wheels)
    return answers, controller


def test_a_policy_drives_and_shows_in_a_fleet_what_it_does_alone() -> None:
    """State, counts, reward and operations, wherever the drive stops."""
    for steps in (1, 10, 14, 21):
        _, alone = drive_alone(steps)
        with Fleet('dqn', [5], simulator=make_config(0).simulator) as fleet:
            fleet.drive(steps)
            together = fleet.controller(0)
        assert together.shown[0] == alone.shown[0]
        assert together.operations == alone.operations
        np.testing.assert_array_equal(together.counts, alone.counts)
        for name, value in alone.state().items():
            np.testing.assert_array_equal(together.state()[name], value, err_msg=name)


def test_learning_on_a_gpu_is_refused_by_name() -> None:
    """A kernel would not see the weights there; a policy that does not learn has no device."""
    values = {'q_learning.backend': 'torch', 'q_learning.device': 'cuda'}
    with pytest.raises(ParameterError, match='device: expected cpu in a fleet, got cuda'):
        DqnFleet.check(DqnParameters.from_mapping({**values, 'learning': True}))
    DqnFleet.check(DqnParameters.from_mapping(values))
    assert has_kernel(make_config(0))
