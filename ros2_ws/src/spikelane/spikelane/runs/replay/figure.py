"""The figure of a replay: the recorded and new wheel commands, and where the robot was.

From the top: velocity of the left and of the right wheel, as recorded and as replayed, over the
time of the observations; what differs is marked below the curves. At the bottom the deviation d
from the lane's centre, or where nobody knows it, the events of each step.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spikelane_sim import figure_style as style
from spikelane_sim.period import PERIOD_MS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from spikelane.runs.replay.metrics import Answer

Floats = NDArray[np.float64]

_SIZE_IN = (10.6, 6.0)
_NONE = (np.nan, np.nan)


def draw_replay(
    answers: Sequence[Answer], path: Path, title: str = '', period_s: float = PERIOD_MS / 1000
) -> tuple[Path, ...]:
    """Draw a replay.

    Args:
        answers: To all observations, in order.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.
        period_s: Length of a step.

    Returns:
        The files written; none where there are no observations.

    Raises:
        SpikelaneError: The path has another ending, or cannot be written.
    """
    if not answers:
        return ()
    # Counted, not read from the stamps: these may begin again at a reset.
    time_s: Floats = np.arange(len(answers), dtype=np.float64) * period_s
    recorded: Floats = np.array([each.recorded or _NONE for each in answers], np.float64)
    replayed: Floats = np.array([each.replayed or _NONE for each in answers], np.float64)
    differs = np.array([each.is_compared and not each.is_equal for each in answers])
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        panels = figure.subplots(3, 1, sharex=True)
        figure.subplots_adjust(left=0.085, right=0.985, top=0.9, bottom=0.12, hspace=0.14)
        for wheel, name in enumerate(('left', 'right')):
            _draw_wheel(
                panels[wheel], time_s, recorded[:, wheel], replayed[:, wheel], differs, name
            )
        _draw_drive(panels[2], time_s, answers)
        panels[2].set_xlabel(f'time [s], {1000 * period_s:g} ms an observation')
        panels[2].set_xlim(0, max(time_s[-1], period_s))
        style.write_title(figure, title, _in_words(answers))
        style.write_legend(figure, _handles(recorded, differs))
        return style.save(figure, path)


def _draw_wheel(
    axes: Axes, time_s: Floats, recorded: Floats, replayed: Floats, differs: Any, name: str
) -> None:
    axes.plot(time_s, recorded, color=style.RIGHT, linewidth=2.6, alpha=0.45)
    axes.plot(time_s, replayed, color=style.INK, linewidth=0.8)
    axes.plot(
        time_s[differs],
        np.zeros(int(differs.sum())) + 0.03,
        '|',
        color=style.LEFT,
        transform=axes.get_xaxis_transform(),
        markersize=5,
    )
    axes.set_ylabel(f'{name} wheel [rad/s]')


def _draw_drive(axes: Axes, time_s: Floats, answers: Sequence[Answer]) -> None:
    distances = np.array([np.nan if a.lane is None else a.lane.distance_m for a in answers])
    if np.isnan(distances).all():
        events = np.array([each.events for each in answers])
        axes.fill_between(time_s, events, step='post', color=style.ROAD, linewidth=0)
        axes.set_ylabel('events a step')
        axes.set_ylim(bottom=0)
        return
    axes.axhline(0, color=style.PALE_INK, linewidth=0.8)
    axes.plot(time_s, distances, color=style.INK, linewidth=1.0)
    axes.set_ylabel('deviation d [m]')


def _handles(recorded: Floats, differs: Any) -> list[Any]:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=style.INK, linewidth=0.8, label='replayed')]
    if not np.isnan(recorded).all():
        handles.insert(
            0, Line2D([], [], color=style.RIGHT, linewidth=2.6, alpha=0.45, label='recorded')
        )
    if differs.any():
        handles.append(
            Line2D([], [], color=style.LEFT, marker='|', linestyle='', label='they differ')
        )
    return handles


def _in_words(answers: Sequence[Answer]) -> str:
    compared = sum(each.is_compared for each in answers)
    if not compared:
        return f'{len(answers):,} observations, no answers recorded'
    equal = sum(each.is_equal for each in answers)
    return f'{equal:,} of {compared:,} answers agree'
