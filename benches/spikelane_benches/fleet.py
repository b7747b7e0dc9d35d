"""A fleet against the single simulator, and its environments against Gymnasium's SyncVectorEnv."""

from __future__ import annotations

import statistics
import time
from typing import Any

import gymnasium
from gymnasium.vector import SyncVectorEnv, VectorEnv

from spikelane.fleet import Fleet
from spikelane_controllers.registry import make_controller
from spikelane_controllers.rstdp.card import TRAINING
from spikelane_sim.contract import controller_rng
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

_LEARNING = {'learning': True, 'checkpoint': ''}
_VALUES = {
    'robot.engine': 'rigid',
    **{name.removeprefix('simulator.'): value for name, value in TRAINING.defaults.items()},
}
_ENV = 'spikelane/LaneKeeping-v0'
#: Robot-steps in a measurement of a fleet, and in one of the single simulator.
_FLEET_STEPS, _SINGLE_STEPS = 64_000, 4000
_ENVS, _ACTIONS = 64, 20


def measure_fleet(repeats: int = 5) -> dict[str, Any]:
    """Train R-STDP in scenario 1 with the engine rigid, alone and in fleets, by turns.

    Args:
        repeats: Counted ones; one before them compiles and is not counted.

    Returns:
        Medians of the repeats. `single_us`: processor time of a step of a single simulator and
        its controller [µs]; `fleet_us`: the same in a fleet of 64 on one thread; `ratio`:
        single_us by fleet_us of the same repeat. `steps_per_s`: robot-steps per second of wall
        time, 256 robots on two threads; `threads_64` and `threads_256`: how much quicker two
        threads are than one, by wall time. `env_ratio`: how much quicker 64 environments in the
        kernel are than in a SyncVectorEnv, by processor time.
    """
    found: dict[str, list[float]] = {}
    for repeat in range(repeats + 1):
        values = _measure()
        if repeat:
            for name, value in values.items():
                found.setdefault(name, []).append(value)
    return {name: statistics.median(values) for name, values in found.items()}


def _measure() -> dict[str, float]:
    single_us = _single_us()
    fleet_us, wall_64_s = _fleet(64, 1)
    _, wall_64_2_s = _fleet(64, 2)
    _, wall_256_s = _fleet(256, 1)
    _, wall_256_2_s = _fleet(256, 2)
    kernel_s = _env_s(gymnasium.make_vec(_ENV, num_envs=_ENVS, simulator=_VALUES))
    sync_s = _env_s(SyncVectorEnv([lambda: gymnasium.make(_ENV, simulator=_VALUES)] * _ENVS))
    return {
        'single_us': single_us,
        'fleet_us': fleet_us,
        'ratio': single_us / fleet_us,
        'steps_per_s': _FLEET_STEPS / wall_256_2_s,
        'threads_64': wall_64_s / wall_64_2_s,
        'threads_256': wall_256_s / wall_256_2_s,
        'env_ratio': sync_s / kernel_s,
    }


def _single_us() -> float:
    controller: Any = make_controller('rstdp', _LEARNING)
    controller.initialise(controller_rng(0, 0))
    with Simulator(SimulatorParameters.from_mapping(_VALUES, 'simulator')) as simulator:
        observation = simulator.reset(None, 0)
        controller.reset(controller_rng(0, 1))
        begin_s = time.process_time()
        for _ in range(_SINGLE_STEPS):
            wheels = controller.step(observation)
            lane = observation.lane
            assert lane is not None  # a simulator always knows it
            if lane.terminated:
                observation = simulator.reset()
                controller.reset(controller_rng(0, lane.episode + 1))
            else:
                observation = simulator.step(wheels)
        return (time.process_time() - begin_s) / _SINGLE_STEPS * 1e6


def _fleet(robots: int, threads: int) -> tuple[float, float]:
    """Return the processor time of a step [µs], and the wall time of all of them [s]."""
    with Fleet(
        'rstdp', range(robots), simulator=_VALUES, parameters=_LEARNING, threads=threads
    ) as fleet:
        fleet.initialise()
        fleet.drive(1)
        begin_s, wall_s = time.process_time(), time.perf_counter()
        fleet.drive(_FLEET_STEPS // robots)
        cost_s, wall_s = time.process_time() - begin_s, time.perf_counter() - wall_s
    return cost_s / _FLEET_STEPS * 1e6, wall_s


def _env_s(environments: VectorEnv[Any, Any, Any]) -> float:
    """Return the processor time of some actions [s]."""
    environments.reset(seed=0)
    environments.action_space.seed(0)
    actions = [environments.action_space.sample() for _ in range(_ACTIONS)]
    begin_s = time.process_time()
    for each in actions:
        environments.step(each)
    cost_s = time.process_time() - begin_s
    environments.close()
    return cost_s
