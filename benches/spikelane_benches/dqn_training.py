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

#: Engine and backend of each training; the first one is what the others are compared with.
TRAININGS = (
    ('pybullet', 'torch'),
    ('pybullet', 'numba'),
    ('rigid', 'torch'),
    ('rigid', 'numba'),
)
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
    for engine, backend in TRAININGS[1:]:
        name = f'{engine}_{backend}'
        result |= {f'{name}_low': min(found[name]), f'{name}_high': max(found[name])}
    return result


def _measure(actions: int, seed: int) -> dict[str, float]:
    spent_us: dict[str, float] = {}
    for engine, backend in TRAININGS:
        with tempfile.TemporaryDirectory() as folder:
            least_steps = 0 if spent_us else math.inf
            with unittest.mock.patch.object(setting, 'LEAST_STEPS', least_steps):
                spent_us[f'{engine}_{backend}'] = _train_us(engine, backend, actions, seed, folder)
    reference_us = spent_us['pybullet_torch']
    return {
        **{f'{name}_us': each for name, each in spent_us.items()},
        **{
            name: each / reference_us
            for name, each in spent_us.items()
            if name != 'pybullet_torch'
        },
        'rigid_driving_us': _drive_us(actions, seed),
    }


def _train_us(engine: str, backend: str, actions: int, seed: int, folder: str) -> float:
    parameters = {
        'simulator.robot.engine': engine,
        'dqn.q_learning.backend': backend,
        'dqn.q_learning.random_steps': _RANDOM_STEPS,
    }
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
