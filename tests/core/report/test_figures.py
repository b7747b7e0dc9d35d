"""What the report's figures are made of: when trainings had their first lap and were stable."""

from __future__ import annotations

from pathlib import Path
import re
from typing import Any

import pytest

from spikelane.figures.training_time import draw_training_time, Time, TrainingTimes
from spikelane.report.runs import TrainingRun
from spikelane.report.training_times import first_lap, stable
from spikelane_controllers.training import Termination


def training(controller: str, ends: list[tuple[int, str, int, str]], **config: Any) -> TrainingRun:
    """Make a training from step, lane, length in steps of 50 ms and reason of its episodes."""
    return TrainingRun(
        controller=controller,
        scenario='1',
        seed=0,
        setting='',
        folder=Path('x'),
        config={'scenario': '1', **config},
        metrics={},
        steps=100_000,
        terminations=[
            Termination(step, number, lane, 'A', 1.0, 0.0, length, reason)
            for number, (step, lane, length, reason) in enumerate(ends, 1)
        ],
        outcomes=[],
    )


def test_rstdp_is_stable_after_its_last_lane_loss() -> None:
    """Its first lap ends an episode; that it is stable later is censored if it has not settled."""
    lost = (900, 'outer', 900, 'lane_lost')
    laps = [(5200, 'inner', 4300, 'laps_complete'), (9900, 'outer', 4700, 'laps_complete')]
    run = training('rstdp', [lost, *laps])
    assert (first_lap(run), stable(run)) == ((5200.0, True), (900.0, True))
    assert first_lap(training('rstdp', [lost])) == (100_000.0, False)
    again = training('rstdp', [*laps, (11_000, 'inner', 1100, 'lane_lost')])
    assert stable(again) == (11_000.0, False)


def test_dqns_first_lap_is_within_an_episode() -> None:
    """31.99 m at 1 rad/s, 0.0975 m and 50 ms a step, 0.004875 m, take 6,563 steps."""
    simulator = {'robot.wheel_radius_m': 0.0975}
    ends = [
        (656, 'outer', 6560, 'lane_lost'),
        (1656, 'outer', 10_000, 'step_limit'),
        (2656, 'inner', 10_000, 'step_limit'),
        (3656, 'outer', 10_000, 'step_limit'),
    ]
    run = training('dqn', ends, simulator=simulator, dqn={'task.drive_rad_s': 1.0})
    assert first_lap(run) == (6560.0 + 6563.0, True)
    assert stable(run) == (6560.0, True)
    # At twice the speed half as many are enough.
    fast = training('dqn', ends[:1], simulator=simulator, dqn={'task.drive_rad_s': 2.0})
    assert first_lap(fast) == (3282.0, True)
    never = training('dqn', ends[:1], simulator=simulator, dqn={'task.drive_rad_s': 1.0})
    assert first_lap(never) == stable(never) == (6560.0, False)


@pytest.mark.parametrize(
    ('times', 'text'),
    [
        ([Time(100.0, True), Time(300.0, True), Time(400.0, False)], '2 of 3'),
        ([Time(400.0, False)], None),
        ([Time(50.0, True)], '1 of 1'),
    ],
)
def test_bars_say_how_many_got_there(tmp_path: Path, times: list[Time], text: str | None) -> None:
    """And a cross stands where none did."""
    groups = {'R-STDP': TrainingTimes(times, times, 'black')}
    draw_training_time(groups, tmp_path / 'times.svg', 'Training time')
    shares = re.findall(r'<!--\s+(\d+ of \d+) -->', (tmp_path / 'times.svg').read_text())
    assert shares == ([text] * 2 if text else [])
