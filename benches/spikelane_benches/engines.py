"""What moving the robot costs, engine by engine, without course, camera and controller."""

from __future__ import annotations

import statistics
import time
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.robots import KINEMATIC, make_robot, PYBULLET, RIGID, RobotParameters
from spikelane_sim.robots.description import read_description
from spikelane_sim.robots.registry import robot_model
from spikelane_sim.robots.rigid import drive_step, rigid_body

_KERNEL_STEPS = 200_000
_SUBSTEPS = 10  # of 5 ms in a step


def measure_engines(steps: int = 2000, repeats: int = 5) -> dict[str, Any]:
    """Drive the P3-DX with commands that change in every step, with each engine in turn.

    Args:
        steps: Steps of each repeat.
        repeats: Counted ones; one before them compiles and is not counted.

    Returns:
        Processor time of a step of 50 ms [µs], medians of the repeats: `pybullet_us`, `rigid_us`
        and `kinematic_us` by `Robot.step` from Python, `kernel_us` of the rigid body where
        compiled code calls it. `ratio`: pybullet_us by rigid_us.
    """
    commands = np.random.default_rng(0).uniform(0.5, 2.5, (steps, 2))
    costs: dict[str, list[float]] = {name: [] for name in (PYBULLET, RIGID, KINEMATIC)}
    for repeat in range(repeats + 1):
        for name, found in costs.items():
            cost_us = _cost_us(name, commands)
            if repeat:
                found.append(cost_us)
    result = {f'{name}_us': statistics.median(found) for name, found in costs.items()}
    result['kernel_us'] = _kernel_cost_us(repeats)
    result['ratio'] = result['pybullet_us'] / result['rigid_us']
    return result


def _cost_us(engine: str, commands: NDArray[np.float64]) -> float:
    robot = make_robot(RobotParameters(engine=engine))
    wheels = [WheelVelocities(*pair) for pair in commands.tolist()]
    begin_s = time.process_time()
    for each in wheels:
        robot.step(each)
    cost_s = time.process_time() - begin_s
    robot.close()
    return cost_s / len(wheels) * 1e6


def _kernel_cost_us(repeats: int) -> float:
    parameters = RobotParameters(engine=RIGID)
    body = rigid_body(parameters, read_description(robot_model(parameters.model).urdf))
    commands = np.random.default_rng(0).uniform(0.5, 2.5, (_KERNEL_STEPS, 2))
    state, poses = np.zeros(7), np.empty((1, 7))
    _drive(body, state, commands[:1], poses)
    costs_us = []
    for _ in range(repeats):
        begin_s = time.process_time()
        _drive(body, state, commands, poses)
        costs_us.append((time.process_time() - begin_s) / _KERNEL_STEPS * 1e6)
    return statistics.median(costs_us)


@numba.njit(cache=True)
def _drive(body, state, commands, poses):  # type: ignore[no-untyped-def]
    for row in range(commands.shape[0]):
        drive_step(body, state, commands[row, 0], commands[row, 1], _SUBSTEPS, poses)
