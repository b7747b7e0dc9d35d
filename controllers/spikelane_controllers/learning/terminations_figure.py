"""The figure of a training's terminations: where on its lane the robot was, over the steps.

As in the paper's section on R-STDP, with a panel for each lane, its sections as bands, and how
each episode ended.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TYPE_CHECKING

import numpy as np

from spikelane_controllers.learning.settling import has_settled
from spikelane_controllers.learning.training import Termination
from spikelane_sim import figure_style as style
from spikelane_sim.contract import TERMINATED_LANE_LOST, TERMINATED_LAPS_COMPLETE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from spikelane_sim.course import Course, Lane, Section

_SIZE_IN = (10.6, 5.6)
_ROOM = 1.06  # of a lane's length: the axis goes on to where laps end
_BANDS = ('#f1f3f5', '#ffffff')  # behind a lane's sections, in turn
_LEAST_NAMED = 0.05  # of a lane's length: shorter sections get no name
_TURNS = {0: 'straight', 1: 'left', -1: 'right'}


class Episodes(Protocol):
    """A training whose episodes are drawn."""

    @property
    def steps(self) -> int:
        """Steps driven, as the controller's training counts them."""

    @property
    def terminations(self) -> Sequence[Termination]:
        """How each episode ended."""


class _End(NamedTuple):
    """How an episode can end, and how that is drawn."""

    words: str
    marker: str
    colour: str
    size_pt: float


_LOST_RIGHT = _End('lane lost to the right', 'X', style.RIGHT, 8)
_LOST_LEFT = _End('lane lost to the left', 'X', style.LEFT, 8)
_LAP = _End('lap completed', 'o', style.INK, 7)
_OTHER = _End('ended otherwise', 's', style.PALE_INK, 6)
_ENDS = (_LOST_RIGHT, _LOST_LEFT, _LAP, _OTHER)


def draw_terminations(
    training: Episodes, course: Course, path: Path, title: str = ''
) -> tuple[Path, ...]:
    """Draw where on its lane every episode ended, over the step of the training.

    Thin lines lead from where an episode began to where it ended. A position beyond the lane's
    length is one of the next round, so that laps end at the top.

    Args:
        training: The training.
        course: What it drove on.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The course has no such lane, or the path another ending, or it cannot be
            written.
    """
    for each in training.terminations:
        course.lane(each.lane)
    lanes = list(course.lanes.values())
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        style.write_title(figure, title, _terminations_in_words(training))
        all_axes = _lay_out_lanes(figure, len(lanes))
        for axes, lane in zip(all_axes, lanes, strict=True):
            ends = [each for each in training.terminations if each.lane == lane.name]
            _draw_lane(axes, lane, ends, _start_m(course, lane), training.steps)
        all_axes[-1].set_xlabel('step of the training (50 ms each)')
        _explain_ends(figure, training.terminations)
        return style.save(figure, path)


def _terminations_in_words(training: Episodes) -> str:
    lost = [e for e in training.terminations if e.reason == TERMINATED_LANE_LOST]
    laps = [e for e in training.terminations if e.reason == TERMINATED_LAPS_COMPLETE]
    last = f', last at step {lost[-1].step:,}' if lost else ''
    is_open = training.terminations and not has_settled(training.terminations)
    settled = '; not settled' if is_open else ''
    return f'lane lost: {len(lost)}{last}; laps completed: {len(laps)}{settled}'


def _lay_out_lanes(figure: Figure, number: int) -> list[Axes]:
    """Return axes one below the other, level with each other."""
    low, high, gap = 0.155, 0.885, 0.075
    height = (high - low + gap) / number - gap
    all_axes: list[Axes] = []
    for index in range(number):
        bottom = high - height - index * (height + gap)
        first = all_axes[0] if all_axes else None
        axes = figure.add_axes((0.06, bottom, 0.85, height), sharex=first)
        axes.tick_params(labelbottom=index == number - 1)
        all_axes.append(axes)
    return all_axes


def _start_m(course: Course, lane: Lane) -> float:
    """Return the position where robots start."""
    return course.locate(lane.name, *lane.start).position_m


def _draw_lane(
    axes: Axes, lane: Lane, ends: Sequence[Termination], start_m: float, steps: int
) -> None:
    """Draw the ends of one lane's episodes before its sections."""
    axes.set_title(f'{lane.name} lane', fontsize=style.NORMAL_PT, weight='bold', loc='left')
    axes.set_xlim(0, max(steps, 1))
    axes.set_ylim(0, _ROOM * lane.length_m)
    axes.set_ylabel('position p [m]')
    axes.xaxis.set_major_formatter('{x:,.0f}')
    for index, section in enumerate(lane.sections):
        _draw_section(axes, section, lane.length_m, _BANDS[index % 2])
    axes.axhspan(lane.length_m, _ROOM * lane.length_m, color=_BANDS[len(lane.sections) % 2], lw=0)
    for each in ends:
        end_m = _unwrapped_m(each, lane.length_m, start_m)
        axes.plot(
            [each.step - each.episode_steps, each.step],
            [start_m, end_m],
            color=style.PALE_INK,
            linewidth=0.7,
            alpha=0.6,
        )
        end = _end(each)
        axes.plot(
            each.step,
            end_m,
            end.marker,
            color=end.colour,
            markersize=end.size_pt,
            markeredgecolor='white',
            markeredgewidth=0.6,
            clip_on=False,
            zorder=3,
        )


def _draw_section(axes: Axes, section: Section, length_m: float, colour: str) -> None:
    axes.axhspan(section.start_m, section.end_m, color=colour, linewidth=0, zorder=0)
    if section.end_m - section.start_m < _LEAST_NAMED * length_m:
        return
    middle_m = (section.start_m + section.end_m) / 2
    look: dict[str, Any] = {'transform': axes.get_yaxis_transform(), 'va': 'center'}
    axes.text(1.01, middle_m, section.name, weight='bold', **look)
    axes.text(
        1.033,
        middle_m,
        _TURNS[int(np.sign(section.curvature))],
        fontsize=style.SMALL_PT,
        color=style.PALE_INK,
        **look,
    )


def _unwrapped_m(end: Termination, length_m: float, start_m: float) -> float:
    """Return the position counted on beyond the lane's length, from where the episode began."""
    beyond = end.reason == TERMINATED_LAPS_COMPLETE or end.position_m < start_m
    return end.position_m + length_m if beyond else end.position_m


def _end(termination: Termination) -> _End:
    """Return how an episode ended, one of _ENDS."""
    if termination.reason == TERMINATED_LANE_LOST:
        return _LOST_RIGHT if termination.distance_m > 0 else _LOST_LEFT
    return _LAP if termination.reason == TERMINATED_LAPS_COMPLETE else _OTHER


def _explain_ends(figure: Figure, terminations: Sequence[Termination]) -> None:
    from matplotlib.lines import Line2D

    there = {_end(each) for each in terminations}
    style.write_legend(
        figure,
        [
            Line2D(
                [],
                [],
                marker=end.marker,
                color=end.colour,
                markersize=end.size_pt,
                linestyle='',
                label=end.words,
            )
            for end in _ENDS
            if end in there
        ],
    )
