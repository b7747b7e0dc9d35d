"""An ideal differential drive: wheels that never slip and reach any velocity at once.

While the wheels turn steadily the middle of their axle runs along an arc, which is evaluated in
closed form: a step is exact, however long. The origin of base_link lies behind the axle and so
also moves sideways in a turn.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.contract import RobotState, WheelVelocities
from spikelane_sim.engine import Engine
from spikelane_sim.errors import ParameterError
from spikelane_sim.period import PERIOD_MS

if TYPE_CHECKING:
    from spikelane_sim.robots import RobotParameters


class Kinematic:
    """A level robot on an ideal differential drive (`contract.Robot`)."""

    def __init__(
        self,
        parameters: RobotParameters,
        poses_per_step: int = 1,
        period_s: float = PERIOD_MS / 1000,
    ) -> None:
        """Make the robot, at the origin.

        Raises:
            ParameterError: poses_per_step is not at least 1.
        """
        if poses_per_step < 1:
            raise ParameterError(f'poses_per_step: expected at least 1, got {poses_per_step}')
        self._radius_m = parameters.wheel_radius_m
        self._track_m = parameters.track_m
        self._axle_x_m = parameters.axle_x_m
        self._height_m = parameters.height_m
        self._poses_per_step = poses_per_step
        self._period_s = period_s
        self.reset(0.0, 0.0, 0.0)

    def reset(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Place the robot, at rest."""
        self._x_m, self._y_m, self._heading_rad = float(x_m), float(y_m), float(heading_rad)
        self._wheels = WheelVelocities(0.0, 0.0)
        self._wheel_angles = (0.0, 0.0)

    def step(self, wheels: WheelVelocities) -> NDArray[np.float64]:
        """Drive for one step; see `contract.Robot`."""
        self._wheels = wheels
        forward, turn = self._twist()
        poses, self._x_m, self._y_m, self._heading_rad = drive_arc(
            (self._x_m, self._y_m, self._heading_rad),
            forward,
            turn,
            self._axle_x_m,
            self._height_m,
            self._poses_per_step,
            self._period_s,
        )
        left, right = self._wheel_angles
        period_s = self._period_s
        self._wheel_angles = (left + wheels.left * period_s, right + wheels.right * period_s)
        return poses  # type: ignore[no-any-return]  # numba carries no types

    @property
    def state(self) -> RobotState:
        """Pose and motion now."""
        forward, turn = self._twist()
        half_rad = self._heading_rad / 2
        return RobotState(
            position=(self._x_m, self._y_m, self._height_m),
            orientation=(0.0, 0.0, math.sin(half_rad), math.cos(half_rad)),
            linear=(forward, -self._axle_x_m * turn, 0.0),
            angular=(0.0, 0.0, turn),
            wheel_angles=self._wheel_angles,
            wheel_velocities=(self._wheels.left, self._wheels.right),
        )

    def close(self) -> None:
        """Release nothing."""

    def _twist(self) -> tuple[float, float]:
        """Return the velocity forward [m/s] and the turning rate [rad/s]."""
        left, right = self._wheels
        forward = (left + right) * self._radius_m / 2
        return forward, (right - left) * self._radius_m / self._track_m


@numba.njit(cache=True)
def drive_arc(  # type: ignore[no-untyped-def]
    start, forward, turn, axle_x_m, height_m, count, period_s
):
    """Return the poses along one step, and x, y and heading at its end.

    Args:
        start: x, y and heading of base_link.
        forward: Velocity forward [m/s].
        turn: Turning rate [rad/s].
        axle_x_m: Place of the axle ahead of base_link.
        height_m: Height of base_link.
        count: How many poses.
        period_s: Length of the step.
    """
    x_start_m, y_start_m, heading_start_rad = start
    x_m, y_m, heading_rad = start
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    poses = np.empty((count, 7))
    for row in range(count):
        time_s = period_s * (row + 1) / count
        half_rad = turn * time_s / 2
        # The chord of the axle's arc; below 1e-8 rad it equals the arc in double precision.
        shortening = math.sin(half_rad) / half_rad if abs(half_rad) > 1e-8 else 1.0
        chord_m = forward * time_s * shortening
        direction_rad = heading_start_rad + half_rad
        heading_rad = heading_start_rad + 2 * half_rad
        swing_x_m = axle_x_m * (math.cos(heading_rad) - cosine)
        swing_y_m = axle_x_m * (math.sin(heading_rad) - sine)
        x_m = x_start_m + chord_m * math.cos(direction_rad) - swing_x_m
        y_m = y_start_m + chord_m * math.sin(direction_rad) - swing_y_m
        poses[row, 0] = x_m
        poses[row, 1] = y_m
        poses[row, 2] = height_m
        poses[row, 3] = 0.0
        poses[row, 4] = 0.0
        poses[row, 5] = math.sin(heading_rad / 2)
        poses[row, 6] = math.cos(heading_rad / 2)
    return poses, x_m, y_m, heading_rad


ENGINE = Engine(Kinematic)
