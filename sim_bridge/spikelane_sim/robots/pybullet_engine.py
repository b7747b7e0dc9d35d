"""The engine `pybullet`: rigid-body physics, with a drive of limited torque and friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from spikelane_sim.contract import Robot
from spikelane_sim.engine import Engine
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import parameter, Parameters

if TYPE_CHECKING:
    from spikelane_sim.robots import RobotParameters


@dataclass(frozen=True, kw_only=True)
class PybulletParameters(Parameters):
    """How the physics is computed."""

    wheel_friction: float = parameter(
        0.8, 'Friction coefficient of the wheels on the floor.', low=0.0, high=10.0
    )
    physics_step_s: float = parameter(
        0.005,
        'Time step of the physics, which must divide the control period.',
        unit='s',
        low=0.0005,
        high=0.05,
        source="paper's simulation",
    )
    solver_iterations: int = parameter(
        50,
        'Largest number of iterations of the contact solver, which stops when it has converged.',
        low=1,
        high=1000,
    )

    def steps_per_pose(self, poses_per_step: int, period_s: float) -> int:
        """Return how many steps of the physics lie between two poses.

        Args:
            poses_per_step: How many poses a step has.
            period_s: Length of a step.

        Raises:
            ParameterError: They do not divide each other.
        """
        steps = round(period_s / self.physics_step_s)
        if steps < 1 or abs(steps * self.physics_step_s - period_s) > 1e-12:
            raise self._no_fraction(period_s)
        if poses_per_step < 1 or steps % poses_per_step:
            raise ParameterError(
                f'pixels.esim.substeps: expected a divisor of {steps}, the steps of the physics '
                f'in {period_s} s, got {poses_per_step}'
            )
        substeps = steps // poses_per_step
        interval_s = period_s / poses_per_step
        # stepSimulation counts its sub-steps like this; some numbers (11, 19) it miscounts.
        count = int(interval_s / (interval_s / substeps))
        if count != substeps or interval_s - count * (interval_s / substeps) != 0.0:
            raise self._no_fraction(period_s)
        return substeps

    def _no_fraction(self, period_s: float) -> ParameterError:
        return ParameterError(
            f'physics_step_s: expected a whole fraction of {period_s} s like 0.005 or 0.001, '
            f'got {self.physics_step_s}'
        )


def _make(parameters: RobotParameters, poses_per_step: int, period_s: float) -> Robot:
    # Pybullet is loaded only where it is used.
    from spikelane_sim.robots.bullet_drive import BulletDrive

    return BulletDrive(parameters, poses_per_step, period_s)


ENGINE = Engine(_make, PybulletParameters)
