"""Controllers of many robots, compiled together with the robots they drive.

A controller's card may name a class that follows `ControllerFleet`. Each robot has a controller of
its own, an ordinary object of the controller's class. While the kernel runs, what changes of it is
in row i of arrays; `store` brings it back into the object, so that states, checkpoints and weights
are had where they always are.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.controller_host import check_period
from spikelane_controllers.operations import Operations
from spikelane_sim.encoding import EncodingParameters
from spikelane_sim.errors import ParameterError
from spikelane_sim.fleet.simulators import SimulatorFleet
from spikelane_sim.parameters import Parameters

#: Where a robot was when it made an observation, and what it saw.
PLACE_DTYPE = np.dtype(
    [
        ('x_m', '<f8'),
        ('y_m', '<f8'),
        ('heading_rad', '<f8'),
        ('orientation_x', '<f8'),  # of the body, a quaternion
        ('orientation_y', '<f8'),
        ('orientation_z', '<f8'),
        ('orientation_w', '<f8'),
        ('distance_m', '<f8'),
        ('heading_error_rad', '<f8'),
        ('position_m', '<f8'),
        ('progress_m', '<f8'),
        ('section', '<i8'),  # of the lane
        ('laps', '<i8'),
        ('events', '<i8'),  # that came through the link, before filters
    ]
)


class Journey(NamedTuple):
    """What the robots are to do in one call of a kernel, and what they did; rows are robots.

    Attributes:
        wanted: How many observations to answer, (n_robots,).
        taken: How many were answered that did not end the episode, (n_robots,).
        has_ended: Whether the last one answered ended the episode, (n_robots,).
        distance_m: Distance in the last answered observation that did not end it, (n_robots,).
        answers: Wheel velocities [rad/s], (n_robots, room, 2). The answer to an observation that
            ended the episode follows those that are counted in `taken`.
        places: Where each of these observations was made, records of `PLACE_DTYPE`,
            (n_robots, room); (n_robots, 0) where it is not wanted.
    """

    wanted: NDArray[np.int64]
    taken: NDArray[np.int64]
    has_ended: NDArray[np.bool_]
    distance_m: NDArray[np.float64]
    answers: NDArray[np.float64]
    places: NDArray[np.void]


def make_journey(n_robots: int, room: int, *, has_places: bool = False) -> Journey:
    """Return room for so many observations of each robot."""
    return Journey(
        np.zeros(n_robots, np.int64),
        np.zeros(n_robots, np.int64),
        np.zeros(n_robots, np.bool_),
        np.zeros(n_robots),
        np.zeros((n_robots, room, 2)),
        np.zeros((n_robots, room if has_places else 0), PLACE_DTYPE),
    )


class ControllerFleet(Protocol):
    """The controllers of a fleet.

    Attributes:
        controllers: One for each robot, all with the same parameters.
    """

    controllers: list[Any]

    @staticmethod
    def check(parameters: Any) -> None:
        """Check that the kernel has what controllers with these parameters do.

        Raises:
            ParameterError: It does not; the message names the parameter.
        """

    def __init__(self, parameters: Parameters, simulators: SimulatorFleet) -> None:
        """Make a controller for each robot.

        Raises:
            ParameterError: The kernel does not have this; the message names the parameter.
        """

    def load(self, robot: int) -> None:
        """Take over what a controller is now, after it was made, reset or restored.

        Raises:
            ParameterError: It has other parameters than the kernel was made with, or was told to
                record, which a kernel does not do.
        """

    def store(self, robot: int) -> None:
        """Bring a controller up to date with what its robot's row says."""

    def operations(self, robot: int) -> Operations:
        """Return the sum of a controller's operations since its robot's row was last loaded."""

    def taken_in(self, robot: int) -> Any:
        """Return what the robot's training is to know of the last call of `advance`.

        `Training.take` is given it; None where the answers say all.
        """

    def look(self, robot: int) -> None:
        """Let a controller see no events: the observation after a reset."""

    def repeat(self, robot: int, answers: NDArray[np.float64], scratch: Any) -> None:
        """Drive a robot with answers that were given before; its controller stays as it is.

        Args:
            robot: Which one.
            answers: Velocities of the left and the right wheel [rad/s], (n, 2).
            scratch: As in `advance`.
        """

    def advance(self, first: int, last: int, journey: Journey, scratch: Any) -> None:
        """Let robots first to last answer observations and drive, until each has done its part.

        It releases the interpreter's lock, so that several threads can do so for several robots.

        Args:
            first: First of the robots.
            last: The robot after the last one.
            journey: What they are to do; rows first to last change.
            scratch: Scratch arrays of this thread, from `make_scratch`.

        Raises:
            SpikelaneError: A controller was told to record, or the kernel has failed.
        """


def check_made_for(
    parameters: Any, name: str, encoding: EncodingParameters, simulators: SimulatorFleet
) -> None:
    """Check that a controller is made for the camera's image and the control period.

    Args:
        parameters: Those of the controller.
        name: Name of the encoding among the controller's parameters.
        encoding: What the controller counts events in.
        simulators: Whose camera it is.

    Raises:
        ParameterError: It is not.
    """
    check_period(parameters, simulators.parameters.period_ms)
    camera = simulators.parameters.camera
    if (encoding.width, encoding.height) != (camera.width, camera.height):
        raise ParameterError(
            f'{name}: expected {camera.width} x {camera.height} px, as the camera has, '
            f'got {encoding.width} x {encoding.height} px'
        )
