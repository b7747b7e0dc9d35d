"""Robots of a fleet whose engine is not compiled, as pybullet: the kernel calls them.

A kernel cannot hold a Python object. So each robot has a number, which is in the kernel's arrays
and by which the robot is found. A call takes about 2 µs more than the step of the robot, and holds
the interpreter's lock, so that a second thread makes such robots no faster.
"""

from __future__ import annotations

import itertools
import weakref

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.compiled import inner
from spikelane_sim.contract import Robot, WheelVelocities
from spikelane_sim.episode_rules import heading_of
from spikelane_sim.robots import make_robot, RobotParameters

_robots: dict[int, Robot] = {}
_numbers = itertools.count(1)


class Bodies:
    """The robots of a fleet.

    Attributes:
        numbers: By which `move_body` finds them, (n_robots,).
    """

    def __init__(
        self, n_robots: int, parameters: RobotParameters, n_images: int, period_s: float
    ) -> None:
        """Make robots, placed at the origin.

        Args:
            n_robots: How many.
            parameters: What each is.
            n_images: How many poses a step has.
            period_s: Length of a step.

        Raises:
            SpikelaneError: As of `make_robot`.
        """
        made: dict[int, Robot] = {}
        # Also where one of them cannot be made, or nobody calls `close`.
        self._release = weakref.finalize(self, _forget, made)
        for number in itertools.islice(_numbers, n_robots):
            made[number] = _robots[number] = make_robot(parameters, n_images, period_s)
        self._made = tuple(made.values())
        self.numbers = np.array(list(made), np.int64)

    def __getitem__(self, robot: int) -> Robot:
        """Return a robot."""
        return self._made[robot]

    def reset(self, robot: int, x_m: float, y_m: float, heading_rad: float) -> NDArray[np.float64]:
        """Place a robot at rest; return its pose, (7,)."""
        body = self._made[robot]
        body.reset(x_m, y_m, heading_rad)
        state = body.state
        return np.array(state.position + state.orientation)

    def wheel_velocities(self) -> NDArray[np.float64]:
        """Return what the encoders of the wheels measure [rad/s], (n_robots, 2)."""
        return np.array([robot.state.wheel_velocities for robot in self._made])

    def close(self) -> None:
        """Close the robots; a second call does nothing."""
        self._release()


def _forget(made: dict[int, Robot]) -> None:
    for number, robot in made.items():
        del _robots[number]
        robot.close()


def _move(
    number: int,
    left: float,
    right: float,
    poses: NDArray[np.float64],
    place: NDArray[np.float64],
) -> None:
    try:
        poses[:] = _robots[number].step(WheelVelocities(left, right))
        x_m, y_m, _, *orientation = poses[-1].tolist()
        place[:] = x_m, y_m, heading_of(*orientation)
    finally:
        # The kernel has borrowed these arrays: a traceback must not keep them.
        del poses, place


@inner
def move_body(number, left, right, poses, place):  # type: ignore[no-untyped-def]
    """Drive a robot for a step, from a kernel.

    Args:
        number: Its number in `Bodies.numbers`.
        left: Velocity of the left wheel [rad/s].
        right: The same for the right wheel.
        poses: Become those at the images of the step, (n_images, 7).
        place: Becomes its place afterwards: x, y [m] and heading [rad].
    """
    with numba.objmode():
        _move(number, left, right, poses, place)
