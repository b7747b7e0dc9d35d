"""Braitenberg in a fleet: the networks of many robots in one kernel."""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.braitenberg.controller import Braitenberg
from spikelane_controllers.spiking.fleet_kernel import (
    draw_inputs,
    drive_on,
    most_inputs,
    turn_wheels,
)
from spikelane_controllers.spiking.network import NetworkState, run_kernel
from spikelane_controllers.spiking.neuron import Constants, NEURON_DTYPE, Neurons
from spikelane_controllers.spiking.spikes import SPIKE_DTYPE, Spikes
from spikelane_controllers.spiking.spiking_fleet import SpikingFleet
from spikelane_sim.compiled import inner
from spikelane_sim.kernel_arrays import borrowed


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


class BraitenbergFleet(SpikingFleet):
    """The Braitenberg controllers of a fleet; see `fleet.ControllerFleet`."""

    controller_class = Braitenberg

    def _make_networks(self, number: int) -> _Networks:
        first, parameters = self.controllers[0], self._parameters
        return _Networks(
            neurons=np.zeros((number, len(first.neurons)), NEURON_DTYPE),
            flying=np.zeros((number, 2 * most_inputs(parameters)), SPIKE_DTYPE),
            n_flying=np.zeros(number, np.int64),
            weights_pa=first.weights_pa,
            constants=first.constants,
            delay=parameters.delays.steps,
            lowest_rows=parameters.lowest_rows,
            has_overflown=np.zeros(number, np.bool_),
        )

    def _load_network(self, robot: int, controller: Braitenberg) -> None:
        networks: _Networks = self._networks
        neurons, in_flight = controller.network
        networks.neurons[robot] = neurons
        networks.flying[robot, : len(in_flight)] = in_flight
        networks.n_flying[robot] = len(in_flight)

    def _store_network(self, robot: int, controller: Braitenberg) -> None:
        networks: _Networks = self._networks
        in_flight = networks.flying[robot, : networks.n_flying[robot]]
        controller.network = NetworkState(networks.neurons[robot].copy(), in_flight.copy())

    @staticmethod
    def _kernel(*arguments: Any) -> None:
        _advance(*arguments)


@numba.njit(cache=True, nogil=True)
def _advance(  # type: ignore[no-untyped-def]
    world, robots, scratch, template, motors, networks, journey, first, last
):
    """Let robots first to last drive, one after the other: its arrays stay in the cache."""
    world, robots, scratch = borrowed(world), borrowed(robots), borrowed(scratch)
    motors, networks, journey = borrowed(motors), borrowed(networks), borrowed(journey)
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


@inner
def _answer(networks, motors, inputs, i):  # type: ignore[no-untyped-def]
    """Return the wheels' velocities with which robot i answers; see `Braitenberg.step`."""
    window = motors.window
    neurons, in_flight, fired = run_kernel(
        networks.neurons[i],
        networks.flying[i, : networks.n_flying[i]],
        inputs,
        networks.weights_pa,
        networks.constants,
        networks.delay,
        window,
    )
    for k in range(len(neurons)):
        networks.neurons[i, k] = neurons[k]
    for k in range(len(in_flight)):
        networks.flying[i, k] = in_flight[k]
    networks.n_flying[i] = len(in_flight)
    return turn_wheels(motors, i, fired)
