"""Trainings of the deep Q-network with both physical engines and both backends, by turns.

The first one is made observation by observation, the others in the kernel of a fleet.
"""

from __future__ import annotations

import math
from pathlib import Path
import statistics
import tempfile
import time
from typing import Any
import unittest.mock

from spikelane.fleet import Fleet, setting
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import train

#: Parameters of each training; the first one is what the others are compared with.
TRAININGS: dict[str, dict[str, Any]] = {
    'pybullet_torch': {'simulator.robot.engine': 'pybullet', 'dqn.q_learning.backend': 'torch'},
    'pybullet_numba': {'simulator.robot.engine': 'pybullet', 'dqn.q_learning.backend': 'numba'},
    'pybullet_10ms_numba': {
        'simulator.robot.engine': 'pybullet',
        'simulator.robot.pybullet.physics_step_s': 0.01,
        'dqn.q_learning.backend': 'numba',
    },
    'rigid_torch': {'simulator.robot.engine': 'rigid', 'dqn.q_learning.backend': 'torch'},
    'rigid_numba': {'simulator.robot.engine': 'rigid', 'dqn.q_learning.backend': 'numba'},
}
_REFERENCE = next(iter(TRAININGS))
#: Soon over, so that nearly every fourth action is followed by an update.
_RANDOM_STEPS = 100


def measure_dqn_training(actions: int = 1500, repeats: int = 3) -> dict[str, Any]:
    """Train in scenario 1 with the paper's parameters, checkpoints included.

    Args:
        actions: Number of actions of each training.
        repeats: Counted ones; one before them compiles and is not counted.

    Returns:
        Medians of the repeats. `pybullet_torch_us` and so on: processor time of an action, its
        steps and a quarter of an update [µs]. Of the trainings but the first, `rigid_numba` and so
        on: this time by the first one's of the same repeat, and with `_low` and `_high` the
        smallest and largest of the repeats. `rigid_driving_us`: an action without learning.
    """
    found: dict[str, list[float]] = {}
    for repeat in range(repeats + 1):
        values = _measure(actions, repeat)
        if repeat:
            for name, value in values.items():
                found.setdefault(name, []).append(value)
    result = {name: statistics.median(values) for name, values in found.items()}
    for name in TRAININGS.keys() - {_REFERENCE}:
        result |= {f'{name}_low': min(found[name]), f'{name}_high': max(found[name])}
    return result


def _measure(actions: int, seed: int) -> dict[str, float]:
    spent_us: dict[str, float] = {}
    for name, parameters in TRAININGS.items():
        with tempfile.TemporaryDirectory() as folder:
            least_steps = math.inf if name == _REFERENCE else 0
            with unittest.mock.patch.object(setting, 'LEAST_STEPS', least_steps):
                spent_us[name] = _train_us(parameters, actions, seed, folder)
    return {
        **{f'{name}_us': each for name, each in spent_us.items()},
        **{
            name: each / spent_us[_REFERENCE]
            for name, each in spent_us.items()
            if name != _REFERENCE
        },
        'rigid_driving_us': _drive_us(actions, seed),
    }


def _train_us(parameters: dict[str, Any], actions: int, seed: int, folder: str) -> float:
    parameters = {**parameters, 'dqn.q_learning.random_steps': _RANDOM_STEPS}
    config = TrainConfig.make(Request('1', 'dqn', seed, 'inprocess', parameters), actions)
    begin_s = time.process_time()
    train(config, RunFolder(Path(folder)), lambda *_: None, resume=False)
    return (time.process_time() - begin_s) / actions * 1e6


def _drive_us(actions: int, seed: int) -> float:
    """Return the processor time of an action of a policy that does not learn."""
    with Fleet('dqn', [seed], simulator={'robot.engine': 'rigid'}) as fleet:
        steps = fleet.controller(0).parameters.task.steps_per_action
        begin_s = time.process_time()
        fleet.drive(actions * steps)
    return (time.process_time() - begin_s) / actions * 1e6
