"""The base of the spiking controllers of a fleet: all but their networks."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.fleet import check_made_for, Journey
from spikelane_controllers.operations import Operations
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

    @staticmethod
    def check(parameters: Any) -> None:
        """Accept all parameters: the kernel has all of them."""

    def __init__(self, parameters: Any, simulators: SimulatorFleet) -> None:
        """Make a controller for each robot.

        Raises:
            SpikelaneError: The image is not the camera's, or weights cannot be read.
        """
        check_made_for(parameters, 'encoding', parameters.encoding, simulators)
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
            ParameterError: It has other parameters than the kernel was made with, or was told to
                record. Only `learning` and `checkpoint` may differ: the rows have both.
        """
        controller = self.controllers[robot]
        parameters = controller.parameters
        if parameters != self._parameters and _shared(parameters) != _shared(self._parameters):
            raise ParameterError('fleet: expected controllers with the same parameters')
        _check_no_recording(controller)
        self._chance[robot] = controller.rng
        self._motors.smoothed[robot] = controller.steering
        self._motors.spikes[robot] = controller.spikes
        self._motors.decisions[robot] = 0
        self._motors.inputs[robot] = 0
        self._load_network(robot, controller)

    def store(self, robot: int) -> None:
        """Bring a controller up to date."""
        controller = self.controllers[robot]
        controller.steering = SteeringState(*self._motors.smoothed[robot].tolist())
        controller.spikes = tuple(self._motors.spikes[robot].tolist())
        self._store_network(robot, controller)
        if self._motors.decisions[robot]:  # else it shows what it did when it was loaded
            last = int(self._motors.inputs[robot, 0])
            controller.operations = controller.operations_of(1, last)
            self._store_step(controller, float(self._motors.distance_m[robot]))

    def operations(self, robot: int) -> Operations:
        """Return the operations since the robot's row was loaded."""
        decisions, inputs = self._motors.decisions[robot], self._motors.inputs[robot, 1]
        done: Operations = self.controllers[robot].operations_of(int(decisions), int(inputs))
        return done

    def taken_in(self, robot: int) -> None:
        """Return nothing: every answer is a step of the training."""

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
            SpikelaneError: A controller was told to record, or more spikes came than there is
                room for, which has a probability below 1e-30 in a step.
        """
        for controller in self.controllers[first:last]:
            _check_no_recording(controller)
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

    def _store_step(self, controller: Any, distance_m: float) -> None:
        """Bring back what else a controller shows of its last step."""

    @staticmethod
    def _kernel(*arguments: Any) -> None:
        """Let robots first to last answer and drive, compiled."""
        raise NotImplementedError


def _shared(parameters: Any) -> dict[str, Any]:
    """Return the parameters that all controllers of a fleet have in common."""
    own = ('learning', 'checkpoint')
    return {name: value for name, value in parameters.to_dict().items() if name not in own}


def _check_no_recording(controller: Any) -> None:
    if controller.is_recording:
        raise ParameterError(
            'record: expected a controller that drives step by step, got one in a fleet'
        )
