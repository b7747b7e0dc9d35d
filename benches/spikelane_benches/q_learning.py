"""Deep Q-learning with Numba against PyTorch, from the same transitions."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.dqn.parameters import QLearningParameters
from spikelane_controllers.dqn.q_learning import QLearning
from spikelane_controllers.dqn.q_network import (
    greedy_action,
    initial_network,
    QNetworkParameters,
)
from spikelane_sim.env import LaneKeepingEnv

_BLOCK = 400  # transitions that one learner takes in before the other one does


class _Transition(NamedTuple):
    """What one action led to."""

    state: NDArray[np.uint8]
    action: int
    reward: float
    next_state: NDArray[np.uint8]
    is_final: bool


def measure_q_learning(actions: int = 8000, seed: int = 0) -> dict[str, Any]:
    """Learn from the same transitions with both, in turn, in one thread.

    The transitions are of random actions of the kinematic robot in scenario 1. The parameters are
    the paper's. The first blocks fill the buffer and are not measured.

    Args:
        actions: Transitions that are measured.
        seed: Seed of the network, of the actions and of what is drawn from the buffer.

    Returns:
        Processor time: `ratio`, of learning with Numba to learning with PyTorch; `numba_us` and
        `torch_us`, learning from a transition, a quarter of an update included [us]; `action_us`,
        a greedy action [us].
    """
    from spikelane_controllers.dqn.torch_q_learning import TorchQLearning

    parameters = QLearningParameters()
    network = initial_network(np.random.default_rng(seed), 512, 3, QNetworkParameters())
    learners = {
        'numba': QLearning(parameters, network),
        'torch': TorchQLearning(parameters, network),
    }
    draws = {name: np.random.default_rng(seed) for name in learners}
    unmeasured = _whole_blocks(parameters.random_steps) + _BLOCK  # compiles, too
    driven = _drive(unmeasured + actions, seed)
    spent_s = dict.fromkeys(learners, 0.0)
    for first in range(0, len(driven), _BLOCK):
        for name, learner in learners.items():
            start_s = time.process_time()
            _learn(learner, driven[first : first + _BLOCK], draws[name])
            if first >= unmeasured:
                spent_s[name] += time.process_time() - start_s
    greedy_action(network, driven[0].state)  # compiles
    start_s = time.process_time()
    for each in driven:
        greedy_action(network, each.state)
    action_s = time.process_time() - start_s
    return {
        'ratio': spent_s['numba'] / spent_s['torch'],
        'numba_us': spent_s['numba'] / actions * 1e6,
        'torch_us': spent_s['torch'] / actions * 1e6,
        'action_us': action_s / len(driven) * 1e6,
    }


def _whole_blocks(transitions: int) -> int:
    return -(-transitions // _BLOCK) * _BLOCK


def _drive(actions: int, seed: int) -> list[_Transition]:
    """Return what random actions led to."""
    rng = np.random.default_rng(seed)
    env = LaneKeepingEnv(1, simulator={'robot.engine': 'kinematic'})
    state = env.reset(seed=seed)[0].ravel()
    driven = []
    for _ in range(actions):
        action = int(rng.integers(3))
        image, reward, is_lost, is_cut, _ = env.step(action)
        driven.append(_Transition(state, action, float(reward), image.ravel(), is_lost))
        state = env.reset()[0].ravel() if is_lost or is_cut else image.ravel()
    env.close()
    return driven


def _learn(learner: QLearning, driven: list[_Transition], rng: np.random.Generator) -> None:
    for state, action, reward, next_state, is_final in driven:
        learner.learn(state, action, reward, next_state, rng, is_final=is_final)
