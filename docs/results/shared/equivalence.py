"""Tests of equivalence: cells of their tables, and their figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any

from matplotlib.axes import Axes

from shared.tables import range_text
from spikelane_sim.figure_style import INK, PALE_INK, RIGHT

#: Names of a test and what `equivalence_statistics` found of the logarithms of ratios.
Tests = Sequence[tuple[str, Mapping[str, Any]]]
EQUIVALENCE_COLUMNS = ('ratio (90 %)', 'margin', 'p', 'equivalent')


def equivalence_cells(found: Mapping[str, Any], margin: float, form: str) -> list[str]:
    """Return the cells of EQUIVALENCE_COLUMNS for a test.

    Args:
        found: What the test found of the logarithms of ratios.
        margin: The largest ratio that makes no odds.
        form: Format of the ratio and its interval.
    """
    ratio, low, high = (math.exp(found[key]) for key in ('mean', 'ci_low', 'ci_high'))
    return [
        range_text(ratio, low, high, form),
        f'{1 / margin:.3f} to {margin:.3f}',
        f'{found["p"]:.1e}',
        'yes' if found['is_equivalent'] else 'not shown',
    ]


def draw_tests(axes: Axes, tests: Tests, ratio: str) -> None:
    """Draw tests of equivalence by name; `ratio` says of what to what."""
    for row, (_, found) in enumerate(reversed(tests)):
        margin = found['margin']
        ends = [found['ci_low'] / margin, found['ci_high'] / margin]
        axes.plot(ends, [row, row], color=INK, linewidth=2)
        axes.plot(found['mean'] / margin, row, 'o', color=INK, markersize=4)
    axes.axvspan(-1, 1, color=RIGHT, alpha=0.12, linewidth=0)
    axes.axvline(0, color=PALE_INK, linewidth=0.8)
    axes.set_yticks(range(len(tests)), [name for name, _ in reversed(tests)], fontsize=7)
    axes.set_xlabel(f'log ratio, {ratio}, as a part of its margin; 90 % intervals')
