"""Tables in Markdown, and the texts in their cells."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from spikelane.statistics import mean_statistics


def table_row(*cells: str) -> str:
    """Return a row of a table."""
    return f'| {" | ".join(cells)} |'


def table_header(*columns: str) -> str:
    """Return the first two lines of a table."""
    return f'{table_row(*columns)}\n{"|---" * len(columns)}|'


def print_row(*cells: str) -> None:
    """Print a row of a table."""
    print(table_row(*cells))


def range_text(middle: float, low: float, high: float, form: str) -> str:
    """Return a value with a range or an interval; `form` is a format as '.4f'."""
    return f'{middle:{form}} ({low:{form}} to {high:{form}})'


def mean_error(laps: pd.DataFrame, unit: str = 'seed') -> dict[str, Any] | None:
    """Describe the mean errors of the laps that were completed.

    Args:
        laps: With columns completed, error_m [m] and that of the units.
        unit: The column of what is independent: trainings by their seed, or courses.

    Returns:
        As `spikelane.statistics.mean_statistics` [m]; None where no lap was completed.
    """
    done = laps[laps['completed'].astype(bool)]
    return mean_statistics(done['error_m'].tolist(), done[unit].tolist(), low=0.0)


def mean_text(found: Mapping[str, Any], form: str = '.4f', scale: float = 1.0) -> str:
    """Return a mean with its interval, where it has one.

    Args:
        found: As `mean_error` returns it.
        form: Format of the numbers.
        scale: What they are multiplied by, as 1000 for millimetres.
    """
    if found['ci_low'] is None:
        return f'{found["mean"] * scale:{form}}'
    mean, low, high = (found[key] * scale for key in ('mean', 'ci_low', 'ci_high'))
    return range_text(mean, low, high, form)


def error_text(laps: pd.DataFrame, unit: str = 'seed') -> str:
    """Return the mean error of the laps that were completed, in metres; see `mean_error`."""
    found = mean_error(laps, unit)
    return 'none' if found is None else f'{mean_text(found)} m'
