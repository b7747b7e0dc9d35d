"""Which drives the report compares, and how it names those that it does not show."""

from __future__ import annotations

from pathlib import Path

from spikelane.report.comparisons import comparisons, representative_laps
from spikelane.report.drawing import draw_figures
from spikelane.report.runs import Lap, LeftOut, Runs


def lap(
    controller: str,
    *,
    seed: int = 0,
    setting: str = '',
    lane: str = 'outer',
    scenario: str = '1',
    error_m: float = 0.02,
    completed: bool = True,
) -> Lap:
    """Make a lap that left nothing."""
    return Lap(
        controller=controller,
        scenario=scenario,
        seed=seed,
        setting=setting,
        folder=Path('/nowhere'),
        config={'scenario': scenario},
        metrics={'completed': completed, 'mean_abs_distance_m': error_m},
        lane=lane,
    )


def test_the_first_figure_has_each_controller_once_in_the_papers_setting() -> None:
    """What is left of the settings is in figures of its own, the other lane after the outer."""
    laps = [
        lap('rstdp', setting='c_r 0.03'),
        lap('rstdp'),
        lap('dqn', setting='robot.engine kinematic'),
        lap('braitenberg', lane='inner'),
    ]
    found = comparisons(representative_laps(laps))
    shown = [
        (each.name, each.number, each.of, [(key.controller, key.setting) for key in each.keys])
        for each in found
    ]
    assert shown == [
        (
            'deviation_scenario_1',
            1,
            2,
            [('dqn', 'robot.engine kinematic'), ('rstdp', '')],
        ),
        ('deviation_scenario_1_2', 2, 2, [('rstdp', 'c_r 0.03')]),
        ('deviation_scenario_1_inner', 1, 1, [('braitenberg', '')]),
    ]


def test_of_a_group_the_completed_drive_of_median_error_is_shown() -> None:
    """Not the best one, and none that ended early."""
    errors = {0: 0.01, 1: 0.05, 2: 0.02}
    laps = [lap('rstdp', seed=seed, error_m=error_m) for seed, error_m in errors.items()]
    [chosen] = representative_laps(
        [*laps, lap('rstdp', seed=3, error_m=0.001, completed=False)]
    ).values()
    assert chosen.seed == 2


def test_captions_name_the_seeds_that_are_shown_and_that_are_not(tmp_path: Path) -> None:
    """Also where the figure cannot be drawn, as here."""
    laps = [lap('rstdp', seed=seed, error_m=0.01 * seed) for seed in (1, 2, 3)]
    laps.append(lap('rstdp', seed=9, completed=False))
    laps.append(lap('braitenberg', seed=4))
    left_out = draw_figures(Runs(laps=laps), tmp_path, lambda what: None).left_out
    [caption] = [each.what for each in left_out if each.what.startswith('Deviation')]
    assert caption == (
        'Deviation over the first lap, scenario 1, outer lane. '
        'Braitenberg: seed 4, the only one; '
        'R-STDP: seed 2, of median error of the 3 of 4 that completed it; not shown: 3 of seeds '
        '1, 3, 9'
    )


def test_settings_and_courses_without_room_are_named(tmp_path: Path) -> None:
    """Three of four figures are drawn for each scenario and lane, and three further courses."""
    laps = [lap('rstdp', setting=f'c_r {number}') for number in range(11)]
    laps += [lap('rstdp', scenario=scenario) for scenario in ('a', 'b', 'c', 'd')]
    laps.append(lap('rstdp', scenario='random courses'))
    left_out = draw_figures(Runs(laps=laps), tmp_path, lambda what: None).left_out
    named = [each for each in left_out if 'first lap' not in each.what]
    why = 'the report draws at most 3 figures for each scenario and lane; the tables contain all'
    # The first figure has one drive, of the first setting; the others four each.
    assert LeftOut('Deviation, R-STDP, scenario 1 (c_r 9), outer lane', why) in named
    assert LeftOut('Deviation, R-STDP, scenario 1 (c_r 10), outer lane', why) in named
    assert not any('c_r 8' in each.what for each in named)
    why = "the report draws at most 3 courses in addition to the paper's; the tables contain all"
    assert LeftOut('Deviation on d', why) in named
    why = 'each lap was driven on a different course, so that one figure cannot compare them'
    assert LeftOut('Deviation on random courses', why) in named
    why = 'they are counted in laps driven in one process only, and no lap here was'
    assert LeftOut('Operations for a decision', why) in named
