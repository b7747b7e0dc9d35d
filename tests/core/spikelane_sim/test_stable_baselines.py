"""Stable-Baselines3 on environments in one kernel: as on its own vector of single ones."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from spikelane_sim.errors import ParameterError
from spikelane_sim.stable_baselines import VectorEnvAdapter

NAME = 'spikelane/LaneKeeping-v0'
#: Episodes that are cut short, or end at once where the robot turns.
ARGUMENTS: dict[str, Any] = {
    'simulator': {'robot.engine': 'kinematic', 'episode.max_distance_m': 0.03},
    'task': {'max_actions': 12},
}


def make(num_envs: int) -> VectorEnvAdapter:
    """Make environments in one kernel."""
    return VectorEnvAdapter(
        gymnasium.make_vec(
            NAME,
            num_envs=num_envs,
            vectorization_mode='vector_entry_point',
            autoreset_mode='SameStep',
            **ARGUMENTS,
        )
    )


def make_singles(num_envs: int) -> DummyVecEnv:
    """Make single environments, one after the other."""
    return DummyVecEnv([lambda: gymnasium.make(NAME, **ARGUMENTS)] * num_envs)


def test_steps_are_those_of_single_environments() -> None:
    """Observations, rewards, ends, terminal observations and truncation."""
    mine, singles = make(3), make_singles(3)
    rng = np.random.default_rng(0)
    for each in (mine, singles):
        each.seed(5)
    assert np.array_equal(mine.reset(), singles.reset())
    ends = 0
    for _ in range(60):
        actions = rng.integers(0, 3, 3)
        actions[0] = 1  # straight on, until the episode is cut short
        seen, expected = mine.step(actions), singles.step(actions)
        for one, other in zip(seen[:3], expected[:3], strict=True):
            assert np.array_equal(one, other)
        for one, other in zip(seen[3], expected[3], strict=True):
            assert one['TimeLimit.truncated'] == other['TimeLimit.truncated']
            assert ('terminal_observation' in one) == ('terminal_observation' in other)
            if 'terminal_observation' in one:
                ends += 1 if one['TimeLimit.truncated'] else 100
                assert np.array_equal(one['terminal_observation'], other['terminal_observation'])
                assert one['lane_state'] == other['lane_state']
    assert ends > 100  # of both kinds
    assert ends % 100 > 0


def test_ppo_learns_the_same_as_on_single_environments() -> None:
    """The same weights after the same steps."""
    learnt = []
    for environments in (make(2), make_singles(2)):
        model = PPO('MlpPolicy', VecMonitor(environments), n_steps=32, seed=1, device='cpu')
        model.learn(128)
        learnt.append(model.policy.state_dict())
    assert all(bool((learnt[0][name] == learnt[1][name]).all()) for name in learnt[0])


def test_dqn_learns_on_it() -> None:
    """It fills its memory from all environments."""
    model = DQN('MlpPolicy', make(4), learning_starts=20, seed=1, device='cpu', buffer_size=400)
    model.learn(80)
    assert model.replay_buffer is not None
    assert model.replay_buffer.pos == 20
    assert model.num_timesteps == 80


def test_what_differs_is_refused() -> None:
    """Resets at another time, options of single environments, and their attributes."""
    later = gymnasium.make_vec(NAME, num_envs=2, **ARGUMENTS)
    with pytest.raises(ParameterError, match='autoreset_mode: expected SameStep, as'):
        VectorEnvAdapter(later)
    later.close()
    mine = make(2)
    mine.set_options([{'lane': 'inner'}, {'lane': 'outer'}])
    with pytest.raises(ParameterError, match='options: expected the same for all environments'):
        mine.reset()
    with pytest.raises(ParameterError, match='speed: expected single environments'):
        mine.set_attr('speed', 1)
    with pytest.raises(ParameterError, match='jump: expected single environments'):
        mine.env_method('jump')
    mine.close()
