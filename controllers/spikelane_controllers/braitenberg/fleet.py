"""Braitenberg in a fleet: the networks of many robots in one kernel."""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.braitenberg.controller import Braitenberg, BraitenbergParameters
from spikelane_controllers.fleet import check_image, Journey
from spikelane_controllers.spiking.fleet_kernel import (
    draw_inputs,
    drive_on,
    make_motors,
    most_inputs,
    repeat,
    turn_wheels,
)
from spikelane_controllers.spiking.network import NetworkState, run_kernel
from spikelane_controllers.spiking.neuron import Constants, NEURON_DTYPE, Neurons
from spikelane_controllers.spiking.spikes import GRID_STEPS, SPIKE_DTYPE, Spikes
from spikelane_controllers.spiking.steering import SteeringState
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.fleet.generators import Generators, TEMPLATE
from spikelane_sim.fleet.simulators import SimulatorFleet


class _Networks(NamedTuple):
    """The networks; rows are robots.

    Attributes:
        neurons: States of the neurons, of NEURON_DTYPE, (n_robots, 2).
        flying: Spikes on their way, (n_robots, room).
        n_flying: How many of them count, (n_robots,).
        weights_pa: Weights of all robots, (2, n_inputs).
        constants: The neurons'.
        delay: From an input to a neuron [grid steps].
        lowest_rows: Rows of cells that excite the neurons.
        has_overflown: Whether spikes had no room, (n_robots,).
    """

    neurons: Neurons
    flying: Spikes
    n_flying: NDArray[np.int64]
    weights_pa: NDArray[np.float64]
    constants: Constants
    delay: int
    lowest_rows: int
    has_overflown: NDArray[np.bool_]


class BraitenbergFleet:
    """The Braitenberg controllers of a fleet; see `fleet.ControllerFleet`."""

    def __init__(self, parameters: BraitenbergParameters, simulators: SimulatorFleet) -> None:
        """Make a controller for each robot.

        Raises:
            SpikelaneError: The image is not the camera's.
        """
        check_image(parameters, simulators)
        number = len(simulators)
        self.controllers = [Braitenberg(parameters) for _ in range(number)]
        self._simulators = simulators
        self._chance = Generators(number)
        self._motors = make_motors(number, parameters, self._chance)
        first = self.controllers[0]
        self._networks = _Networks(
            neurons=np.zeros((number, len(first.neurons)), NEURON_DTYPE),
            flying=np.zeros((number, 2 * most_inputs(parameters)), SPIKE_DTYPE),
            n_flying=np.zeros(number, np.int64),
            weights_pa=first.weights_pa,
            constants=first.constants,
            delay=parameters.delays.steps,
            lowest_rows=parameters.lowest_rows,
            has_overflown=np.zeros(number, np.bool_),
        )
        for robot in range(number):
            self.load(robot)

    def load(self, robot: int) -> None:
        """Take over what a controller is now."""
        controller, networks = self.controllers[robot], self._networks
        self._chance[robot] = controller.rng
        self._motors.smoothed[robot] = controller.steering
        self._motors.spikes[robot] = controller.spikes
        neurons, in_flight = controller.network
        networks.neurons[robot] = neurons
        networks.flying[robot, : len(in_flight)] = in_flight
        networks.n_flying[robot] = len(in_flight)

    def store(self, robot: int) -> None:
        """Bring a controller up to date."""
        controller, networks = self.controllers[robot], self._networks
        in_flight = networks.flying[robot, : networks.n_flying[robot]]
        controller.network = NetworkState(networks.neurons[robot].copy(), in_flight.copy())
        controller.steering = SteeringState(*self._motors.smoothed[robot].tolist())
        controller.spikes = tuple(self._motors.spikes[robot].tolist())

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
        _advance(
            world, robots, scratch, TEMPLATE, self._motors, self._networks, journey, first, last
        )
        if self._networks.has_overflown[first:last].any():
            raise SpikelaneError('inputs: expected fewer spikes in a step than there is room for')


@numba.njit(cache=True, nogil=True)
def _advance(  # type: ignore[no-untyped-def]
    world, robots, scratch, template, motors, networks, journey, first, last
):
    """Let robots first to last drive, one after the other: its arrays stay in the cache."""
    for i in range(first, last):
        journey.taken[i], journey.has_ended[i] = 0, False
        while journey.taken[i] < journey.wanted[i]:
            counts = motors.counts[i]
            counts[: counts.shape[0] - networks.lowest_rows] = 0
            inputs = draw_inputs(motors, template, i)
            if networks.n_flying[i] + len(inputs) > networks.flying.shape[1]:
                networks.has_overflown[i] = True
                return
            left, right = _answer(networks, motors, inputs, i)
            if not drive_on(world, robots, scratch, template, motors, journey, i, left, right):
                break


@numba.njit(cache=True)
def _answer(networks, motors, inputs, i):  # type: ignore[no-untyped-def]
    """Return the wheels' velocities with which robot i answers; see `Braitenberg.step`."""
    neurons, in_flight, fired = run_kernel(
        networks.neurons[i],
        networks.flying[i, : networks.n_flying[i]],
        inputs,
        networks.weights_pa,
        networks.constants,
        networks.delay,
        GRID_STEPS,
    )
    for k in range(len(neurons)):
        networks.neurons[i, k] = neurons[k]
    for k in range(len(in_flight)):
        networks.flying[i, k] = in_flight[k]
    networks.n_flying[i] = len(in_flight)
    return turn_wheels(motors, i, fired)
