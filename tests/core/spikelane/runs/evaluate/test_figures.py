"""Figures of many courses and of robustness: what they take from results, and that they draw."""

from __future__ import annotations

import json
from pathlib import Path
import re
from typing import Any

import pytest

from spikelane.experiment.file import read_experiment
from spikelane.experiment.plan import make_plan
from spikelane.figures.robustness import draw_robustness, robustness_curves
from spikelane.main import run
from spikelane.statistics import mean_statistics, share_statistics
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.simulator_parameters import SimulatorParameters

ROOT = Path(__file__).parents[5]


def group(errors: list[float], laps: int = 4, **simulator: Any) -> dict[str, Any]:
    """Return a group of an experiment's results: laps, some with the errors of completed ones."""
    measured = {
        'unit': 'seed',
        'completed': share_statistics(len(errors), laps),
        'mean_abs_distance_m': mean_statistics(errors),
    }
    parameters = SimulatorParameters.from_mapping(_dotted(simulator)).to_dict()
    return {'controller': 'rstdp', 'simulator': parameters, 'laps': {'all': measured}}


def _dotted(values: dict[str, Any]) -> dict[str, Any]:
    return {name.replace('__', '.'): value for name, value in values.items()}


def test_curves_are_the_laps_by_rising_difficulty() -> None:
    """Where driving differs in one parameter alone; groups without laps are left out."""
    groups = [
        group([], link__event_loss=0.5),
        group([0.01, 0.03, 0.02], link__event_loss=0.1),
        group([0.01, 0.01, 0.01, 0.01]),
        group([0.5], camera__fov_deg=90.0),
        {'controller': 'rstdp', 'simulator': {}, 'metrics': {}},
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


def test_a_condition_is_drawn_at_the_value_it_sets_whatever_its_name() -> None:
    """A condition named latency-100 that sets 300 ms is a point at 300 ms."""
    named = {**group([0.02], link__latency_ms=300), 'conditions': 'latency-100'}
    curves = robustness_curves({'groups': [group([0.01]), named]})
    assert [each.value for each in curves['latency']['rstdp']] == [0.0, 300.0]


def test_noise_and_threshold_are_those_of_the_pixel_model() -> None:
    """For esim they are shot noise, and the threshold if both thresholds are equal."""
    esim = {'pixels__model': 'esim'}
    both = {'pixels__esim__threshold_on': 0.4, 'pixels__esim__threshold_off': 0.4}
    groups = [
        group([0.1], **esim),
        group([0.1], **esim, pixels__esim__shot_rate_hz=5.0),
        group([0.1], **esim, **both),
        group([0.1], **esim, pixels__coppelia__threshold=0.7),
    ]
    curves = robustness_curves({'groups': groups[:3]})
    values = {name: [each.value for each in curve['rstdp']] for name, curve in curves.items()}
    assert values == {'noise': [0.0, 5.0], 'threshold': [0.2, 0.4]}


@pytest.mark.parametrize(
    ('groups', 'error'),
    [
        ([], 'conditions: expected some that differ in noise, threshold, .*, got none'),
        ([group([0.1])], 'expected some that differ'),
        (
            [group([0.1]), group([0.1]), group([0.2], pixels__coppelia__noise_rate_hz=1.0)],
            'expected each noise once for rstdp',
        ),
        (
            [
                group([0.1], course=course, link__event_loss=loss)
                for course in ('scenario_1', 'scenario_2')
                for loss in (0.0, 0.5)
            ],
            'expected each loss once for rstdp',
        ),
        (
            [{'controller': 'rstdp', 'laps': {}, 'conditions': 'noise-1'}],
            "expected results with the simulator's parameters",
        ),
    ],
)
def test_results_without_clear_curves_are_refused(groups: list[Any], error: str) -> None:
    """Nothing to draw, or points above each other."""
    with pytest.raises(SpikelaneError, match=error):
        robustness_curves({'groups': groups})


def test_the_figure_of_robustness_is_the_same_each_time(tmp_path: Path) -> None:
    """Its axes name what is on them."""
    groups = [
        group([0.01, 0.02]),
        group([0.02], pixels__coppelia__noise_rate_hz=1.0),
        group([], link__latency_ms=200),
    ]
    [file] = draw_robustness({'groups': groups}, tmp_path / 'a.svg', 'Robustness')
    assert (
        file.read_bytes()
        == draw_robustness({'groups': groups}, file, 'Robustness')[0].read_bytes()
    )
    assert len(draw_robustness({'groups': groups}, tmp_path / 'b')) == 2


def test_no_point_stands_at_a_value_below_those_driven(
    tmp_path: Path, drawn_figures: list[Any]
) -> None:
    """Noise has a log axis whose zero has a place of its own; others are moved to the right."""
    groups = [
        {**group(errors, laps, **simulator), 'controller': controller}
        for controller, laps in (('rstdp', 4), ('dqn', 2))
        for errors, simulator in (
            ([0.01, 0.02], {}),
            ([0.02], {'pixels__coppelia__noise_rate_hz': 0.01}),
            ([], {'pixels__coppelia__noise_rate_hz': 0.3}),
            ([0.01], {'link__latency_ms': 50}),
        )
    ]
    [file] = draw_robustness({'groups': groups}, tmp_path / 'a.svg', 'Robustness')
    said = re.findall(r'<!-- (.*?) -->', file.read_text())
    assert {'R-STDP, n = 4', 'DQN, n = 2', '//', 'noise rate of a pixel [Hz], log scale'} <= {
        *said
    }
    assert (
        'n: laps at each value; vertical lines: 95 % intervals over seeds, wide ones cut' in said
    )
    _, noise, _, latency = drawn_figures[0].axes
    assert [text.get_text() for text in noise.get_xticklabels()] == ['0', '0.01', '0.3']
    assert [text.get_text() for text in latency.get_xticklabels()] == ['0', '50']
    assert (noise.get_xscale(), latency.get_xscale()) == ('log', 'linear')
    for axes in (noise, latency):
        zero = axes.transData.transform((axes.get_xticks()[0], 0.0))[0]
        points = [line for line in axes.lines if line.get_marker() != 'None']
        first = [line.get_transform().transform(line.get_xydata()[0])[0] for line in points]
        assert first == pytest.approx([zero, zero + 2.5 * drawn_figures[0].dpi / 72])
    assert 0 < noise.get_xticks()[0] < 0.01


def test_the_experiment_on_robustness_has_what_the_figure_wants() -> None:
    """Every condition is one of a curve; latencies of 50 to 200 ms, losses up to a half."""
    plan = make_plan(read_experiment(ROOT / 'experiments/robustness.yaml'))
    names = {each.labels['conditions'] for each in plan.runs}
    assert len(plan.runs) == 4 * len(names)
    simulators = {
        each.labels['conditions']: each.identity['configuration']['simulator']
        for each in plan.runs
    }
    groups = [{**group([0.1]), 'simulator': each} for each in simulators.values()]
    curves = robustness_curves({'groups': groups})
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
