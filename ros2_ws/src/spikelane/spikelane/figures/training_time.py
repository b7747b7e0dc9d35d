"""The figure that compares how long controllers trained: to the first lap, and until stable.

A row is a group of trainings, on a logarithmic axis: one controller can learn a hundred times as
fast as another. A dot is the Kaplan-Meier median over all of them, the line goes from the first to
the last, and an arrow stands at its end where the last had not got there when its training ended.
Where less than half got there, a cross stands at the end of the longest training.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from pathlib import Path
import textwrap
from typing import NamedTuple, TYPE_CHECKING

from spikelane.statistics import time_statistics
from spikelane_controllers.learning.results import Time
from spikelane_sim import figure_style as style
from spikelane_sim.figure_values import tell_values, Value

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDTH_IN = 10.6
_PANELS = (
    (0.3, 'first lap completed'),
    (0.66, 'stable'),
)
_PANEL = 0.31
_BAR_IN, _AROUND_IN = 0.5, 1.45
_LETTERS = 44  # in a line of a panel's title
_LOWEST = 100.0  # steps at which the axis begins at the latest


class TrainingTimes(NamedTuple):
    """Simulated times of the trainings of a group, one of each training.

    Attributes:
        first_lap: To the end of the first lap.
        stable: Until it drove stably.
        colour: Colour of its marks.
    """

    first_lap: Sequence[Time]
    stable: Sequence[Time]
    colour: str


def draw_training_time(
    groups: Mapping[str, TrainingTimes], path: Path, title: str = '', stable: str = ''
) -> tuple[Path, ...]:
    """Draw the times of groups of trainings, a row a group.

    Args:
        groups: By what was trained, in words.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.
        stable: What driving stably means, in words.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The path has another ending, or it cannot be written.
    """
    height_in = _AROUND_IN + _BAR_IN * len(groups)
    low, high = _limits(groups)
    with style.settings():
        figure = style.new_figure(_WIDTH_IN, height_in)
        style.write_title(figure, title, _in_words(groups))
        for index, (left, heading) in enumerate(_PANELS):
            box = (left, 0.55 / height_in, _PANEL, _BAR_IN * len(groups) / height_in)
            axes = figure.add_axes(box)
            if index and stable:
                heading = '\n'.join(textwrap.wrap(f'{heading}: {stable}', _LETTERS))
            axes.set_title(heading, fontsize=style.NORMAL_PT, weight='bold')
            axes.set_xscale('log')
            axes.set_xlim(low, high)
            axes.set_ylim(len(groups) - 0.5, -0.5)
            for row, (name, times) in enumerate(groups.items()):
                _draw_row(axes, row, name, times[index], times.colour)  # type: ignore[arg-type]
            axes.xaxis.set_major_formatter('{x:,.0f}')
            axes.set_xlabel('simulated steps of 50 ms, log scale')
            axes.set_yticks(range(len(groups)), list(groups) if index == 0 else [''] * len(groups))
            axes.tick_params(axis='y', labelsize=style.SMALL_PT)
        return style.save(figure, path)


def _limits(groups: Mapping[str, TrainingTimes]) -> tuple[float, float]:
    """Return powers of ten around all times, with room for words behind the last."""
    steps = [each.step for group in groups.values() for each in (*group.first_lap, *group.stable)]
    low = min([_LOWEST, *(step for step in steps if step > 0)])
    high = max([10 * _LOWEST, *steps])
    return 10.0 ** math.floor(math.log10(low)), 10.0 ** math.ceil(math.log10(6 * high))


def _in_words(groups: Mapping[str, TrainingTimes]) -> str:
    """Explain the marks that occur."""
    found = [
        time_statistics([each.step for each in times], [each.reached for each in times])
        for group in groups.values()
        for times in (group.first_lap, group.stable)
    ]
    marks = {'dot: median; line: range': True}
    marks['arrow: the last had not got there'] = any(
        each and each['median'] is not None and not each['max_reached'] for each in found
    )
    marks['cross: less than half got there'] = any(
        each is None or each['median'] is None for each in found
    )
    return '; '.join(words for words, occurs in marks.items() if occurs)


def _draw_row(axes: Axes, row: int, name: str, times: Sequence[Time], colour: str) -> None:
    found = time_statistics([each.step for each in times], [each.reached for each in times])
    if found is None:
        return
    low, _ = axes.get_xlim()
    first, last = (max(found[end], low) for end in ('min', 'max'))
    axes.plot([first, last], [row, row], color=style.INK, linewidth=1.2)
    share = f'{found["reached"]} of {found["n"]}'
    if found['median'] is None:
        axes.plot(last, row, 'X', color=colour, markersize=8)
        told = 'not by'
        at = found['max']
    else:
        if len(times) > 1:
            for end, marker in ((first, '|'), (last, '|' if found['max_reached'] else '>')):
                axes.plot(end, row, marker, color=style.INK, markersize=6)
        at = found['median']
        axes.plot(max(at, low), row, 'o', color=colour, markersize=9)
        told = 'median'
    label = name.partition('\n')[0]
    ends = f'{found["min"]:,.0f} to {found["max"]:,.0f}'
    text = f'{label}: {told} {at:,.0f} steps ({ends}), {share}'
    tell_values(axes, [Value(text, axes.get_xlim(), (row - 0.5, row + 0.5))])
    axes.annotate(
        share,
        (last, row),
        (9, 0),
        textcoords='offset points',
        fontsize=style.SMALL_PT,
        va='center',
    )
