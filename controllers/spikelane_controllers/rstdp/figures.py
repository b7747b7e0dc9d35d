"""The figure of the reward of R-STDP (section 4.2)."""

from __future__ import annotations

from pathlib import Path

from spikelane_controllers.learning.results import Figure
from spikelane_controllers.rstdp.card import TRAINING
from spikelane_controllers.rstdp.controller import RStdpParameters
from spikelane_sim import figure_style as style


def figures() -> tuple[Figure, ...]:
    """Return what a report shows of the controller itself."""
    caption = 'Reward of R-STDP over the distance from the lane centre'
    return (Figure('Task', 'rstdp_reward', caption, _draw),)


def _draw(path: Path, title: str) -> tuple[Path, ...]:
    from spikelane_controllers.learning.rewards_figure import draw_rewards, Reward

    c_r = RStdpParameters().c_r
    rewards = (
        Reward(lambda distance_m: -c_r * distance_m, style.LEFT, 'left neuron'),
        Reward(lambda distance_m: c_r * distance_m, style.RIGHT, 'right neuron'),
    )
    limit_m = TRAINING.defaults['simulator.episode.max_distance_m']
    return draw_rewards(rewards, limit_m, path, f'Reward, {title}', f'linear, c_r = {c_r:g}')
