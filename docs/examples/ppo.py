"""Proximal policy optimisation of Stable-Baselines3 learns to keep the lane.

It learns with the kinematic robot, which is quick, and then drives with pybullet's physics:

    pip install '.[learn]' stable-baselines3
    python docs/examples/ppo.py --steps 60000 --out ppo_run
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
from pathlib import Path

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

import spikelane  # noqa: F401  # registers the environment

NAME = 'spikelane/LaneKeeping-v0'
LANES = ('outer', 'inner')


def make(engine: str) -> gymnasium.Env:
    """Make the environment: 512 cells that had events or not, and three actions."""
    env = gymnasium.make(NAME, scenario=1, simulator={'robot.engine': engine})
    return gymnasium.wrappers.FlattenObservation(env)


def learn(steps: int, seed: int) -> PPO:
    """Learn by driving a number of actions in eight environments."""
    environments = make_vec_env(lambda: make('kinematic'), n_envs=8, seed=seed)
    model = PPO(
        'MlpPolicy', environments, n_steps=128, batch_size=256, gamma=0.9, seed=seed, device='cpu'
    )
    return model.learn(steps)


def drive(model: PPO, engine: str, lane: str, seed: int) -> dict[str, float]:
    """Drive one episode of at most 1,000 actions; return how the lane was kept."""
    env = make(engine)
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
    parser.add_argument('--steps', type=int, default=60_000, help='actions to learn from')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--out', type=Path, default=Path('ppo_run'))
    options = parser.parse_args(arguments)
    model = learn(options.steps, options.seed)
    options.out.mkdir(parents=True, exist_ok=True)
    model.save(options.out / 'policy')
    results = {lane: drive(model, 'pybullet', lane, options.seed) for lane in LANES}
    (options.out / 'results.json').write_text(json.dumps(results, indent=2))
    print(json.dumps(results))


if __name__ == '__main__':
    main()
