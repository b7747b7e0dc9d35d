"""Differences between two groups of independent units, with 95 % intervals and p-values.

The groups are taken as unpaired. Differences are of the second group less the first.

- Means: Welch's t-test and its interval; the effect size is Hedges' g, the difference in pooled
  standard deviations, corrected for few units.
- Shares: Fisher's exact test, and Newcombe's interval of the difference (his method 10, of two
  Wilson intervals); the effect size is Cohen's h.
- Times to an event: the log-rank test, and a percentile bootstrap of the difference of the
  Kaplan-Meier medians; there is no effect size.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

from spikelane.statistics import (
    kaplan_meier_medians,
    LEAST_FOR_MEDIAN,
    LEVEL,
    share_statistics,
    time_statistics,
)

_RESAMPLES = 9_999

#: What `spikelane compare --json` says about its numbers.
METHOD = {
    'level': LEVEL,
    'of_means': "Welch's t-test and interval; effect: Hedges' g",
    'of_shares': "Fisher's exact test, Newcombe's interval; effect: Cohen's h",
    'of_times': 'log-rank test; bootstrap of the difference of Kaplan-Meier medians',
}


class Difference(NamedTuple):
    """What two groups differ in; None where there are too few units for a number.

    Attributes:
        first: Mean, share or median of the first group.
        second: The second group's.
        difference: Second less first.
        ci_low: Lower end of the difference's interval.
        ci_high: Upper end.
        effect: Effect size, see the module.
        p_value: Two-sided.
        n: Units of the first and of the second group.
    """

    first: float | None
    second: float | None
    difference: float | None
    ci_low: float | None
    ci_high: float | None
    effect: float | None
    p_value: float | None
    n: tuple[int, int]


def difference_of_means(first: Sequence[float], second: Sequence[float]) -> Difference:
    """Compare values of the units of two groups, (n,) and (m,), each of one unit or more."""
    import numpy as np
    from scipy.stats import ttest_ind

    a, b = np.array(first, float), np.array(second, float)
    means = float(a.mean()), float(b.mean())
    n = len(a), len(b)
    difference = means[1] - means[0]
    if min(n) < 2:
        return Difference(*means, difference, None, None, None, None, n)
    variances = a.var(ddof=1), b.var(ddof=1)
    degrees = sum(n) - 2
    pooled = math.sqrt(sum((k - 1) * v for k, v in zip(n, variances, strict=True)) / degrees)
    if not pooled:  # no unit differs from the others of its group
        return Difference(*means, difference, None, None, None, None, n)
    test = ttest_ind(b, a, equal_var=False)
    interval = test.confidence_interval(LEVEL)
    effect = difference / pooled * _hedges_factor(degrees)
    return Difference(
        *means,
        difference,
        float(interval.low),
        float(interval.high),
        effect,
        float(test.pvalue),
        n,
    )


def difference_of_shares(first: tuple[int, int], second: tuple[int, int]) -> Difference:
    """Compare how often something succeeded.

    Args:
        first: Successes, and units, at least one.
        second: The second group's.
    """
    from scipy.stats import fisher_exact

    found = [share_statistics(*group) for group in (first, second)]
    a, b = (each['share'] for each in found)
    below = [each['share'] - each['ci_low'] for each in found]
    above = [each['ci_high'] - each['share'] for each in found]
    table = [[successes, n - successes] for successes, n in (first, second)]
    return Difference(
        a,
        b,
        b - a,
        b - a - math.hypot(below[1], above[0]),
        b - a + math.hypot(above[1], below[0]),
        2 * math.asin(math.sqrt(b)) - 2 * math.asin(math.sqrt(a)),
        float(fisher_exact(table).pvalue),
        (first[1], second[1]),
    )


def difference_of_times(
    first: Sequence[float],
    first_reached: Sequence[bool],
    second: Sequence[float],
    second_reached: Sequence[bool],
) -> Difference:
    """Compare times to an event that not every unit has reached.

    Args:
        first: As in `statistics.time_statistics`, (n,), n at least 1.
        first_reached: Likewise.
        second: The second group's, (m,), m at least 1.
        second_reached: Likewise.
    """
    import numpy as np
    from scipy.stats import CensoredData, logrank

    groups = ((first, first_reached), (second, second_reached))
    described = [time_statistics(*group) for group in groups]
    medians = [each['median'] for each in described if each is not None]
    n = len(first), len(second)
    p_value = None
    if min(n) > 1 and any([*first_reached, *second_reached]):
        data = [
            CensoredData.right_censored(times, np.logical_not(reached))
            for times, reached in groups
        ]
        found = float(logrank(*data).pvalue)
        p_value = found if math.isfinite(found) else None
    difference = low = high = None
    if None not in medians:
        difference = medians[1] - medians[0]
        if min(n) >= LEAST_FOR_MEDIAN:
            low, high = _interval_of_medians(groups)
    return Difference(medians[0], medians[1], difference, low, high, None, p_value, n)


def _interval_of_medians(
    groups: Sequence[tuple[Sequence[float], Sequence[bool]]],
) -> tuple[float | None, float | None]:
    """Return the interval of the second median less the first; an end None where it has none."""
    import numpy as np

    rng = np.random.default_rng(0)
    medians = []
    for times, reached in groups:
        drawn = rng.integers(len(times), size=(_RESAMPLES, len(times)))
        medians.append(
            kaplan_meier_medians(np.array(times, float)[drawn], np.array(reached)[drawn])
        )
    # Where neither has a median, nothing is known of the difference: it may be at either end.
    unknown = np.isinf(medians[0]) & np.isinf(medians[1])
    finite = [np.where(unknown, 0.0, each) for each in medians]
    differences = finite[1] - finite[0]
    share = (1 - LEVEL) / 2
    low, high = (
        float(np.quantile(np.where(unknown, end, differences), level, method='nearest'))
        for end, level in ((-np.inf, share), (np.inf, 1 - share))
    )
    return (low if math.isfinite(low) else None, high if math.isfinite(high) else None)


def _hedges_factor(degrees: int) -> float:
    """Return by how much Cohen's d is too large on average (Hedges 1981, exact)."""
    log = math.lgamma(degrees / 2) - math.lgamma((degrees - 1) / 2)
    return math.exp(log) / math.sqrt(degrees / 2)
