"""The axis of the values of one parameter that were tried, logarithmic where they span far.

Zero has no place on a logarithmic axis. It is drawn left of the smallest value, behind a break of
the axis, and has a tick of its own.
"""

from __future__ import annotations

from collections.abc import Iterable
import math
from typing import NamedTuple, TYPE_CHECKING

from spikelane_sim import figure_style as style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LOG_FROM = 20.0  # largest by smallest positive value: then the axis is logarithmic
_BREAK = 0.35  # from zero to the smallest value, as a share of what the others span
_MOST_TICKS = 8
_MARGIN = 0.07  # outside the first and last value, as a share of the distance between them


class ValueAxis(NamedTuple):
    """An axis of values.

    Attributes:
        values: The values that were tried, rising.
        zero_at: Place of zero on a logarithmic axis; None without a break.
        is_log: Whether the axis is logarithmic.
    """

    values: tuple[float, ...]
    zero_at: float | None
    is_log: bool

    @classmethod
    def of(cls, values: Iterable[float]) -> ValueAxis:
        """Choose the axis for some values, at least one."""
        tried = tuple(sorted(set(values)))
        positive = [value for value in tried if value > 0]
        is_log = bool(positive) and tried[0] >= 0 and tried[-1] / positive[0] >= _LOG_FROM
        zero_at = None
        if is_log and tried[0] == 0:
            zero_at = positive[0] * (positive[0] / tried[-1]) ** _BREAK
        return cls(tried, zero_at, is_log)

    def place(self, value: float) -> float:
        """Return where a value is drawn, in units of the axis."""
        return self.zero_at if self.zero_at is not None and value == 0 else value

    def set_up(self, axes: Axes) -> None:
        """Give the x axis of a panel its scale, its limits, ticks at the values and the break."""
        places = [self.place(value) for value in self.values]
        low, high = places[0], places[-1]
        if self.is_log:
            axes.set_xscale('log')
            margin = (high / low) ** _MARGIN
            axes.set_xlim(low / margin, high * margin)
        else:
            edge = _MARGIN * ((high - low) or 1.0)
            axes.set_xlim(low - edge, high + edge)
        every = math.ceil(len(places) / _MOST_TICKS)
        axes.set_xticks(places[::every], [f'{value:g}' for value in self.values[::every]])
        axes.set_xticks([], minor=True)
        if self.zero_at is not None:
            axes.text(
                math.sqrt(self.zero_at * self.values[1]),
                0.0,
                '//',
                transform=axes.get_xaxis_transform(),
                ha='center',
                va='center',
                fontsize=style.SMALL_PT,
                color=style.PALE_INK,
                bbox={'facecolor': 'white', 'edgecolor': 'none', 'pad': 0.5},
            )

    def named(self, name: str) -> str:
        """Return the label of the axis."""
        return f'{name}, log scale' if self.is_log else name
