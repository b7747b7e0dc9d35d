"""The figure that compares how long controllers trained: to the first lap, and until stable.

As in the paper's figure a bar is a group of trainings. Its length is the Kaplan-Meier median over
all of them, the line goes from the first to the last, and an arrow stands at its end where the
last had not got there when its training ended. A cross stands where less than half got there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
import textwrap
from typing import NamedTuple, TYPE_CHECKING

from spikelane.statistics import time_statistics
from spikelane_controllers.learning.results import Time
from spikelane_sim import figure_style as style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDTH_IN = 10.6
_PANELS = (
    (0.3, 'first lap completed'),
    (0.655, 'stable'),
)
_PANEL = 0.335
_BAR_IN, _AROUND_IN = 0.5, 1.45
_LETTERS = 44  # in a line of a panel's title
_BAR = 0.5  # of a row's height


class TrainingTimes(NamedTuple):
    """Simulated times of the trainings of a group, one of each training.

    Attributes:
        first_lap: To the end of the first lap.
        stable: Until it drove without losing the lane.
        colour: Colour of the bars.
    """

    first_lap: Sequence[Time]
    stable: Sequence[Time]
    colour: str


def draw_training_time(
    groups: Mapping[str, TrainingTimes], path: Path, title: str = '', stable: str = ''
) -> tuple[Path, ...]:
    """Draw the times of groups of trainings, a bar a group.

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
    with style.settings():
        figure = style.new_figure(_WIDTH_IN, height_in)
        words = 'bar: median; line: range; arrow: the last not by its end; cross: most never'
        style.write_title(figure, title, words)
        for index, (left, heading) in enumerate(_PANELS):
            box = (left, 0.55 / height_in, _PANEL, _BAR_IN * len(groups) / height_in)
            axes = figure.add_axes(box)
            if index and stable:
                heading = '\n'.join(textwrap.wrap(f'{heading}: {stable}', _LETTERS))
            axes.set_title(heading, fontsize=style.NORMAL_PT, weight='bold')
            for row, times in enumerate(groups.values()):
                _draw_bar(axes, row, times[index], times.colour)  # type: ignore[arg-type]
            axes.set_ylim(len(groups) - 0.5, -0.5)
            axes.set_xlim(left=0)
            axes.locator_params(axis='x', nbins=4)
            axes.xaxis.set_major_formatter('{x:,.0f}')
            axes.set_xlabel('steps of 50 ms')
            axes.set_yticks(range(len(groups)), list(groups) if index == 0 else [''] * len(groups))
            axes.tick_params(axis='y', labelsize=style.SMALL_PT)
        return style.save(figure, path)


def _draw_bar(axes: Axes, row: int, times: Sequence[Time], colour: str) -> None:
    found = time_statistics([each.step for each in times], [each.reached for each in times])
    if found is None or found['median'] is None:
        axes.plot(
            0.02, row, 'X', color=colour, transform=axes.get_yaxis_transform(), clip_on=False
        )
        return
    axes.barh(row, found['median'], height=_BAR, color=colour, alpha=0.85, linewidth=0)
    if len(times) > 1:
        axes.plot([found['min'], found['max']], [row, row], color=style.INK, linewidth=1.2)
        ends = ((found['min'], '|'), (found['max'], '|' if found['max_reached'] else '>'))
        for end, marker in ends:
            axes.plot(end, row, marker, color=style.INK, markersize=6)
    share = f'   {found["reached"]} of {found["n"]}'
    at = max(found['max'], found['median'])
    axes.text(at, row, share, fontsize=style.SMALL_PT, va='center')
    axes.update_datalim([(1.2 * at, row)])
    axes.autoscale_view(scaley=False)
