"""The figure of a controller's rewards over the distance from the lane's centre."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from spikelane_sim import figure_style as style

_SIZE_IN = (5.6, 3.8)
_SHOWN_M = 0.6


class Reward(NamedTuple):
    """A reward.

    Attributes:
        of: Distance right of the lane's centre [m] to reward.
        colour: Colour of the line.
        label: In the legend, '' for none.
    """

    of: Callable[[float], float]
    colour: str = style.INK
    label: str = ''


def draw_rewards(
    rewards: Sequence[Reward], limit_m: float, path: Path, title: str, words: str
) -> tuple[Path, ...]:
    """Draw rewards.

    Args:
        rewards: One or more.
        limit_m: Distance at which a training's episode ends [m].
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.
        words: What the rewards are, above the axes.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The path has another ending, or it cannot be written.
    """
    distances_m = np.linspace(-_SHOWN_M, _SHOWN_M, 241)
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        style.write_title(figure, title, 'dashed: the episode ends')
        axes = figure.add_axes((0.17, 0.155, 0.8, 0.68))
        for reward in rewards:
            values = [reward.of(distance_m) for distance_m in distances_m.tolist()]
            axes.plot(distances_m, values, color=reward.colour, label=reward.label)
        if any(reward.label for reward in rewards):
            axes.legend(frameon=False, fontsize=style.SMALL_PT, loc='upper center')
        axes.set_title(words, fontsize=style.NORMAL_PT, weight='bold')
        axes.set_xlim(-_SHOWN_M, _SHOWN_M)
        axes.set_xlabel('distance d from the lane centre [m], right positive')
        axes.set_ylabel('reward')
        for limit in (-limit_m, limit_m):
            axes.axvline(limit, color=style.PALE_INK, linestyle=(0, (4, 3)), linewidth=0.9)
        return style.save(figure, path)
