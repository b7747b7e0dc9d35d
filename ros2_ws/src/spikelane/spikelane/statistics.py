"""Mean, spread and confidence of what was measured several times, with SciPy's distributions.

Of means the interval is Student's t, which supposes nothing but about normal values and holds for
the three to ten seeds that are usual; of shares it is Wilson's, which stays within [0, 1] and
does not shrink to nothing where all succeed. Where there is one value only, there is none.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any

LEVEL = 0.95

#: What `metrics.json` says of the intervals in it.
METHOD = {'level': LEVEL, 'of_means': "Student's t", 'of_shares': 'Wilson score'}


def mean_statistics(values: Sequence[float]) -> dict[str, float | int | None] | None:
    """Describe values.

    Args:
        values: Finite, (n,).

    Returns:
        n, mean, std (divided by n - 1), min, median, max, ci_low and ci_high; std and the
        interval None for one value. None for no value.
    """
    n = len(values)
    if not n:
        return None
    # Exact sums: the same on every machine.
    mean = math.fsum(values) / n
    ordered = sorted(values)
    median = (ordered[(n - 1) // 2] + ordered[n // 2]) / 2
    std = half = None
    if n > 1:
        std = math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (n - 1))
        half = _t_quantile(n - 1) * std / math.sqrt(n)
    return {
        'n': n,
        'mean': mean,
        'std': std,
        'min': ordered[0],
        'median': median,
        'max': ordered[-1],
        'ci_low': None if half is None else mean - half,
        'ci_high': None if half is None else mean + half,
    }


def share_statistics(successes: int, n: int) -> dict[str, Any]:
    """Describe how often something succeeded.

    Args:
        successes: How often it did.
        n: Of how many, at least one.

    Returns:
        n, successes, share, ci_low and ci_high.
    """
    from scipy.stats import binomtest

    interval = binomtest(successes, n).proportion_ci(LEVEL, 'wilson')
    return {
        'n': n,
        'successes': successes,
        'share': successes / n,
        'ci_low': float(interval.low),
        'ci_high': float(interval.high),
    }


def _t_quantile(degrees: int) -> float:
    from scipy.stats import t

    return float(t.ppf((1 + LEVEL) / 2, degrees))
