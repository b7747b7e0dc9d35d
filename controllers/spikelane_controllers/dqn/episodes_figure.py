"""The figure of a deep Q-network's training: action steps and reward of each episode.

As in the paper's section on DQN training, over the number of the episode, with the running mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.dqn.training import Outcome
from spikelane_controllers.learning.terminations_figure import Episodes
from spikelane_sim import figure_style as style
from spikelane_sim.contract import TERMINATED_LANE_LOST

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIZE_IN = (10.6, 5.0)
_PANELS = ((0.075, 'action steps'), (0.57, 'sum of rewards'))
_WIDTH = 0.415
_LANE_COLOURS = (style.RIGHT, style.LEFT)
_MOST_POINTS = 2000  # episodes up to which each gets a point
_AVERAGED = 20  # episodes of the running mean


class Outcomes(Episodes, Protocol):
    """A training of a deep Q-network whose episodes are drawn."""

    @property
    def outcomes(self) -> Sequence[Outcome]:
        """What each episode brought."""


def draw_episodes(
    training: Outcomes, lanes: tuple[str, ...], action_step: str, path: Path, title: str = ''
) -> tuple[Path, ...]:
    """Draw action steps and sum of rewards of each episode.

    Args:
        training: The training.
        lanes: Names of the course's lanes.
        action_step: How long one action step is, in words.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The path has another ending, or it cannot be written.
    """
    values: tuple[list[float], ...] = (
        [each.actions for each in training.outcomes],
        [each.reward for each in training.outcomes],
    )
    driven = [each.lane for each in training.terminations]
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        style.write_title(figure, title, _in_words(training, action_step))
        for (left, name), heights in zip(_PANELS, values, strict=True):
            axes = figure.add_axes((left, 0.19, _WIDTH, 0.68))
            _draw(axes, heights, driven, lanes)
            axes.set_ylabel(f'{name} of the episode')
        _explain(figure, lanes)
        return style.save(figure, path)


def _in_words(training: Outcomes, action_step: str) -> str:
    lost = sum(each.reason == TERMINATED_LANE_LOST for each in training.terminations)
    return f'{training.steps:,} action steps of {action_step}; lane lost: {lost:,}'


def _running_mean(heights: Sequence[float]) -> NDArray[np.float64]:
    """Return the mean of each value and those before it, over _AVERAGED values at most."""
    sums = np.cumsum([0.0, *heights])
    ends = np.arange(1, len(heights) + 1)
    begins = np.maximum(ends - _AVERAGED, 0)
    means: NDArray[np.float64] = (sums[ends] - sums[begins]) / (ends - begins)
    return means


def _draw(axes: Axes, heights: list[float], driven: list[str], lanes: tuple[str, ...]) -> None:
    """Draw the values over the episodes, points in the lanes' colours, and their running mean."""
    episodes = range(1, len(heights) + 1)
    axes.plot(episodes, heights, color=style.ROAD, linewidth=0.8)
    if len(heights) <= _MOST_POINTS:
        for lane, colour in zip(lanes, _LANE_COLOURS, strict=False):
            numbers = [index for index, name in enumerate(driven) if name == lane]
            axes.plot(
                [number + 1 for number in numbers],
                [heights[number] for number in numbers],
                '.',
                color=colour,
                markersize=4,
            )
    axes.plot(episodes, _running_mean(heights), color=style.INK, linewidth=1.6)
    axes.set_xlim(0, max(len(heights), 1) + 1)
    axes.set_ylim(bottom=0)
    axes.xaxis.set_major_formatter('{x:,.0f}')
    axes.yaxis.set_major_formatter('{x:,.0f}')
    axes.set_xlabel('episode')


def _explain(figure: Figure, lanes: tuple[str, ...]) -> None:
    from matplotlib.lines import Line2D

    mean = f'mean of the last {_AVERAGED} episodes'
    style.write_legend(
        figure,
        [
            *(
                Line2D([], [], marker='.', linestyle='', color=colour, label=f'{lane} lane')
                for lane, colour in zip(lanes, _LANE_COLOURS, strict=False)
            ),
            Line2D([], [], color=style.INK, linewidth=1.6, label=mean),
        ],
    )
