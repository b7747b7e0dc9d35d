"""The table of what the controllers are to reach, as their cards say, and whether they do."""

from __future__ import annotations

from collections.abc import Mapping

from spikelane.report.groups import Key, Table
from spikelane.report.measured import Measured
from spikelane.report.quantities import NOTHING
from spikelane.statistics import mean_statistics, time_statistics
from spikelane_controllers.card import Aim
from spikelane_controllers.registry import cards, title


def aims_table(values: Mapping[str, Mapping[Key, Measured]]) -> Table:
    """Compare the 95 % intervals of what was measured with the aims.

    Args:
        values: As `measured.measured` has them.
    """
    rows = [
        _row(aim, key, found)
        for name, card in cards().items()
        for aim in card.aims
        for key, found in values.get(aim.measure, {}).items()
        if (key.controller, key.scenario) == (name, aim.scenario)
        and aim.setting in (None, key.setting)
    ]
    return Table(
        'Aims',
        'The interval is that of the median or of the mean over independent units. "yes": the '
        'whole interval meets the aim; "no": the whole interval misses it; "open": the aim lies '
        'within the interval.',
        ('controller', 'scenario', 'setting', 'measure', 'aim', '95 %', 'reached'),
        rows,
        brief=('measure', 'aim', 'reached'),
    )


def _row(aim: Aim, key: Key, found: Measured) -> tuple[str, ...]:
    quantity = found.quantity
    # A time that not all have reached has no mean.
    values = found.values if found.reached is None or all(found.reached) else ()
    if aim.is_of_median:
        reached = [True] * len(found.values) if found.reached is None else found.reached
        interval = time_statistics(found.values, reached)
        words = quantity.median_interval(found.values, found.reached)
    else:
        interval = mean_statistics(values, None, quantity.low, quantity.high)
        words = quantity.mean_interval(values) if values else NOTHING
    return (
        title(key.controller),
        key.scenario,
        key.shown_setting,
        f'{found.words}: {"median" if aim.is_of_median else "mean"}',
        f'{"≥" if aim.is_lowest else "≤"} {quantity.show(aim.value)}',
        words,
        _verdict(interval, aim),
    )


def _verdict(interval: Mapping[str, float | int | None] | None, aim: Aim) -> str:
    """Say whether an aim is reached, as far as the 95 % interval of a value tells."""
    low, high = (None, None) if interval is None else (interval['ci_low'], interval['ci_high'])
    if low is None:
        return 'too few to tell'
    is_below = high is not None and high <= aim.value
    is_above = low >= aim.value
    if not is_below and not is_above:
        return 'open'
    return 'yes' if is_above == aim.is_lowest else 'no'
