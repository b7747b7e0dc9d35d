"""Means, shares and times to an event, with 95 % intervals over independent units.

A unit is what was drawn independently: a seed, a training or a course (`summary.unit_of`).
Several values of one unit, such as the laps of one training, are averaged first, and the
intervals are over the units.

- A mean has Student's t interval. Where a quantity has a lower bound, the interval is taken on a
  log scale, and where it has two bounds on a logit scale, by the delta method: for a mean m with
  standard error e, log(m) ± t e / m. So the interval holds possible values only. In simulations
  of skewed positive values (log-normal and gamma, 3 to 20 units) it covers the mean in 93 to
  96 % of cases, the plain t interval in 90 to 94 %, and a percentile bootstrap in 70 to 92 %.
- A share has Wilson's interval for as many draws as there are units. A unit's own share lies
  between 0 and 1 and so varies at most as much as a single success or failure does; the interval
  is therefore never too narrow because the values of a unit depend on each other.
- A time to an event is right-censored where the event had not come when the unit was observed
  last. Its median is the Kaplan-Meier estimate, with a percentile bootstrap over units.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
import math
import statistics
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

LEVEL = 0.95

#: Fewer units than this have no 95 % interval of a median: even the range of five covers the
#: median in only 1 - 2 / 2^5 = 93.75 % of cases.
LEAST_FOR_MEDIAN = 6

#: Level of each of the two tests whether a difference is small.
_ONE_SIDED = 0.05

_RESAMPLES = 9_999

#: What `metrics.json` and `results.json` say about the intervals in them.
METHOD = {
    'level': LEVEL,
    'of_means': "Student's t over units; on a log or logit scale where a quantity has bounds",
    'of_shares': 'Wilson score, with as many draws as there are units',
    'of_medians': 'Kaplan-Meier; percentile bootstrap over units, from 6 units on',
}


def mean_statistics(
    values: Sequence[float],
    units: Sequence[Hashable] | None = None,
    low: float = -math.inf,
    high: float = math.inf,
) -> dict[str, float | int | None] | None:
    """Describe values.

    Args:
        values: Finite, (n,).
        units: The unit of each value, (n,); without it each value is a unit.
        low: Smallest possible value.
        high: Largest possible value; only with a finite `low`.

    Returns:
        n: the number of values; units: the number of units; of the means of the units: mean, std
        (divided by units - 1), min, median, max, ci_low and ci_high; std and the interval None
        for one unit. None for no value.
    """
    if not values:
        return None
    means = unit_means(values, range(len(values)) if units is None else units)
    n = len(means)
    # Exact sums: the same on every machine.
    mean = math.fsum(means) / n
    std = interval = None
    if n > 1:
        std = math.sqrt(math.fsum((value - mean) ** 2 for value in means) / (n - 1))
        interval = mean_interval(mean, std, n, low, high)
    return {
        'n': len(values),
        'units': n,
        'mean': mean,
        'std': std,
        'min': min(means),
        'median': statistics.median(means),
        'max': max(means),
        'ci_low': None if interval is None else interval[0],
        'ci_high': None if interval is None else interval[1],
    }


def unit_means(values: Sequence[float], units: Sequence[Hashable]) -> list[float]:
    """Return the mean of each unit's values, in the order of their first values."""
    members: dict[Hashable, list[float]] = {}
    for value, unit in zip(values, units, strict=True):
        members.setdefault(unit, []).append(value)
    return [math.fsum(each) / len(each) for each in members.values()]


def mean_interval(
    mean: float, std: float, n: int, low: float = -math.inf, high: float = math.inf
) -> tuple[float, float]:
    """Return the 95 % interval of a mean.

    Args:
        mean: Mean of the units, from `low` to `high`.
        std: Standard deviation between units, divided by n - 1.
        n: Units, at least two.
        low: Smallest possible value.
        high: Largest possible value; only with a finite `low`.

    Raises:
        ValueError: The mean is not a possible value.
    """
    if not low <= mean <= high:
        raise ValueError(f'expected a mean from {low} to {high}, got {mean}')
    half = _t_quantile(n - 1) * std / math.sqrt(n)
    if not half or mean in (low, high):
        return mean, mean
    if math.isinf(low):
        return mean - half, mean + half
    above = mean - low
    if math.isinf(high):  # the derivative of log(x) is 1 / x
        factor = _exp(half / above)
        return low + above / factor, low + above * factor
    below = high - mean  # the derivative of log(x / (1 - x)) is 1 / (x (1 - x))
    factor = _exp(half * (high - low) / (above * below))
    odds = above / below

    def value(odds: float) -> float:
        return high - (high - low) / (1 + odds)

    return value(odds / factor), value(odds * factor)


def _exp(value: float) -> float:
    """Return e to the power of a value; beyond what a float holds, the largest float."""
    return math.exp(min(value, 700.0))


def equivalence_statistics(differences: Sequence[float], margin: float) -> dict[str, Any]:
    """Test whether a mean difference is small: two one-sided t tests (Schuirmann 1987).

    That no difference was found says nothing of how large it is. Here it counts as small if both
    "at least margin" and "at most -margin" are rejected at 5 %, that is, if the 90 % interval of
    the mean lies between them.

    Args:
        differences: One of each pair of units, at least two, (n,).
        margin: The largest mean difference, either way, that makes no odds.

    Returns:
        n, mean, std (divided by n - 1), ci_low and ci_high (the 90 % interval), margin, p (the
        larger of both tests) and is_equivalent.
    """
    import numpy as np
    from scipy.stats import t

    values, n = np.asarray(differences, float), len(differences)
    mean, std = float(values.mean()), float(values.std(ddof=1))
    error = std / math.sqrt(n)
    half = float(t.ppf(1 - _ONE_SIDED, n - 1)) * error
    inside = margin - abs(mean)
    p = float(t.sf(inside / error, n - 1)) if error else float(inside <= 0)
    return {
        'n': n,
        'mean': mean,
        'std': std,
        'ci_low': mean - half,
        'ci_high': mean + half,
        'margin': margin,
        'p': p,
        'is_equivalent': p < _ONE_SIDED,
    }


