"""Our deep Q-learning against Stable-Baselines3's: same environment, same hyper-parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import importlib.util
import time
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from spikelane_benches.unavailable import BenchmarkUnavailableError
from spikelane_controllers.dqn.parameters import QLearningParameters
from spikelane_controllers.dqn.q_network import (
    greedy_action,
    initial_network,
    QNetworkParameters,
)
from spikelane_sim.env import LaneKeepingEnv

STABLE_BASELINES3_VERSION = '2.9.2'

#: The paper's, but that exploration falls soon enough for so short a training to show something.
PARAMETERS = QLearningParameters(annealing_steps=9000)

_Image = NDArray[np.uint8]
Policy = Callable[[_Image], int]


class _Learnt(NamedTuple):
    """What came of a training."""

    outside_s: float  # processor time outside the environment
    inside_s: float
    policy: Policy


def measure_dqn(steps: int = 20_000, seed: int = 0) -> dict[str, Any]:
    """Learn scenario 1 with the kinematic robot, here and in Stable-Baselines3, in one thread.

    Stable-Baselines3's targets are those of plain Q-learning and its loss is Huber's: it has no
    others, and computes less for an update than double Q-learning does.

    Args:
        steps: Action steps.
        seed: Seed of both.

    Returns:
        `ratio`, our processor time outside the environment over theirs; both times for an action
        [us], `ours_us` and `theirs_us`, and that of the environment, `environment_us`; and the
        sum of rewards of the greedy policies in an episode, `ours_outer`, `theirs_outer`,
        `ours_inner` and `theirs_inner`.

    Raises:
        BenchmarkUnavailableError: Stable-Baselines3 is not installed.
    """
    if importlib.util.find_spec('stable_baselines3') is None:
        raise BenchmarkUnavailableError(
            f'expected Stable-Baselines3 to compare with, it is missing: pip install '
            f'stable-baselines3=={STABLE_BASELINES3_VERSION}'
        )
    learnt = {'ours': _learn_here(steps, seed), 'theirs': _learn_there(steps, seed)}
    ours, theirs = learnt['ours'], learnt['theirs']
    return {
        'ratio': ours.outside_s / theirs.outside_s,
        'ours_us': ours.outside_s / steps * 1e6,
        'theirs_us': theirs.outside_s / steps * 1e6,
        'environment_us': ours.inside_s / steps * 1e6,
        **{
            f'{name}_{lane}': _episode_reward(result.policy, lane)
            for lane in ('outer', 'inner')
            for name, result in learnt.items()
        },
    }


class _Stopwatch(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Adds up the processor time that the environment takes."""

    def __init__(self) -> None:
        super().__init__(LaneKeepingEnv(1, simulator={'robot.engine': 'kinematic'}))
        self.inside_s = 0.0

    def reset(self, **options: Any) -> Any:
        """Reset the environment."""
        start_s = time.process_time()
        result = self.env.reset(**options)
        self.inside_s += time.process_time() - start_s
        return result

    def step(self, action: Any) -> Any:
        """Take a step of the environment."""
        start_s = time.process_time()
        result = self.env.step(action)
        self.inside_s += time.process_time() - start_s
        return result


def _timed(learn: Callable[[_Stopwatch], Policy]) -> _Learnt:
    env = _Stopwatch()
    env.reset(seed=0)
    env.step(1)  # compiles
    env.inside_s = 0.0
    start_s = time.process_time()
    policy = learn(env)
    total_s = time.process_time() - start_s
    env.close()
    return _Learnt(total_s - env.inside_s, env.inside_s, policy)


def _learn_here(steps: int, seed: int) -> _Learnt:
    from spikelane_controllers.dqn.torch_q_learning import TorchQLearning

    rng = np.random.default_rng(seed)
    network = initial_network(rng, 512, 3, QNetworkParameters())
    _compile()

    def learn(env: _Stopwatch) -> Policy:
        learner = TorchQLearning(PARAMETERS, network)
        state = env.reset(seed=seed)[0].ravel()
        for _ in range(steps):
            action = learner.act(state, rng)
            image, reward, is_lost, is_cut, _ = env.step(action)
            before, state = state, image.ravel()
            learner.learn(before, action, reward, state, rng, is_final=is_lost)
            if is_lost or is_cut:
                state = env.reset()[0].ravel()
        return lambda image: greedy_action(learner.network, image.ravel())

    return _timed(learn)


def _compile() -> None:
    """Act and learn once, so that no compilation is timed."""
    from spikelane_controllers.dqn.torch_q_learning import TorchQLearning

    rng = np.random.default_rng(0)
    network = initial_network(rng, 512, 3, QNetworkParameters())
    state = np.zeros(512, np.uint8)
    greedy_action(network, state)
    learner = TorchQLearning(replace(PARAMETERS, random_steps=PARAMETERS.batch_size), network)
    for _ in range(PARAMETERS.batch_size + PARAMETERS.update_every):
        learner.act(state, rng)
        learner.learn(state, 0, 0.0, state, rng, is_final=False)


def _learn_there(steps: int, seed: int) -> _Learnt:
    from stable_baselines3 import DQN
    import torch

    torch.set_num_threads(1)
    falls = PARAMETERS.random_steps + PARAMETERS.annealing_steps

    def learn(env: _Stopwatch) -> Policy:
        model = DQN(
            'MlpPolicy',
            env,
            learning_rate=PARAMETERS.learning_rate,
            buffer_size=PARAMETERS.buffer_size,
            learning_starts=PARAMETERS.random_steps,
            batch_size=PARAMETERS.batch_size,
            tau=PARAMETERS.soft_update,
            gamma=PARAMETERS.discount,
            train_freq=PARAMETERS.update_every,
            target_update_interval=PARAMETERS.update_every,
            exploration_fraction=falls / steps,
            exploration_final_eps=PARAMETERS.exploration_end,
            policy_kwargs={'net_arch': [200, 200]},
            device='cpu',
            seed=seed,
        )
        model.learn(steps)
        return lambda image: int(model.predict(image, deterministic=True)[0])

    return _timed(learn)


def _episode_reward(policy: Policy, lane: str) -> float:
    """Return the sum of rewards of one episode."""
    env = LaneKeepingEnv(1, simulator={'robot.engine': 'kinematic'})
    state, _ = env.reset(seed=0, options={'lane': lane})
    total, is_over = 0.0, False
    while not is_over:
        state, reward, is_lost, is_cut, _ = env.step(policy(state.astype(np.uint8)))
        total, is_over = total + reward, is_lost or is_cut
    env.close()
    return total
