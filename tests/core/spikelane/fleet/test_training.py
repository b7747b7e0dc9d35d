"""Trainings in a fleet leave the checkpoints and records that they leave alone."""

from pathlib import Path
from typing import Any

import pytest

from spikelane.fleet import setting
from spikelane.fleet.setting import has_kernel
from spikelane.fleet.training import train_fleet
from spikelane.interruption import Interrupted
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.train import run as training_run
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import make_training, train
from spikelane_controllers.learning.training import Training
from spikelane_sim.calibration import write_calibration
from spikelane_sim.errors import ParameterError
from spikelane_sim.simulated_calibration import simulated_calibration
from spikelane_sim.simulator_parameters import SimulatorParameters

PARAMETERS = {
    'simulator.robot.engine': 'rigid',
    'simulator.pixels.coppelia.noise_rate_hz': 0.02,
    'simulator.episode.max_distance_m': 0.03,
    'training.save_every': 70,
}
STEPS = 1200


def make_config(seed: int, scenario: str = '1', steps: int = STEPS, **others: Any) -> TrainConfig:
    """Return what determines a short training of R-STDP."""
    asked = Request(scenario, 'rstdp', seed, 'inprocess', {**PARAMETERS, **others})
    return TrainConfig.make(asked, steps)


def begin(config: TrainConfig, path: Path, *, resume: bool = False) -> Training:
    """Begin or resume a training in a folder."""
    path.mkdir(exist_ok=True)
    return make_training(config, RunFolder(path), resume=resume)


def train_alone(config: TrainConfig, path: Path, monkeypatch: pytest.MonkeyPatch) -> Training:
    """Train observation by observation, without the kernel."""
    path.mkdir()
    with monkeypatch.context() as patch:
        patch.setattr(training_run, 'has_kernel', lambda config: False)
        return train(config, RunFolder(path), lambda *_: None, resume=False)


def assert_same(one: Path, other: Path, alone: Training, together: Training) -> None:
    """Assert that two trainings left the same."""
    for name in ('checkpoint.safetensors', 'checkpoint.json'):
        assert (one / name).read_bytes() == (other / name).read_bytes()
    assert together.terminations == alone.terminations
    assert together.steps == alone.steps


def test_seeds_and_courses_in_a_fleet_learn_as_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Checkpoints are the same bytes, with one thread and with two."""
    configs = [make_config(3), make_config(4), make_config(3, 'random:5', steps=500)]
    alone = [
        train_alone(config, tmp_path / f'alone_{i}', monkeypatch)
        for i, config in enumerate(configs)
    ]
    assert sum(len(each.terminations) for each in alone) > 1
    for threads in (1, 2):
        folders = [tmp_path / f'fleet_{threads}_{i}' for i in range(3)]
        trainings = [begin(*each) for each in zip(configs, folders, strict=True)]
        seen: list[int] = []
        train_fleet(
            configs, trainings, lambda robot, _, seen=seen: seen.append(robot), threads=threads
        )
        assert set(seen) == {0, 1, 2}
        for i, training in enumerate(trainings):
            assert_same(tmp_path / f'alone_{i}', folders[i], alone[i], training)


def test_an_interrupted_fleet_resumes_in_the_middle_of_episodes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also alone what a fleet began, and for more steps than before."""
    configs = [make_config(3), make_config(4)]
    alone = [
        train_alone(config, tmp_path / f'alone_{i}', monkeypatch)
        for i, config in enumerate(configs)
    ]
    folders = [tmp_path / f'fleet_{i}' for i in range(2)]
    trainings = [begin(*each) for each in zip(configs, folders, strict=True)]

    def stop(robot: int, progress_m: float) -> None:
        del robot, progress_m
        if min(training.steps for training in trainings) >= 400:
            raise Interrupted(2)

    with pytest.raises(Interrupted):
        train_fleet(configs, trainings, stop)
    resumed = begin(configs[0], folders[0], resume=True)
    assert 0 < len(resumed.answers_to_repeat) <= resumed.steps < STEPS
    # The first one in a kernel, the second one observation by observation.
    train_fleet(configs[:1], [resumed], lambda *_: None)
    assert_same(tmp_path / 'alone_0', folders[0], alone[0], resumed)
    with monkeypatch.context() as patch:
        patch.setattr(training_run, 'has_kernel', lambda config: False)
        second = train(configs[1], RunFolder(folders[1]), lambda *_: None, resume=True)
    assert_same(tmp_path / 'alone_1', folders[1], alone[1], second)


def test_trainings_of_which_none_begins_are_reported(tmp_path: Path) -> None:
    """Each with its reason, also where the kernel is used for any number of steps."""
    (tmp_path / 'run').mkdir()
    folder = RunFolder(tmp_path / 'run')
    folder.checkpoint.write_bytes(b'nothing')
    failed: list[str] = []
    run = training_run.TrainingRun(make_config(3), folder, lambda *_: None)
    training_run.train_together([run], lambda _, error: failed.append(str(error)))
    assert len(failed) == 1
    assert 'checkpoint.safetensors' in failed[0]


@pytest.mark.parametrize('least', [STEPS, STEPS + 1])
def test_only_a_long_training_is_worth_a_kernel(
    least: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A shorter one is done before the kernel would be compiled."""
    monkeypatch.setattr(setting, 'LEAST_STEPS', least)
    in_kernel: list[int] = []
    monkeypatch.setattr(training_run, 'train_fleet', lambda *_: in_kernel.append(1))
    training = train(make_config(3), RunFolder(tmp_path), lambda *_: None, resume=False)
    assert bool(in_kernel) == (least == STEPS)
    assert training.steps == (0 if in_kernel else STEPS)


@pytest.mark.parametrize(
    ('parameters', 'can'),
    [
        ({}, True),
        ({'simulator.robot.engine': 'pybullet'}, True),
        ({'simulator.pixels.model': 'esim'}, True),
        ({'filter.chain': 'refractory, hot_pixels'}, True),
    ],
)
def test_what_a_kernel_has_is_known_before(parameters: dict[str, Any], can: bool) -> None:
    """What it does not have is trained observation by observation."""
    assert has_kernel(make_config(0, **parameters)) == can


def test_a_filter_that_is_not_compiled_has_no_kernel(tmp_path: Path) -> None:
    """As the one that maps events through the ground plane."""
    file = tmp_path / 'camera.yaml'
    write_calibration(file, simulated_calibration(SimulatorParameters()))
    view = {'filter.chain': 'ground_view', 'filter.ground_view.file': str(file)}
    assert not has_kernel(make_config(0, **view))


def test_other_settings_are_refused(tmp_path: Path) -> None:
    """One fleet has one setting."""
    configs = [make_config(3), make_config(4, **{'rstdp.c_r': 0.02})]
    trainings = [begin(config, tmp_path / str(i)) for i, config in enumerate(configs)]
    with pytest.raises(ParameterError, match='that differ in seed, lane, course, length'):
        train_fleet(configs, trainings, lambda *_: None)
