"""The figure of the rewards over the distance from the lane's centre (sections 3.3 and 4.2)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spikelane_controllers.dqn import card as dqn_card
from spikelane_controllers.learning.results import Figure
from spikelane_controllers.rstdp.card import TRAINING
from spikelane_controllers.rstdp.controller import RStdpParameters
from spikelane_sim import figure_style as style
from spikelane_sim.task import DecisionParameters, lane_centre_reward

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIZE_IN = (10.6, 3.8)
_SHOWN_M = 0.6
_LIMIT = 'simulator.episode.max_distance_m'  # where training resets the robot


def figures() -> tuple[Figure, ...]:
    """Return what a report shows of the controller itself."""
    caption = 'Rewards over the distance from the lane centre'
    return (Figure('Task', 'rewards', caption, lambda path, title: draw_rewards(path, 'Rewards')),)


def draw_rewards(path: Path, title: str = '') -> tuple[Path, ...]:
    """Draw the rewards of the DQN and of R-STDP's two neurons, with their default parameters.

    Args:
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The path has another ending, or it cannot be written.
    """
    distances = np.linspace(-_SHOWN_M, _SHOWN_M, 241)
    sigma_m, c_r = DecisionParameters().reward_sigma_m, RStdpParameters().c_r
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        style.write_title(figure, title, 'dashed: the episode ends')
        dqn = figure.add_axes((0.065, 0.155, 0.42, 0.68))
        rewards = [lane_centre_reward(distance, sigma_m) for distance in distances.tolist()]
        dqn.plot(distances, rewards, color=style.INK)
        dqn.set_ylim(bottom=0)
        _explain(
            dqn, f'DQN: normal density, \u03c3 = {sigma_m:g} m', dqn_card.TRAINING.defaults[_LIMIT]
        )
        plastic = figure.add_axes((0.565, 0.155, 0.42, 0.68))
        plastic.plot(distances, -c_r * distances, color=style.LEFT, label='left neuron')
        plastic.plot(distances, c_r * distances, color=style.RIGHT, label='right neuron')
        plastic.legend(frameon=False, fontsize=style.SMALL_PT, loc='upper center')
        _explain(plastic, f'R-STDP: linear, c_r = {c_r:g}', TRAINING.defaults[_LIMIT])
        return style.save(figure, path)


def _explain(axes: Axes, words: str, limit_m: float) -> None:
    axes.set_title(words, fontsize=style.NORMAL_PT, weight='bold')
    axes.set_xlim(-_SHOWN_M, _SHOWN_M)
    axes.set_xlabel('distance d from the lane centre [m], right positive')
    axes.set_ylabel('reward')
    for limit in (-limit_m, limit_m):
        axes.axvline(limit, color=style.PALE_INK, linestyle=(0, (4, 3)), linewidth=0.9)
