"""The base of the spiking controllers of a fleet: all but their networks."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.fleet import check_image, Journey
from spikelane_controllers.spiking.fleet_kernel import make_motors, repeat
from spikelane_controllers.spiking.steering import SteeringState
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.fleet.generators import Generators, TEMPLATE
from spikelane_sim.fleet.simulators import SimulatorFleet


class SpikingFleet:
    """Controllers whose inputs are Poisson spikes and whose neurons steer.

    A subclass has the networks: `_networks`, a named tuple with a row `has_overflown` for each
    robot, the kernel that answers and drives, and how a network gets into its row and back.

    Attributes:
        controllers: One for each robot, all with the same parameters.
    """

    controller_class: ClassVar[type[Any]]
    _networks: Any

    def __init__(self, parameters: Any, simulators: SimulatorFleet) -> None:
        """Make a controller for each robot.

        Raises:
            SpikelaneError: The image is not the camera's, or weights cannot be read.
        """
        check_image(parameters, simulators)
        number = len(simulators)
        self.controllers = [self.controller_class(parameters) for _ in range(number)]
        self._parameters = parameters
        self._simulators = simulators
        self._chance = Generators(number)
        self._motors = make_motors(number, parameters, self._chance)
        self._networks = self._make_networks(number)
        for robot in range(number):
            self.load(robot)

    def load(self, robot: int) -> None:
        """Take over what a controller is now.

        Raises:
            ParameterError: It has other parameters than the kernel was made with.
        """
        controller = self.controllers[robot]
        if controller.parameters != self._parameters:
            raise ParameterError('fleet: expected controllers with the same parameters')
        self._chance[robot] = controller.rng
        self._motors.smoothed[robot] = controller.steering
        self._motors.spikes[robot] = controller.spikes
        self._load_network(robot, controller)

    def store(self, robot: int) -> None:
        """Bring a controller up to date, but for what it shows of its last step alone."""
        controller = self.controllers[robot]
        controller.steering = SteeringState(*self._motors.smoothed[robot].tolist())
        controller.spikes = tuple(self._motors.spikes[robot].tolist())
        self._store_network(robot, controller)

    def look(self, robot: int) -> None:
        """Let a controller see no events."""
        self._motors.counts[robot] = 0

    def repeat(self, robot: int, answers: NDArray[np.float64], scratch: Any) -> None:
        """Drive a robot with answers that were given before."""
        world, robots = self._simulators.world, self._simulators.robots
        repeat(world, robots, scratch, TEMPLATE, self._motors, robot, answers)

    def advance(self, first: int, last: int, journey: Journey, scratch: Any) -> None:
        """Let robots drive; see `fleet.ControllerFleet`.

        Raises:
            SpikelaneError: More spikes came than there is room for, which has a probability
                below 1e-30 in a step.
        """
        world, robots = self._simulators.world, self._simulators.robots
        self._kernel(
            world, robots, scratch, TEMPLATE, self._motors, self._networks, journey, first, last
        )
        if self._networks.has_overflown[first:last].any():
            raise SpikelaneError('inputs: expected fewer spikes in a step than there is room for')

    def _make_networks(self, number: int) -> Any:
        """Return the networks of so many robots; their rows are filled later."""
        raise NotImplementedError

    def _load_network(self, robot: int, controller: Any) -> None:
        """Bring a controller's network into its row."""
        raise NotImplementedError

    def _store_network(self, robot: int, controller: Any) -> None:
        """Bring a row back into a controller's network."""
        raise NotImplementedError

    @staticmethod
    def _kernel(*arguments: Any) -> None:
        """Let robots first to last answer and drive, compiled."""
        raise NotImplementedError
