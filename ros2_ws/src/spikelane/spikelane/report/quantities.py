"""How the report writes numbers and their spread."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

from spikelane.statistics import mean_statistics

#: Stands where there is nothing.
NOTHING = '—'


class Quantity(NamedTuple):
    """What is measured.

    Attributes:
        form: Of a number.
        unit: Behind it, with a space before; '' for none.
        factor: From the value to the number that is written.
        low: Smallest possible value: an interval that supposes a normal distribution can go below
            it, and is cut there.
        high: Largest possible value, likewise.
    """

    form: str
    unit: str = ''
    factor: float = 1.0
    low: float = 0.0
    high: float = math.inf

    def show(self, value: float) -> str:
        """Write a value."""
        return f'{self._number(value)}{self.unit}'

    def mean(self, values: Sequence[float]) -> str:
        """Write mean, standard deviation and interval, as far as there are values."""
        found = mean_statistics(values)
        if found is None:
            return 'none'
        mean, std, low, high = (found[name] for name in ('mean', 'std', 'ci_low', 'ci_high'))
        assert mean is not None  # of one value or more
        if std is None or low is None or high is None:
            return self.show(mean)
        number = self._number
        interval = f'{number(max(low, self.low))} to {number(min(high, self.high))}'
        return f'{number(mean)} ± {number(std)}{self.unit} ({interval})'

    def median(self, values: Sequence[float]) -> str:
        """Write median and range, as far as there are values."""
        found = mean_statistics(values)
        if found is None:
            return NOTHING
        median, low, high = (float(found[name] or 0) for name in ('median', 'min', 'max'))
        if low == high:
            return self.show(median)
        return f'{self.show(median)} ({self._number(low)} to {self._number(high)})'

    def _number(self, value: float) -> str:
        return f'{self.factor * value:{self.form}}'


COUNT = Quantity(',.0f')
METRES = Quantity('.4f', ' m')
SIGNED_METRES = Quantity('.4f', ' m', low=-math.inf)
PERCENT = Quantity('.2f', ' %', factor=100.0, high=1.0)
RATE = Quantity('.4f')  # the unit is in the column's name
