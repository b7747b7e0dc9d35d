"""Differences of two groups, against published examples and calculations by hand."""

import math

import numpy as np
import pytest

from spikelane.differences import difference_of_means, difference_of_shares, difference_of_times

# Student's data on sleep, which R has as `sleep`.
FIRST = [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0]
SECOND = [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4]


def test_means_are_compared_as_r_does_it() -> None:
    """`t.test(extra ~ group)`: p 0.07939, interval -3.3654832 to 0.2054832 with the other sign."""
    found = difference_of_means(FIRST, SECOND)
    assert (found.first, found.second) == pytest.approx((0.75, 2.33))
    assert found.difference == pytest.approx(1.58)
    assert (found.ci_low, found.ci_high) == pytest.approx((-0.2054832, 3.3654832), abs=1e-6)
    assert found.p_value == pytest.approx(0.07939, abs=5e-6)
    assert found.n == (10, 10)
    # d = 1.58 / sqrt((1.789010 ** 2 + 2.002249 ** 2) / 2) = 0.832181; J(18) = 0.957646
    assert found.effect == pytest.approx(0.832181 * 0.957646, abs=1e-5)


def test_shares_are_compared_as_published() -> None:
    """Newcombe 1998, example (a) by method 10; Fisher's tea tasting has p = 17 / 35."""
    found = difference_of_shares((48, 80), (56, 70))
    assert found.difference == pytest.approx(0.2)
    assert (found.ci_low, found.ci_high) == pytest.approx((0.0524, 0.3339), abs=5e-5)
    assert difference_of_shares((1, 4), (3, 4)).p_value == pytest.approx(17 / 35)
    none, all_of_them = difference_of_shares((0, 5), (5, 5)), math.pi
    assert none.effect == pytest.approx(all_of_them)
    assert none.ci_high == pytest.approx(1.0)


def log_rank_p(groups: list[list[tuple[float, bool]]]) -> float:
    """Return the log-rank test's p-value from its definition; no two events at one time."""
    everyone = sorted((time, seen, k) for k, group in enumerate(groups) for time, seen in group)
    less_expected = variance = 0.0
    for index, (_, seen, k) in enumerate(everyone):
        at_risk = [kk for _, _, kk in everyone[index:]]
        share = at_risk.count(0) / len(at_risk)
        if seen:
            less_expected += (k == 0) - share
            variance += share * (1 - share)
    return math.erfc(abs(less_expected) / math.sqrt(2 * variance))


def test_times_are_compared_where_some_were_not_reached() -> None:
    """Medians 3.5 and 11; the last of the second group never came."""
    first, second = [1.0, 2, 3, 4, 5, 6], [3.5, 7, 10, 12, 14, 15]
    reached = [True] * 5 + [False]
    found = difference_of_times(first, [True] * 6, second, reached)
    assert (found.first, found.second, found.difference) == (3.5, 11.0, 7.5)
    assert found.ci_low is not None
    assert 0 < found.ci_low < 7.5
    groups = [
        [(time, True) for time in first],
        list(zip(second, reached, strict=True)),
    ]
    assert found.p_value == pytest.approx(log_rank_p(groups))


def test_the_interval_of_medians_covers_what_it_says() -> None:
    """About 95 % of 100 trials; two exponential groups of 20 whose medians differ by log(2)."""
    rng = np.random.default_rng(3)
    covered = 0
    for _ in range(100):
        first, second = rng.exponential(1.0, 20), rng.exponential(2.0, 20)
        found = difference_of_times(list(first), [True] * 20, list(second), [True] * 20)
        assert found.ci_low is not None
        assert found.ci_high is not None
        covered += found.ci_low <= math.log(2) <= found.ci_high
    assert 90 <= covered <= 100


@pytest.mark.parametrize(
    'found',
    [
        difference_of_means([1.0], [2.0, 3.0]),
        difference_of_means([1.0, 1.0], [2.0, 2.0]),
        difference_of_times([5.0, 5.0], [False, False], [5.0, 5.0], [False, False]),
    ],
)
def test_too_little_has_no_interval_and_no_p_value(found: object) -> None:
    """One unit, no spread, or no event."""
    numbers = found._asdict()  # type: ignore[attr-defined]
    assert numbers['ci_low'] is numbers['ci_high'] is numbers['p_value'] is None
    assert numbers['effect'] is None


def test_a_median_that_is_not_known_has_no_difference() -> None:
    """More than half of the second group never reached it; the test has a p-value all the same."""
    found = difference_of_times([1.0, 2, 3], [True] * 3, [9.0, 9, 9], [False] * 3)
    assert (found.first, found.second, found.difference) == (2.0, None, None)
    assert found.p_value is not None
    assert found.p_value < 0.05
