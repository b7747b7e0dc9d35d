"""Means, shares and how sure they are: values from tables."""

from __future__ import annotations

import pytest

from spikelane.statistics import mean_statistics, share_statistics


def test_a_mean_has_student_s_interval() -> None:
    """Of 1, 2, 3, 6: s^2 = 14 / 3, and t(0.975, 3) = 3.182446."""
    half = 3.182446 * (14 / 3) ** 0.5 / 2
    assert mean_statistics([6.0, 1.0, 3.0, 2.0]) == {
        'n': 4,
        'mean': 3.0,
        'std': pytest.approx(2.160247, abs=1e-6),
        'min': 1.0,
        'median': 2.5,
        'max': 6.0,
        'ci_low': pytest.approx(3.0 - half, abs=1e-5),
        'ci_high': pytest.approx(3.0 + half, abs=1e-5),
    }


def test_one_value_has_no_spread() -> None:
    """And no value nothing at all."""
    assert mean_statistics([2.0]) == {
        'n': 1,
        'mean': 2.0,
        'std': None,
        'min': 2.0,
        'median': 2.0,
        'max': 2.0,
        'ci_low': None,
        'ci_high': None,
    }
    assert mean_statistics([]) is None


def test_equal_values_have_an_interval_of_no_width() -> None:
    """Not one of NaN."""
    statistics = mean_statistics([0.25, 0.25, 0.25])
    assert statistics is not None
    assert (statistics['std'], statistics['ci_low'], statistics['ci_high']) == (0.0, 0.25, 0.25)


@pytest.mark.parametrize(
    ('successes', 'low', 'high'),
    [(8, 0.490162, 0.943318), (10, 0.722467, 1.0), (0, 0.0, 0.277533)],
)
def test_a_share_has_wilson_s_interval(successes: int, low: float, high: float) -> None:
    """Of ten: (p + z^2/2n -+ z sqrt(p q / n + z^2/4n^2)) / (1 + z^2/n) with z = 1.959964."""
    assert share_statistics(successes, 10) == {
        'n': 10,
        'successes': successes,
        'share': successes / 10,
        'ci_low': pytest.approx(low, abs=1e-6),
        'ci_high': pytest.approx(high, abs=1e-6),
    }
