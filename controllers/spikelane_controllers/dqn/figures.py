"""The figure of the reward of the deep Q-network (section 3.3)."""

from __future__ import annotations

from pathlib import Path

from spikelane_controllers.dqn.card import TRAINING
from spikelane_controllers.learning.results import Figure
from spikelane_sim.task import DecisionParameters, lane_centre_reward


def figures() -> tuple[Figure, ...]:
    """Return what a report shows of the controller itself."""
    caption = 'Reward of the DQN over the distance from the lane centre'
    return (Figure('Task', 'dqn_reward', caption, _draw),)


def _draw(path: Path, title: str) -> tuple[Path, ...]:
    from spikelane_controllers.learning.rewards_figure import draw_rewards, Reward

    sigma_m = DecisionParameters().reward_sigma_m
    reward = Reward(lambda distance_m: lane_centre_reward(distance_m, sigma_m))
    limit_m = TRAINING.defaults['simulator.episode.max_distance_m']
    words = f'normal density, \u03c3 = {sigma_m:g} m'
    return draw_rewards((reward,), limit_m, path, f'Reward, {title}', words)
