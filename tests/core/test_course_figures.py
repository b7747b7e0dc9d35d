"""Figures of many courses and of robustness: what they take from results, and that they draw."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from spikelane.experiment.file import read_experiment
from spikelane.experiment.plan import make_plan
from spikelane.figures.robustness import draw_robustness, NONE, robustness_curves
from spikelane.main import run
from spikelane.statistics import mean_statistics, share_statistics
from spikelane_sim.errors import SpikelaneError

ROOT = Path(__file__).parents[2]


def group(condition: str, errors: list[float], laps: int = 4, **place: str) -> dict[str, Any]:
    """Return a group of an experiment's results: laps, some with the errors of completed ones."""
    measured = {
        'completed': share_statistics(len(errors), laps),
        'mean_abs_distance_m': mean_statistics(errors),
    }
    return {'controller': 'rstdp', 'conditions': condition, 'laps': {'all': measured}, **place}


def test_curves_are_the_laps_by_rising_difficulty() -> None:
    """Driving under none begins the curves there are; other names are left out."""
    groups = [
        group('loss-0.5', []),
        group('loss-0.1', [0.01, 0.03, 0.02]),
        group(NONE, [0.01, 0.01, 0.01, 0.01]),
        group('rainy', [0.5]),
        {'controller': 'rstdp', 'conditions': 'loss-0.2', 'metrics': {}},
    ]
    curves = robustness_curves({'groups': groups})
    assert list(curves) == ['loss']
    curve = curves['loss']['rstdp']
    assert [each.value for each in curve] == [0.0, 0.1, 0.5]
    assert [each.completed['share'] for each in curve] == [1.0, 0.75, 0.0]
    assert [each.error_m and each.error_m['mean'] for each in curve] == [
        0.01,
        pytest.approx(0.02),
        None,
    ]


@pytest.mark.parametrize(
    ('groups', 'error'),
    [
        ([], 'conditions: expected some of noise-<value>, .*, got none'),
        ([group(NONE, [0.1])], 'expected some of'),
        (
            [group('noise-1', [0.1], scenario='1'), group('noise-1', [0.1], scenario='2')],
            'expected each noise once for rstdp',
        ),
    ],
)
def test_results_without_clear_curves_are_refused(groups: list[Any], error: str) -> None:
    """Nothing to draw, or points above each other."""
    with pytest.raises(SpikelaneError, match=error):
        robustness_curves({'groups': groups})


def test_the_figure_of_robustness_is_the_same_each_time(tmp_path: Path) -> None:
    """Its axes name what is on them."""
    groups = [group(NONE, [0.01, 0.02]), group('noise-1', [0.02]), group('latency-200', [])]
    [file] = draw_robustness({'groups': groups}, tmp_path / 'a.svg', 'Robustness')
    assert (
        file.read_bytes()
        == draw_robustness({'groups': groups}, file, 'Robustness')[0].read_bytes()
    )
    assert len(draw_robustness({'groups': groups}, tmp_path / 'b')) == 2


def test_the_experiment_on_robustness_has_what_the_figure_wants() -> None:
    """Every condition is one of a curve; latencies of 50 to 200 ms, losses up to a half."""
    plan = make_plan(read_experiment(ROOT / 'experiments/robustness.yaml'))
    names = {each.labels['conditions'] for each in plan.runs}
    assert len(plan.runs) == 4 * len(names)
    curves = robustness_curves({'groups': [group(name, [0.1]) for name in names]})
    values = {name: [each.value for each in curve['rstdp']] for name, curve in curves.items()}
    assert values == {
        'noise': [0, 0.01, 0.03, 0.1, 0.3],
        'threshold': [0.1, 0.2, 0.4, 0.8],
        'latency': [0, 50, 100, 150, 200],
        'loss': [0, 0.1, 0.2, 0.3, 0.5],
    }
    for each in plan.runs:
        simulator = each.identity['configuration']['simulator']
        difficulty, _, value = each.labels['conditions'].partition('-')
        found = {
            'none': 0.0,
            'noise': simulator['pixels.coppelia.noise_rate_hz'],
            'threshold': simulator['pixels.coppelia.threshold'],
            'latency': simulator['link.latency_ms'],
            'loss': simulator['link.event_loss'],
        }
        assert found[difficulty] == float(value or 0)


def test_an_evaluation_on_random_courses_draws_some(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A few steps on either lane of three courses: none is completed."""
    command = ['evaluate', '--courses', 'random:2', 'random:7-7', '--robot', 'kinematic', '--json']
    command += ['--param', 'simulator.episode.max_steps=30', '--out', str(tmp_path / 'out')]
    assert run(command) == 0
    result = json.loads(capsys.readouterr().out)
    assert [each['course'] for each in result['laps'][::2]] == ['random:0', 'random:1', 'random:7']
    assert result['summary']['courses_completed']['successes'] == 0
    assert result['summary']['courses_completed']['n'] == 3
    assert Path(result['figure']) == tmp_path / 'out/figures/courses.svg'
    assert {path.name for path in (tmp_path / 'out/figures').iterdir()} == {
        'courses.svg',
        'courses.png',
    }
    assert (tmp_path / 'out/laps/003-random-7-inner-seed0/metrics.json').exists()
