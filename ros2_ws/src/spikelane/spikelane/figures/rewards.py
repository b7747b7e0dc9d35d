"""The figure of the rewards over the distance from the lane's centre (sections 3.3 and 4.2)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spikelane.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIZE_IN = (10.6, 3.8)
_SHOWN_M = 0.6
_DQN_LIMIT_M = 0.5  # where training ends an episode, TRAINING_DEFAULTS
_RSTDP_LIMIT_M = 0.2


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
    from spikelane_controllers.rstdp import RStdpParameters
    from spikelane_sim.task import DecisionParameters, lane_centre_reward

    distances = np.linspace(-_SHOWN_M, _SHOWN_M, 241)
    sigma_m, c_r = DecisionParameters().reward_sigma_m, RStdpParameters().c_r
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        style.write_title(figure, title, 'dashed: the episode ends')
        dqn = figure.add_axes((0.065, 0.155, 0.42, 0.68))
        rewards = [lane_centre_reward(distance, sigma_m) for distance in distances.tolist()]
        dqn.plot(distances, rewards, color=style.INK)
        dqn.set_ylim(bottom=0)
        _explain(dqn, f'DQN: normal density, \u03c3 = {sigma_m:g} m', _DQN_LIMIT_M)
        plastic = figure.add_axes((0.565, 0.155, 0.42, 0.68))
        plastic.plot(distances, -c_r * distances, color=style.LEFT, label='left neuron')
        plastic.plot(distances, c_r * distances, color=style.RIGHT, label='right neuron')
        plastic.legend(frameon=False, fontsize=style.SMALL_PT, loc='upper center')
        _explain(plastic, f'R-STDP: linear, c_r = {c_r:g}', _RSTDP_LIMIT_M)
        return style.save(figure, path)


def _explain(axes: Axes, words: str, limit_m: float) -> None:
    axes.set_title(words, fontsize=style.NORMAL_PT, weight='bold')
    axes.set_xlim(-_SHOWN_M, _SHOWN_M)
    axes.set_xlabel('distance d from the lane centre [m], right positive')
    axes.set_ylabel('reward')
    for limit in (-limit_m, limit_m):
        axes.axvline(limit, color=style.PALE_INK, linestyle=(0, (4, 3)), linewidth=0.9)
