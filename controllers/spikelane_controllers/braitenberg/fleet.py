"""Braitenberg in a fleet: the networks of many robots in one kernel."""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.braitenberg.controller import Braitenberg
from spikelane_controllers.spiking.fleet_kernel import (
    drive_together,
    gather,
    let_fly,
    most_inputs,
    TOGETHER,
)
from spikelane_controllers.spiking.network import most_fired, NetworkState, run_several
from spikelane_controllers.spiking.neuron import Constants, LANES, NEURON_DTYPE, Neurons
from spikelane_controllers.spiking.spikes import grid_steps, SPIKE_DTYPE, Spikes
from spikelane_controllers.spiking.spiking_fleet import SpikingFleet
from spikelane_sim.kernel_arrays import borrowed, stack_array


class _Networks(NamedTuple):
    """The networks; rows are robots.

    Attributes:
        neurons: States of the neurons, of NEURON_DTYPE, (n_robots, 2).
        flying: Spikes on their way, (n_robots, room).
        n_flying: How many of them count, (n_robots,).
        fired: Spikes of the neurons in the last step, (n_robots, room).
        n_fired: How many of them count, (n_robots,).
        weights_pa: Weights of all robots, (2, n_inputs).
        constants: The neurons'.
        delay: From an input to a neuron [grid steps].
        lowest_rows: Rows of cells that excite the neurons.
        has_overflown: Whether spikes had no room, (n_robots,).
    """

    neurons: Neurons
    flying: Spikes
    n_flying: NDArray[np.int64]
    fired: Spikes
    n_fired: NDArray[np.int64]
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
        window = grid_steps('period_ms', parameters.period_ms)
        n_neurons = len(first.neurons)
        return _Networks(
            neurons=np.zeros((number, n_neurons), NEURON_DTYPE),
            flying=np.zeros((number, 2 * most_inputs(parameters)), SPIKE_DTYPE),
            n_flying=np.zeros(number, np.int64),
            fired=np.zeros((number, most_fired(n_neurons, first.constants, window)), SPIKE_DTYPE),
            n_fired=np.zeros(number, np.int64),
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
    """Let robots first to last drive, some at a time, as their networks are quicker together."""
    world, robots, scratch = borrowed(world), borrowed(robots), borrowed(scratch)
    motors, networks, journey = borrowed(motors), borrowed(networks), borrowed(journey)
    flying, n_flying, has_overflown = networks.flying, networks.n_flying, networks.has_overflown
    arriving, members = np.empty((motors.window, LANES)), stack_array((TOGETHER,), np.int64)
    number, following = 0, first
    while True:
        number, following = gather(journey, members, number, following, last)
        if number == 0:
            return
        for m in range(number):
            counts = motors.counts[members[m]]
            counts[: counts.shape[0] - networks.lowest_rows] = 0
            if not let_fly(motors, template, members[m], flying, n_flying, has_overflown):
                return
        run_several(
            networks.neurons,
            flying,
            n_flying,
            networks.fired,
            networks.n_fired,
            members[:number],
            networks.weights_pa,
            networks.constants,
            networks.delay,
            arriving,
        )
        number = drive_together(
            world,
            robots,
            scratch,
            template,
            motors,
            journey,
            members,
            number,
            networks.fired,
            networks.n_fired,
        )
