"""PPO or DQN of Stable-Baselines3 learns to keep the lane, in many environments at once.

It learns with the kinematic robot, which one compiled kernel drives in 64 environments, and then
drives with pybullet's physics:

    pip install '.[sb3]'
    python docs/examples/stable_baselines.py ppo --out ppo_run
    python docs/examples/stable_baselines.py dqn --out dqn_run
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
from pathlib import Path

import gymnasium
import numpy as np
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.base_class import BaseAlgorithm

import spikelane  # noqa: F401  # registers the environment
from spikelane_sim.stable_baselines import VectorEnvAdapter

NAME = 'spikelane/LaneKeeping-v0'
LANES = ('outer', 'inner')


def make_environments(number: int) -> VectorEnvAdapter:
    """Make environments in one kernel: 512 cells that had events or not, and three actions."""
    return VectorEnvAdapter(
        gymnasium.make_vec(
            NAME,
            num_envs=number,
            vectorization_mode='vector_entry_point',
            autoreset_mode='SameStep',
            scenario=1,
            simulator={'robot.engine': 'kinematic'},
        )
    )


def make_ppo(environments: VectorEnvAdapter, seed: int) -> PPO:
    """Make proximal policy optimisation that learns after every 16 actions of each environment."""
    return PPO(
        'MlpPolicy',
        environments,
        n_steps=16,
        batch_size=256,
        gamma=0.9,
        seed=seed,
        device='cpu',
    )


def make_dqn(environments: VectorEnvAdapter, seed: int) -> DQN:
    """Make deep Q-learning that, as in the paper, updates once for every four actions."""
    return DQN(
        'MlpPolicy',
        environments,
        learning_rate=1e-4,
        buffer_size=20_000,
        learning_starts=1000,
        gamma=0.9,
        tau=0.001,
        target_update_interval=1,
        train_freq=1,
        gradient_steps=environments.num_envs // 4,
        exploration_fraction=0.5,
        policy_kwargs={'net_arch': [200, 200]},
        seed=seed,
        device='cpu',
    )


MAKE = {'ppo': make_ppo, 'dqn': make_dqn}


def drive(model: BaseAlgorithm, engine: str, lane: str, seed: int) -> dict[str, float]:
    """Drive one episode of at most 1,000 actions; return how the lane was kept."""
    env = gymnasium.make(NAME, scenario=1, simulator={'robot.engine': engine})
    observation, info = env.reset(seed=seed, options={'lane': lane})
    distances_m, is_over = [], False
    while not is_over:
        action, _ = model.predict(observation, deterministic=True)
        observation, _, is_terminated, is_truncated, info = env.step(int(action))
        distances_m.append(info['lane_state'].distance_m)
        is_over = is_terminated or is_truncated
    env.close()
    return {
        'actions': len(distances_m),
        'progress_m': info['lane_state'].progress_m,
        'mean_distance_m': float(np.abs(distances_m).mean()),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Learn, drive both lanes with pybullet, and write what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('algorithm', choices=MAKE)
    parser.add_argument('--steps', type=int, default=60_000, help='actions to learn from')
    parser.add_argument('--environments', type=int, default=64)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--out', type=Path, default=Path('stable_baselines_run'))
    options = parser.parse_args(arguments)
    environments = make_environments(options.environments)
    model = MAKE[options.algorithm](environments, options.seed).learn(options.steps)
    environments.close()
    options.out.mkdir(parents=True, exist_ok=True)
    model.save(options.out / 'policy')
    results = {lane: drive(model, 'pybullet', lane, options.seed) for lane in LANES}
    (options.out / 'results.json').write_text(json.dumps(results, indent=2))
    print(json.dumps(results))


if __name__ == '__main__':
    main()
