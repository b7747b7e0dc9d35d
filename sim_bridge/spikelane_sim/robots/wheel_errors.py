"""Wheels that are not what the robot takes them for: the errors of UMBmark.

Borenstein and Feng 1996 (Measurement and correction of systematic odometry errors in mobile
robots) reduce the systematic errors of a differential drive to unequal wheels and a wrong track.
A wheel whose radius is f times the nominal one drives as a nominal wheel that turns f times as
fast, and a robot whose track is k times as wide turns k times as slowly. So the engines, all of
them, drive nominal wheels at other velocities; what a wheel a few millimetres smaller does to the
robot's height and roll is not simulated, nor to torques and inertia.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.contract import Robot, RobotState, WheelVelocities


class WheelErrors(NamedTuple):
    """Factors of the nominal sizes."""

    left: float = 1.0
    right: float = 1.0
    track: float = 1.0


@numba.njit(cache=True)
def nominal_velocities(left, right, errors):  # type: ignore[no-untyped-def]
    """Return the velocities of nominal wheels that drive as the real ones do [rad/s].

    Args:
        left: Velocity of the left wheel [rad/s].
        right: The same of the right one.
        errors: The `WheelErrors`.
    """
    left, right = left * errors.left, right * errors.right
    mean, half = (left + right) / 2, (right - left) / 2 / errors.track
    return mean - half, mean + half


def real_velocities(
    nominal: NDArray[np.float64], errors: tuple[Any, Any, Any]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the velocities of the real wheels, or their angles: left, right.

    Args:
        nominal: Those of the nominal ones, (2, ...).
        errors: `WheelErrors`, or arrays of the same, (...).
    """
    left, right, track = errors
    mean, half = (nominal[0] + nominal[1]) / 2, (nominal[1] - nominal[0]) / 2 * track
    return (mean - half) / left, (mean + half) / right


class UnequalWheels:
    """A robot with such wheels (`contract.Robot`).

    Attributes:
        errors: What the wheels are; may be changed between two steps.
    """

    def __init__(self, robot: Robot) -> None:
        self.errors = WheelErrors()
        self._robot = robot
        self._angles = np.zeros(2)

    def reset(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Place the robot, at rest."""
        self._robot.reset(x_m, y_m, heading_rad)
        self._angles[:] = 0.0

    def step(self, wheels: WheelVelocities) -> NDArray[np.float64]:
        """Drive for one step; see `contract.Robot`."""
        before = np.array(self._robot.state.wheel_angles)
        poses = self._robot.step(WheelVelocities(*nominal_velocities(*wheels, self.errors)))
        turned = np.array(self._robot.state.wheel_angles) - before
        self._angles += real_velocities(turned, self.errors)
        return poses

    @property
    def state(self) -> RobotState:
        """Pose and motion now, with the angles and velocities of the real wheels."""
        state = self._robot.state
        left, right = real_velocities(np.array(state.wheel_velocities), self.errors)
        return state._replace(
            wheel_angles=(float(self._angles[0]), float(self._angles[1])),
            wheel_velocities=(float(left), float(right)),
        )

    def close(self) -> None:
        """Release what the robot holds."""
        self._robot.close()
