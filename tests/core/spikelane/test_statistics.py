"""Means, shares, times and how sure they are: values from tables and of SciPy's estimators."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import CensoredData, ecdf, ttest_1samp

from spikelane.statistics import (
    effective_units,
    equivalence_statistics,
    kaplan_meier_medians,
    mean_interval,
    mean_statistics,
    share_statistics,
    time_statistics,
)


def test_a_mean_has_student_s_interval() -> None:
    """For 1, 2, 3 and 6, s^2 = 14 / 3 and t(0.975, 3) = 3.182446."""
    half = 3.182446 * (14 / 3) ** 0.5 / 2
    assert mean_statistics([6.0, 1.0, 3.0, 2.0]) == {
        'n': 4,
        'units': 4,
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
        'units': 1,
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
    """For n = 10 it is (p + z^2/2n -+ z sqrt(p q / n + z^2/4n^2)) / (1 + z^2/n), z = 1.959964."""
    assert share_statistics(successes, 10) == {
        'n': 10,
        'successes': successes,
        'share': successes / 10,
        'ci_low': pytest.approx(low, abs=1e-6),
        'ci_high': pytest.approx(high, abs=1e-6),
    }


def test_values_of_one_unit_count_as_their_mean() -> None:
    """Units of 1 and 3, 2 and 4 and 6: means of 2 and 4, not five draws."""
    statistics = mean_statistics([1.0, 2.0, 3.0, 4.0, 6.0], ['a', 'b', 'a', 'b', 'b'])
    assert statistics is not None
    assert (statistics['n'], statistics['units'], statistics['mean']) == (5, 2, 3.0)
    # t(0.975, 1) = 12.706205, s = sqrt(2), half = t s / sqrt(2).
    assert statistics['ci_low'] == pytest.approx(3 - 12.706205, abs=1e-5)


def test_an_interval_of_a_mean_holds_possible_values_only() -> None:
    """On a log scale with one bound, on a logit scale with two; else Student's own."""
    # t(0.975, 4) = 2.776445; half = 2.776445 * 0.0314 / sqrt(5) = 0.0389881.
    ratio = np.exp(0.0389881 / 0.038)
    assert mean_interval(0.038, 0.0314, 5, low=0.0) == pytest.approx(
        (0.038 / ratio, 0.038 * ratio), rel=1e-5
    )
    low, high = mean_interval(0.95, 0.08, 5, 0.0, 1.0)
    change = 2.776445 * 0.08 / 5**0.5 / (0.95 * 0.05)
    logit = np.log(0.95 / 0.05)
    assert low == pytest.approx(1 / (1 + np.exp(change - logit)), rel=1e-5)
    assert high == pytest.approx(1 / (1 + np.exp(-change - logit)), rel=1e-5)
    assert mean_interval(0.0, 0.0, 5, low=0.0) == (0.0, 0.0)
    with pytest.raises(ValueError, match='expected a mean from 0'):
        mean_interval(-1.0, 0.1, 5, low=0.0)


def test_laps_of_few_units_are_not_more_draws() -> None:
    """20 of 20 laps of ten seeds are no surer than 10 of 10."""
    ten = share_statistics(10, 10)
    both_lanes = share_statistics(20, 20, units=10)
    assert (both_lanes['ci_low'], both_lanes['ci_high']) == (ten['ci_low'], ten['ci_high'])
    assert (effective_units([2] * 10), effective_units([3, 1])) == (10.0, 1.6)


def test_medians_of_censored_times_are_kaplan_and_meiers() -> None:
    """Against SciPy's survival function, at whose half they are; ties included."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        n = int(rng.integers(3, 15))
        times, reached = rng.integers(1, 12, n).astype(float), rng.random(n) < 0.7
        data = CensoredData(uncensored=times[reached], right=times[~reached])
        survival = ecdf(data).sf
        half = survival.quantiles[survival.probabilities < 0.5 + 1e-9]
        less = survival.quantiles[survival.probabilities < 0.5 - 1e-9]
        expected = np.inf
        if len(half):
            expected = (half[0] + less[0]) / 2 if len(less) else half[0]
        assert kaplan_meier_medians(times, reached) == expected


def test_times_not_reached_are_neither_dropped_nor_counted_as_reached() -> None:
    """Dropping them would give a median of 3, counting them 3.5; the times of two are unknown."""
    statistics = time_statistics([1, 2, 3, 4, 5, 3.5, 2.5], [True] * 5 + [False, False])
    # Surviving: 6/7, 5/7, (after 2.5 four of five) 15/28, and 5/14 after 4.
    assert statistics is not None
    assert (statistics['median'], statistics['reached'], statistics['n']) == (4.0, 5, 7)
    assert (statistics['min'], statistics['max'], statistics['max_reached']) == (1.0, 5.0, True)
    never = time_statistics([1, 2, 3], [True, False, False])
    assert never is not None
    assert (never['median'], never['max_reached']) == (None, False)
    assert time_statistics([], []) is None


def test_a_median_of_six_or_more_has_an_interval() -> None:
    """For 1 to 20 the 95 % interval by the bootstrap's order statistics is about 6 to 15."""
    statistics = time_statistics(list(range(1, 21)), [True] * 20)
    assert statistics is not None
    assert statistics['median'] == 10.5
    assert 5.5 <= statistics['ci_low'] <= 7
    assert 14 <= statistics['ci_high'] <= 15.5
    few = time_statistics([1, 2, 3, 4, 5], [True] * 5)
    assert few is not None
    assert (few['ci_low'], few['ci_high']) == (None, None)
    # Where half never get there, it has no upper end.
    half = time_statistics(list(range(10)), [True] * 5 + [False] * 5)
    assert half is not None
    assert half['ci_high'] is None


def test_equivalence_is_two_one_sided_t_tests() -> None:
    """Those of SciPy, against either margin; the interval is of 90 %."""
    differences = np.random.default_rng(0).normal(0.02, 0.1, 30)
    for margin in (0.03, 0.06, 0.3):
        found = equivalence_statistics(differences, margin)
        above = ttest_1samp(differences, -margin, alternative='greater')
        below = ttest_1samp(differences, margin, alternative='less')
        assert found['p'] == pytest.approx(max(above.pvalue, below.pvalue))
        assert found['is_equivalent'] == (found['p'] < 0.05)
        interval = ttest_1samp(differences, 0.0).confidence_interval(0.9)
        assert (found['ci_low'], found['ci_high']) == pytest.approx(tuple(interval))
        inside = -margin < found['ci_low'] and found['ci_high'] < margin
        assert found['is_equivalent'] == inside


def test_a_few_scattered_differences_are_not_called_small() -> None:
    """No difference is found either: that is the point."""
    scattered = [-3.0, 2.0, 1.0, -0.5]
    assert ttest_1samp(scattered, 0.0).pvalue > 0.05
    assert not equivalence_statistics(scattered, 1.0)['is_equivalent']


def test_differences_without_spread_are_as_large_as_they_are() -> None:
    """Within the margin or not; no NaN."""
    assert equivalence_statistics([0.1, 0.1, 0.1], 0.2)['is_equivalent']
    assert not equivalence_statistics([0.2, 0.2], 0.2)['is_equivalent']
