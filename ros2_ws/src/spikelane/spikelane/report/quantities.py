"""How the report writes numbers and their spread."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
import math
from typing import NamedTuple

from spikelane.statistics import mean_statistics, time_statistics

#: Stands where there is nothing.
NOTHING = '—'


class Quantity(NamedTuple):
    """What is measured.

    Attributes:
        form: Format of a number.
        unit: Behind it, with a space before; '' for none.
        factor: From the value to the number that is written.
        low: Smallest possible value.
        high: Largest possible value.
    """

    form: str
    unit: str = ''
    factor: float = 1.0
    low: float = 0.0
    high: float = math.inf

    def show(self, value: float) -> str:
        """Write a value."""
        return f'{self._number(value)}{self.unit}'

    def mean(self, values: Sequence[float], units: Sequence[Hashable] | None = None) -> str:
        """Write mean, standard deviation and interval over units, as far as there are units."""
        found = mean_statistics(values, units, self.low, self.high)
        if found is None:
            return 'none'
        mean, std, low, high = (found[name] for name in ('mean', 'std', 'ci_low', 'ci_high'))
        assert mean is not None  # of one value or more
        if std is None or low is None or high is None:
            return self.show(mean)
        number = self._number
        return f'{number(mean)} ± {number(std)}{self.unit} ({number(low)} to {number(high)})'

    def mean_interval(self, values: Sequence[float]) -> str:
        """Write the 95 % interval of the mean of units, where there are enough for one."""
        found = mean_statistics(values, None, self.low, self.high)
        if found is None or found['ci_low'] is None or found['ci_high'] is None:
            return NOTHING
        return f'{self._number(found["ci_low"])} to {self.show(found["ci_high"])}'

    def median(self, values: Sequence[float], reached: Sequence[bool] | None = None) -> str:
        """Write median and range, as far as there are values.

        Args:
            values: One of each unit.
            reached: For times to an event, whether it came; without it all are values. For a time
                at which it had not come the event is later.
        """
        found = time_statistics(values, [True] * len(values) if reached is None else reached)
        if found is None:
            return NOTHING
        if found['median'] is None:
            median = f'over {self.show(max(values))}'
        else:
            median = self.show(found['median'])
        if found['min'] == found['max']:
            return median
        low, high = (
            f'{"" if found[f"{end}_reached"] else "over "}{self._number(found[end])}'
            for end in ('min', 'max')
        )
        return f'{median} ({low} to {high})'

    def median_interval(
        self, values: Sequence[float], reached: Sequence[bool] | None = None
    ) -> str:
        """Write the 95 % interval of the median, where there are enough values for one."""
        found = time_statistics(values, [True] * len(values) if reached is None else reached)
        if found is None or found['ci_low'] is None:
            return NOTHING
        if found['ci_high'] is None:
            return f'from {self.show(found["ci_low"])}'
        return f'{self._number(found["ci_low"])} to {self.show(found["ci_high"])}'

    def _number(self, value: float) -> str:
        return f'{self.factor * value:{self.form}}'


COUNT = Quantity(',.0f')
METRES = Quantity('.4f', ' m')
SIGNED_METRES = Quantity('.4f', ' m', low=-math.inf)
PERCENT = Quantity('.2f', ' %', factor=100.0, high=1.0)
CORRELATION = Quantity('.2f', low=-1.0, high=1.0)
MINUTES = Quantity('.1f', ' min', factor=1 / 60)  # of seconds
RATE = Quantity('.4f')  # the unit is in the column's name
