"""The figure that compares how long controllers trained: to the first lap, and until stable.

As the paper's: bars of means over the seeds, their standard deviation, and a cross where no
training of a group got there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TYPE_CHECKING

from spikelane.figures import style
from spikelane.statistics import mean_statistics

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDTH_IN = 10.6
_PANELS = (
    (0.3, 'first lap completed'),
    (0.655, 'stable: no lane lost after, by\nR-STDP; three full episodes by DQN'),
)
_PANEL = 0.335
_BAR_IN, _AROUND_IN = 0.5, 1.45
_BAR = 0.5  # of a row's height


class TrainingTimes(NamedTuple):
    """Simulated time of the trainings of a group, a value a seed, None where it never was.

    Attributes:
        first_lap: To the end of the first lap [steps of 50 ms].
        stable: Until it drove without losing the lane [steps of 50 ms].
        colour: Of the bars.
    """

    first_lap: Sequence[float | None]
    stable: Sequence[float | None]
    colour: str


def draw_training_time(
    groups: Mapping[str, TrainingTimes], path: Path, title: str = ''
) -> tuple[Path, ...]:
    """Draw the times of groups of trainings, a bar a group.

    Args:
        groups: By what was trained, in words.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The path has another ending, or it cannot be written.
    """
    height_in = _AROUND_IN + _BAR_IN * len(groups)
    with style.settings():
        figure = style.new_figure(_WIDTH_IN, height_in)
        style.write_title(figure, title, 'mean and standard deviation; cross: never')
        for index, (left, words) in enumerate(_PANELS):
            box = (left, 0.55 / height_in, _PANEL, _BAR_IN * len(groups) / height_in)
            axes = figure.add_axes(box)
            axes.set_title(words, fontsize=style.NORMAL_PT, weight='bold')
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


def _draw_bar(axes: Axes, row: int, values: Sequence[float | None], colour: str) -> None:
    found = mean_statistics([value for value in values if value is not None])
    if found is None or found['mean'] is None:
        axes.plot(
            0.02, row, 'X', color=colour, transform=axes.get_yaxis_transform(), clip_on=False
        )
        return
    axes.barh(row, found['mean'], height=_BAR, color=colour, alpha=0.85, linewidth=0)
    if found['std']:
        axes.errorbar(found['mean'], row, xerr=found['std'], color=style.INK, capsize=3)
    share = f'  {found["n"]} of {len(values)}'
    at = found['mean'] + (found['std'] or 0.0)
    axes.text(at, row, share, fontsize=style.SMALL_PT, va='center')
    axes.update_datalim([(1.15 * at, row)])
    axes.autoscale_view(scaley=False)