def share_statistics(successes: int, n: int, units: float | None = None) -> dict[str, Any]:
    """Describe how often something succeeded.

    Args:
        successes: How often it did.
        n: Number of attempts, at least one.
        units: The number of independent units that these are of; n without it. Where units are
            of unequal size, the effective number (`effective_units`).

    Returns:
        n, successes, share, ci_low and ci_high (Wilson's score interval).
    """
    z = statistics.NormalDist().inv_cdf((1 + LEVEL) / 2)
    draws, share = units or n, successes / n
    middle = share + z**2 / (2 * draws)
    half = z * math.sqrt(share * (1 - share) / draws + (z / (2 * draws)) ** 2)
    scale = 1 + z**2 / draws
    return {
        'n': n,
        'successes': successes,
        'share': share,
        'ci_low': 0.0 if not successes else (middle - half) / scale,
        'ci_high': 1.0 if successes == n else (middle + half) / scale,
    }


def effective_units(sizes: Sequence[int]) -> float:
    """Return how many units of equal size are worth those of these sizes (Kish 1965)."""
    return sum(sizes) ** 2 / sum(size**2 for size in sizes)


def time_statistics(times: Sequence[float], reached: Sequence[bool]) -> dict[str, Any] | None:
    """Describe times to an event that not every unit has reached.

    Args:
        times: When the event came, or when the unit was observed last without it, (n,).
        reached: Whether it came, (n,).

    Returns:
        n; reached: how many reached it; median: the Kaplan-Meier estimate, None where less than
        half are known to have reached it; ci_low and ci_high: its interval, both None for fewer
        than LEAST_FOR_MEDIAN units, ci_high None where the interval has no upper end; min and
        max: of all times; min_reached and max_reached: whether these are times of an event.
        None for no time.
    """
    if not times:
        return None
    import numpy as np

    found, seen = np.array(times, float), np.array(reached, bool)
    order = np.lexsort((~seen, found))
    low, high = _median_interval(found, seen) if len(times) >= LEAST_FOR_MEDIAN else (None, None)
    return {
        'n': len(times),
        'reached': int(seen.sum()),
        'median': _finite(float(kaplan_meier_medians(found, seen))),
        'ci_low': low,
        'ci_high': high,
        'min': float(found[order[0]]),
        'max': float(found[order[-1]]),
        'min_reached': bool(seen[order[0]]),
        'max_reached': bool(seen[order[-1]]),
    }


def kaplan_meier_medians(
    times: NDArray[np.float64], reached: NDArray[np.bool_], axis: int = -1
) -> NDArray[np.float64]:
    """Return Kaplan-Meier medians; of many samples at once, as a bootstrap needs them.

    A median is the first time at which at most half have not reached the event. Where it is
    exactly half until the next event, the median is the middle of both times, as of uncensored
    values.

    Args:
        times: As in `time_statistics`, (..., n).
        reached: Likewise.
        axis: The last one.

    Returns:
        Medians, (...,); infinite where more than half have not reached the event in the end.
    """
    import numpy as np

    del axis
    # Events come before censored times of the same value.
    order = np.lexsort((~np.asarray(reached, bool), times), axis=-1)
    times = np.take_along_axis(np.asarray(times, float), order, -1)
    events = np.take_along_axis(np.asarray(reached, bool), order, -1)
    at_risk = np.arange(times.shape[-1], 0, -1)
    surviving = np.cumprod(1 - events / at_risk, axis=-1)

    def first(is_wanted: NDArray[np.bool_]) -> NDArray[np.float64]:
        index = is_wanted.argmax(axis=-1)[..., None]
        found = np.take_along_axis(times, index, -1)[..., 0]
        return np.where(is_wanted.any(axis=-1), found, np.inf)

    tolerance = 1e-9  # of products that are a half
    at, after = first(surviving <= 0.5 + tolerance), first(surviving < 0.5 - tolerance)
    return np.where(np.isfinite(after), (at + after) / 2, at)


def _median_interval(
    times: NDArray[np.float64], reached: NDArray[np.bool_]
) -> tuple[float, float | None]:
    """Return the bootstrap's interval of the median; its upper end None where there is none."""
    import numpy as np
    from scipy.stats import bootstrap

    beyond = 1e100  # stands for infinity, which cannot be interpolated

    def medians(
        times: NDArray[np.float64], reached: NDArray[np.bool_], axis: int = -1
    ) -> NDArray[np.float64]:
        return np.minimum(kaplan_meier_medians(times, reached, axis), beyond)

    found = bootstrap(
        (times, reached),
        medians,
        n_resamples=_RESAMPLES,
        paired=True,
        confidence_level=LEVEL,
        method='percentile',
        rng=np.random.default_rng(0),
    ).confidence_interval
    low, high = (float(end) for end in found)
    return min(low, float(times.max())), None if high > times.max() else high


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _t_quantile(degrees: int) -> float:
    from scipy.stats import t

    return float(t.ppf((1 + LEVEL) / 2, degrees))
