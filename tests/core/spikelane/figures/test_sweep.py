"""The figure of a sweep: which lines an experiment's results have."""

from pathlib import Path
from typing import Any

import pytest

from spikelane.experiment.sweeps import swept_parameters, swept_value
from spikelane.figures.sweep import draw_sweep, sweep_lines
from spikelane_sim.errors import SpikelaneError


def group(scenario: str, c_r: str, every: str, median: float | None, share: float) -> Any:
    """Return a group as `results.json` has it, of trainings and their laps."""
    completed = {'share': share, 'ci_low': share / 2, 'ci_high': 1.0}
    error = {'mean': 0.01, 'ci_low': None, 'ci_high': None} if share else None
    return {
        'task': 'train',
        'controller': 'rstdp',
        'scenario': scenario,
        'sweep.rstdp.c_r': f'c_r-{c_r}',
        'sweep.training.save_every': f'save_every-{every}',
        'seeds': [0, 1],
        'simulator': {'course': 'scenario_1'},
        'metrics': {},
        'times': {'last_lane_loss_step': {'median': median, 'ci_low': 10.0, 'ci_high': None}},
        'laps': {'all': {'completed': completed, 'mean_abs_distance_m': error}},
    }


RESULTS = {
    'name': 'learning rate',
    'groups': [
        group('1', '0.1', '50', 900.0, 1.0),
        group('1', '0.003', '50', None, 0.0),
        group('1', '0.03', '50', 400.0, 0.5),
        group('1', '0.03', '60', 500.0, 0.5),
        group('2', '0.03', '50', 600.0, 1.0),
    ],
}


def test_each_line_has_one_thing_that_changes() -> None:
    """By rising value; what was not measured is left out."""
    assert swept_parameters(RESULTS) == ['rstdp.c_r', 'training.save_every']
    lines = sweep_lines(RESULTS, 'rstdp.c_r')
    first, second, other = (
        'R-STDP, scenario 1, save_every-50',
        'R-STDP, scenario 1, save_every-60',
        'R-STDP, scenario 2, save_every-50',
    )
    assert {name: set(found) for name, found in lines.items()} == {
        'error': {first, second, other},
        'completed': {first, second, other},
        'settling': {first, second, other},
    }
    assert [tuple(point) for point in lines['completed'][first]] == [
        (0.003, 0.0, 0.0, 100.0),
        (0.03, 50.0, 25.0, 100.0),
        (0.1, 100.0, 50.0, 100.0),
    ]
    assert [tuple(point) for point in lines['settling'][first]] == [
        (0.03, 400.0, 10.0, None),
        (0.1, 900.0, 10.0, None),
    ]
    assert [point.value for point in lines['error'][first]] == [0.03, 0.1]


@pytest.mark.parametrize(
    ('axis', 'name', 'value'),
    [
        ('sweep.rstdp.c_r', 'c_r-1e-05', 1e-05),
        ('sweep.rstdp.c_r', 'c_r--2', -2.0),
        ('sweep.simulator.camera.antialias', 'antialias-true', 'true'),
    ],
)
def test_a_name_stands_for_its_value(axis: str, name: str, value: object) -> None:
    """Numbers are numbers."""
    assert swept_value(axis, name) == value


def test_it_is_drawn(tmp_path: Path) -> None:
    """With every line in the legend; without anything measured it is refused."""
    (file,) = draw_sweep(RESULTS, 'rstdp.c_r', tmp_path / 'sweep.svg', 'Learning rate')
    assert file.stat().st_size > 5000
    with pytest.raises(SpikelaneError, match=r'sweep of rstdp.c_r: expected finished runs, got'):
        draw_sweep({'groups': []}, 'rstdp.c_r', tmp_path / 'none.svg')
    assert not (tmp_path / 'none.svg').exists()
