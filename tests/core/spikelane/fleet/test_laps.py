"""Laps in a fleet are those of single robots: the same files, byte for byte."""

from pathlib import Path
from typing import Any

import pytest

from spikelane.fleet import setting
from spikelane.fleet.laps import drive_fleet
from spikelane.runs.configuration import Request
from spikelane.runs.evaluate import run as evaluation
from spikelane.runs.evaluate.config import EvaluateConfig
from spikelane.runs.evaluate.run import drive_together, evaluate, Evaluation
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.config import LapConfig
from spikelane_sim.errors import ParameterError

SHORT = {'simulator.robot.engine': 'kinematic', 'simulator.episode.max_steps': 250}
NOISY = {
    'simulator.robot.engine': 'rigid',
    'simulator.pixels.coppelia.noise_rate_hz': 0.3,
    'simulator.link.event_loss': 0.1,
    'simulator.link.latency_ms': 50,
    'simulator.camera.antialias': True,
    'simulator.episode.max_distance_m': 0.1,
}
FILTERED = {
    'simulator.pixels.model': 'esim',
    'simulator.pixels.esim.shot_rate_hz': 1.0,
    'filter.chain': 'correlation',
    'filter.correlation.window_s': 0.005,
}
QUICK = {'simulator.period_ms': 10, 'simulator.speed': 4.0}
LEARNING = {'rstdp.learning': True, 'rstdp.checkpoint': ''}


def make_config(
    controller: str, parameters: dict[str, Any], driven: dict[str, Any], seed: int = 3
) -> EvaluateConfig:
    """Return an evaluation of short drives."""
    asked = Request('1', controller, seed, 'inprocess', {**SHORT, **parameters})
    return EvaluateConfig.make(asked, driven)


def files_in(path: Path) -> dict[str, bytes]:
    """Return the files below a folder."""
    return {
        str(file.relative_to(path)): file.read_bytes()
        for file in path.rglob('*')
        if file.is_file()
    }


def evaluate_alone(config: EvaluateConfig, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Evaluate lap by lap, without the kernel."""
    with monkeypatch.context() as patch:
        patch.setattr(evaluation, 'can_drive', lambda config: False)
        evaluate(config, RunFolder(path), lambda *_: None)


@pytest.mark.parametrize(
    ('controller', 'parameters', 'driven'),
    [
        pytest.param('rstdp', {}, {'seeds': 2}, id='two lanes'),
        pytest.param('rstdp', {**LEARNING, **NOISY}, {'seeds': 2}, id='learning with noise'),
        pytest.param('rstdp', FILTERED, {'seeds': 2, 'lanes': ('outer',)}, id='esim and filter'),
        pytest.param(
            'rstdp', {**LEARNING, **NOISY, **QUICK}, {'seeds': 2}, id='learning in steps of 10 ms'
        ),
        pytest.param('braitenberg', {**FILTERED, **QUICK}, {}, id='steps of 10 ms'),
        pytest.param('rstdp', {'simulator.robot.engine': 'pybullet'}, {}, id='pybullet'),
        pytest.param(
            'braitenberg',
            {'simulator.robot.engine': 'rigid'},
            {'courses': ('3', 'random:2'), 'lanes': ('inner',)},
            id='two courses',
        ),
    ],
)
def test_an_evaluation_in_a_fleet_leaves_the_same_files(
    controller: str,
    parameters: dict[str, Any],
    driven: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Trajectories, operations and metrics."""
    config = make_config(controller, parameters, driven)
    evaluate_alone(config, tmp_path / 'alone', monkeypatch)
    monkeypatch.setattr(evaluation, 'drive', None)  # all is driven in the fleet
    evaluate(config, RunFolder(tmp_path / 'fleet'), lambda *_: None)
    alone = files_in(tmp_path / 'alone')
    assert files_in(tmp_path / 'fleet') == alone
    assert len(alone) == 2 * len(list(config.laps())) + 1


def test_evaluations_with_other_weights_and_seeds_are_driven_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each goes into its own folder; what was driven before an error is kept."""
    weights = [{'rstdp.checkpoint': name} for name in ('scenario_1', 'scenario_3')]
    configs = [
        make_config('rstdp', each, {'lanes': ('outer',)}, seed)
        for seed, each in enumerate(weights)
    ]
    for number, config in enumerate(configs):
        evaluate_alone(config, tmp_path / f'alone_{number}', monkeypatch)
    shown: list[tuple[int, int, float]] = []
    together = [
        Evaluation(
            config,
            RunFolder(tmp_path / f'fleet_{number}'),
            lambda steps, share, number=number: shown.append((number, steps, share)),
        )
        for number, config in enumerate(configs)
    ]
    with monkeypatch.context() as patch:
        calls: list[list[LapConfig]] = []

        def drive_and_note(configs: list[LapConfig], show: Any) -> Any:
            calls.append(configs)
            return drive_fleet(configs, show)

        patch.setattr(evaluation, 'drive_fleet', drive_and_note)
        drive_together(together)
    assert [len(each) for each in calls] == [2]
    assert {number for number, *_ in shown} == {0, 1}
    assert max(share for _, _, share in shown) <= 1.0
    for number, each in enumerate(together):
        evaluate(*each)
        assert files_in(tmp_path / f'fleet_{number}') == files_in(tmp_path / f'alone_{number}')


def test_only_many_laps_are_worth_a_kernel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lap counts as 250 s, which are 5,000 steps, or as its limit where that is lower."""
    together: list[int] = []
    monkeypatch.setattr(evaluation, 'drive_together', lambda _: together.append(1))
    monkeypatch.setattr(evaluation, 'drive', stop)
    monkeypatch.setattr(setting, 'LEAST_STEPS', 20_000)
    for seeds, limit, is_worth_it in ((1, 0, False), (2, 0, True), (2, 4999, False)):
        together.clear()
        parameters = {'simulator.episode.max_steps': limit}
        config = make_config('braitenberg', parameters, {'seeds': seeds})  # of both lanes
        with pytest.raises(KeyboardInterrupt):
            evaluate(config, RunFolder(tmp_path / f'{seeds}-{limit}'), lambda *_: None)
        assert bool(together) == is_worth_it


def stop(*_: Any, **__: Any) -> None:
    """Drive no lap."""
    raise KeyboardInterrupt


def test_laps_of_other_settings_are_refused() -> None:
    """One fleet has one setting."""
    laps = [
        next(make_config('rstdp', {'rstdp.c_r': c_r}, {}).laps()).config for c_r in (0.01, 0.02)
    ]
    with pytest.raises(ParameterError, match='that differ in seed, lane, course, length'):
        drive_fleet(laps)
