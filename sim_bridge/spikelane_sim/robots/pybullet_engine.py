"""The engine `pybullet`: rigid-body physics, with a drive of limited torque and friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from spikelane_sim.contract import Robot
from spikelane_sim.engine import Engine
from spikelane_sim.parameters import parameter, Parameters

if TYPE_CHECKING:
    from spikelane_sim.robots import RobotParameters


@dataclass(frozen=True, kw_only=True)
class PybulletParameters(Parameters):
    """How the physics is computed."""

    wheel_friction: float = parameter(
        0.8, 'Friction of the wheels on the floor', low=0.0, high=10.0
    )
    physics_step_s: float = parameter(
        0.005,
        'Step of the physics, a whole fraction of 0.05 s',
        unit='s',
        low=0.0005,
        high=0.05,
        source="paper's simulation",
    )
    solver_iterations: int = parameter(
        50,
        'Most iterations of the contact solver, which stops when it has converged',
        low=1,
        high=1000,
    )


def _make(parameters: RobotParameters, poses_per_step: int) -> Robot:
    # Pybullet is loaded only where it is used.
    from spikelane_sim.robots.bullet_drive import BulletDrive

    return BulletDrive(parameters, poses_per_step)


ENGINE = Engine(_make, PybulletParameters)
