"""How well a lap was driven, in numbers."""

import dataclasses
import math

import numpy as np
import pytest

from spikelane.runs.lap.metrics import lap_metrics
from spikelane.runs.lap.trajectory import Trajectory, TrajectoryError


def drive(
    distance_m: list[float], section: str, laps: list[int], progress_m: list[float]
) -> Trajectory:
    """Return a trajectory of these rows; what metrics do not look at is zero."""
    n = len(distance_m)
    zeros = np.zeros(n)
    return Trajectory(
        lane='outer',
        reason='laps_complete',
        stamp_ns=np.arange(1, n + 1) * 50_000_000,
        step=np.arange(n),
        distance_m=np.array(distance_m),
        heading_error_rad=zeros,
        position_m=zeros,
        progress_m=np.array(progress_m),
        section=np.array(list(section)),
        laps=np.array(laps),
        x_m=zeros,
        y_m=zeros,
        heading_rad=zeros,
        left_rad_s=zeros,
        right_rad_s=zeros,
        events=np.arange(n) + 10,
    )


@pytest.fixture
def lap() -> Trajectory:
    """Return a lap of four steps, which begins 9 m next to the lane."""
    return drive(
        [9.0, 0.25, -0.75, 0.25, -0.25], 'AABBA', [0, 0, 0, 0, 1], [0.0, 1.0, 2.0, 3.0, 5.0]
    )


def test_a_lap_by_hand(lap: Trajectory) -> None:
    """The reset's observation counts for the events only."""
    metrics = lap_metrics(lap, 0.5)
    sections = metrics.pop('sections')
    assert metrics == {
        'completed': True,
        'reason': 'laps_complete',
        'laps': 1,
        'steps': 4,
        'lap_time_s': 2.0,
        'mean_abs_distance_m': 0.375,
        'max_abs_distance_m': 0.75,
        'mean_distance_m': -0.125,
        # Squares about the mean: 0.375^2 + 0.625^2 + 0.375^2 + 0.125^2 = 0.6875, by four steps.
        'std_distance_m': math.sqrt(0.171875),
        'mean_speed_m_s': 2.5,
        'events': 60,
    }
    assert sections == {
        'A': {
            'steps': 2,
            'mean_abs_distance_m': 0.25,
            'max_abs_distance_m': 0.25,
            'mean_distance_m': 0.0,
        },
        'B': {
            'steps': 2,
            'mean_abs_distance_m': 0.5,
            'max_abs_distance_m': 0.75,
            'mean_distance_m': -0.25,
        },
    }


def test_sections_come_in_the_order_driven() -> None:
    """The inner lane begins in C."""
    lap = drive([0.0] * 5, 'CCBAF', [0] * 5, [0.0] * 5)
    assert list(lap_metrics(lap, 0.05)['sections']) == ['C', 'B', 'A', 'F']


def test_a_lap_that_was_not_completed_has_no_time() -> None:
    """The rest is measured as far as it went."""
    metrics = lap_metrics(drive([0.0, 0.5], 'AA', [0, 0], [0.0, 0.1]), 0.05)
    assert metrics['completed'] is False
    assert metrics['lap_time_s'] is None
    assert metrics['mean_speed_m_s'] == pytest.approx(2.0, rel=1e-15)


def test_the_lap_time_is_that_of_the_first_lap() -> None:
    """Two laps of two steps each."""
    metrics = lap_metrics(drive([0.0] * 5, 'AAAAA', [0, 0, 1, 1, 2], [0.0, 1, 2, 3, 4]), 0.25)
    assert (metrics['laps'], metrics['lap_time_s']) == (2, 0.5)


def test_means_are_of_exact_sums() -> None:
    """Ten tenths are one, which adding them up one by one is not."""
    lap = drive([0.0] + [0.1] * 10, 'A' * 11, [0] * 11, [0.0] * 11)
    assert lap_metrics(lap, 0.05)['mean_distance_m'] == 0.1


def test_a_reset_alone_is_no_drive() -> None:
    """There is nothing to take a mean of."""
    with pytest.raises(TrajectoryError, match='expected at least one step'):
        lap_metrics(drive([0.0], 'A', [0], [0.0]), 0.05)


def test_a_lap_after_which_the_lane_is_lost_completes_nothing(lap: Trajectory) -> None:
    """With several laps in a row, the means of the episode are then not those of laps."""
    lost = lap_metrics(dataclasses.replace(lap, reason='lane_lost'), 0.5)
    assert (lost['completed'], lost['laps'], lost['lap_time_s']) == (False, 1, 2.0)
    cut = lap_metrics(dataclasses.replace(lap, reason='step_limit'), 0.5)
    assert cut['completed'] is True
