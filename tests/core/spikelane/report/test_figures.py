"""What the report's figures are made of: when trainings had their first lap and were stable."""

from __future__ import annotations

from pathlib import Path
import re
from typing import Any

import pytest

from spikelane.figures.training_time import draw_training_time, TrainingTimes
from spikelane_controllers.learning.results import Time
from spikelane_controllers.learning.training import Termination


def ends_of(*ends: tuple[int, str, int, str]) -> list[Termination]:
    """Return how episodes ended, of step, lane, length in steps of 50 ms and reason."""
    return [
        Termination(step, number, lane, 'A', 1.0, 0.0, length, reason)
        for number, (step, lane, length, reason) in enumerate(ends, 1)
    ]


def test_rstdp_is_stable_with_three_laps_in_a_row(finish_training: Any) -> None:
    """As any controller; its first lap ends an episode."""
    lost = (900, 'outer', 900, 'lane_lost')
    laps = [
        (5200, 'inner', 4300, 'laps_complete'),
        (9900, 'outer', 4700, 'laps_complete'),
        (14_200, 'inner', 4300, 'laps_complete'),
    ]
    run = finish_training('rstdp', ends_of(lost, *laps), steps=100_000)
    assert (run.first_lap(), run.stable()) == ((5200.0, True), (900.0, True))
    never = finish_training('rstdp', ends_of(lost), steps=100_000)
    assert never.first_lap() == (100_000.0, False)
    again = ends_of(*laps[:2], (11_000, 'inner', 1100, 'lane_lost'))
    assert finish_training('rstdp', again, steps=100_000).stable() == (100_000.0, False)


def test_dqns_first_lap_is_within_an_episode(finish_training: Any) -> None:
    """31.99 m at 1 rad/s, 0.0975 m and 50 ms a step, 0.004875 m, take 6,563 steps."""
    config = {'simulator': {'robot.wheel_radius_m': 0.0975}, 'dqn': {'task.drive_rad_s': 1.0}}
    ends = ends_of(
        (656, 'outer', 6560, 'lane_lost'),
        (1656, 'outer', 10_000, 'step_limit'),
        (2656, 'inner', 10_000, 'step_limit'),
        (3656, 'outer', 10_000, 'step_limit'),
    )
    run = finish_training('dqn', ends, steps=100_000, **config)
    assert run.first_lap() == (6560.0 + 6563.0, True)
    assert run.stable() == (6560.0, True)
    never = finish_training('dqn', ends[:1], steps=100_000, **config)
    assert never.first_lap() == never.stable() == (6560.0, False)
    # At twice the speed half as many are enough.
    config['dqn'] = {'task.drive_rad_s': 2.0}
    fast = finish_training('dqn', ends[:1], steps=100_000, **config)
    assert fast.first_lap() == (3282.0, True)


@pytest.mark.parametrize(
    ('times', 'text'),
    [
        ([Time(100.0, True), Time(300.0, True), Time(400.0, False)], '2 of 3'),
        ([Time(400.0, False)], '0 of 1'),
        ([Time(50.0, True)], '1 of 1'),
    ],
)
def test_bars_say_how_many_got_there(tmp_path: Path, times: list[Time], text: str | None) -> None:
    """And a cross stands where none did."""
    groups = {'R-STDP': TrainingTimes(times, times, 'black')}
    draw_training_time(groups, tmp_path / 'times.svg', 'Training time')
    shares = re.findall(r'<!--\s+(\d+ of \d+) -->', (tmp_path / 'times.svg').read_text())
    assert shares == ([text] * 2 if text else [])
