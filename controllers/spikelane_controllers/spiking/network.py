"""Networks of neurons and static synapses, run a window of time at once.

Inputs reach a relay (NEST's parrot neuron, the presynaptic side of a plastic synapse) and from
there the neurons, each way after a delay. Spikes on their way when a window ends are part of the
state, so that it does not matter how time is divided into windows.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking.neuron import (
    advance_neuron,
    advance_neurons,
    Constants,
    membrane_potentials,
    NEURON_DTYPE,
    Neurons,
    put_in_lane,
    resting_lanes,
    take_from_lane,
)
from spikelane_controllers.spiking.spikes import (
    GRID_MS,
    GRID_STEPS,
    grid_steps,
    no_spikes,
    SPIKE_DTYPE,
    Spikes,
)
from spikelane_sim.compiled import inner, uncounted
from spikelane_sim.parameters import parameter, Parameters


@dataclasses.dataclass(frozen=True, kw_only=True)
class DelayParameters(Parameters):
    """Delays of the connections; NEST's default for both."""

    to_relay_ms: float = parameter(
        1.0, 'Delay from an input to its relay neuron.', unit='ms', low=GRID_MS, high=1000.0
    )
    to_neuron_ms: float = parameter(
        1.0, 'Delay from a relay neuron to a motor neuron.', unit='ms', low=GRID_MS, high=1000.0
    )

    def _check_relations(self) -> None:
        _ = self.steps

    @property
    def steps(self) -> int:
        """From an input to a neuron [grid steps]."""
        to_relay = grid_steps('to_relay_ms', self.to_relay_ms)
        return to_relay + grid_steps('to_neuron_ms', self.to_neuron_ms)


class NetworkState(NamedTuple):
    """State of the neurons, and the spikes on their way to them."""

    neurons: Neurons
    in_flight: Spikes  # fired by inputs before this window: their grid steps are negative


def resting_state(neurons: int) -> NetworkState:
    """Return neurons at rest and no spikes on their way."""
    return NetworkState(np.zeros(neurons, NEURON_DTYPE), no_spikes())


def run_network(
    state: NetworkState,
    inputs: Spikes,
    weights_pa: NDArray[np.float64],
    constants: Constants,
    delay: int,
    window: int = GRID_STEPS,
) -> tuple[NetworkState, Spikes]:
    """Run a network of static synapses for a window of time.

    Args:
        state: State at the window's start.
        inputs: What the inputs fire in this window, in the order of grid steps; an input may do
            so several times in one. Sources are below n_inputs, which is not checked.
        weights_pa: Peak currents that a spike causes [pA], (n_neurons, n_inputs).
        constants: The neurons.
        delay: From an input, by way of its relay, to the neurons [grid steps].
        window: Length of the window [grid steps].

    Returns:
        State at the window's end, and the spikes of the neurons in the window.
    """
    neurons, in_flight, fired = run_kernel(*state, inputs, weights_pa, constants, delay, window)
    return NetworkState(neurons, in_flight), fired


def network_potentials(
    state: NetworkState,
    inputs: Spikes,
    weights_pa: NDArray[np.float64],
    constants: Constants,
    delay: int,
    window: int = GRID_STEPS,
) -> NDArray[np.float64]:
    """Return the membrane potentials that `run_network` with the same arguments goes through.

    Returns:
        As `membrane_potentials` does.
    """
    spikes = _merge_spikes(state.in_flight, inputs)
    arriving_pa, _ = _arriving(spikes, weights_pa, delay, window)
    return membrane_potentials(state.neurons, arriving_pa, constants)


@numba.njit(cache=True)
def _merge_spikes(in_flight: Spikes, inputs: Spikes) -> Spikes:
    """Return the spikes that a window has to do with, in the order of grid steps."""
    spikes = np.empty(len(in_flight) + len(inputs), SPIKE_DTYPE)
    spikes[: len(in_flight)] = in_flight
    spikes[len(in_flight) :] = inputs
    return spikes


@inner
def _keep_flying(spikes: Spikes, arrived: int, window: int) -> Spikes:
    """Return the spikes from `arrived` on as the next window sees them."""
    in_flight = spikes[arrived:].copy()
    for k in range(len(in_flight)):
        in_flight[k].step -= window
    return in_flight


@numba.njit(cache=True)
def _arriving(
    spikes: Spikes, weights_pa: NDArray[np.float64], delay: int, window: int
) -> tuple[NDArray[np.float64], int]:
    """Return what arrives at the neurons in each grid step [pA], and how many spikes do."""
    arriving_pa = np.zeros((window, len(weights_pa)))
    arrived = 0
    while arrived < len(spikes) and spikes[arrived].step + delay < window:
        spike = spikes[arrived]
        for index in range(len(weights_pa)):
            arriving_pa[spike.step + delay, index] += weights_pa[index, spike.source]
        arrived += 1
    return arriving_pa, arrived


@numba.njit(cache=True)
def most_fired(n_neurons: int, constants: Constants, window: int) -> int:
    """Return how many spikes neurons can fire in a window."""
    return int(n_neurons * (1 + (window - 1) // (1 + constants[0].refractory)))


@numba.njit(cache=True)
def run_kernel(
    neurons: Neurons,
    in_flight: Spikes,
    inputs: Spikes,
    weights_pa: NDArray[np.float64],
    constants: Constants,
    delay: int,
    window: int,
) -> tuple[Neurons, Spikes, Spikes]:
    """Do what `run_network` does, compiled; its result is flat."""
    neurons = neurons.copy()
    spikes = _merge_spikes(in_flight, inputs)
    arriving_pa, arrived = _arriving(spikes, weights_pa, delay, window)
    fired = np.empty(most_fired(len(neurons), constants, window), SPIKE_DTYPE)
    firings = 0
    for step in range(window):
        for index in range(len(neurons)):
            neuron = neurons[index]
            potential, current, slope, refractory, has_fired = advance_neuron(
                neuron.potential_mv,
                neuron.current_pa,
                neuron.slope_pa_per_ms,
                neuron.refractory,
                arriving_pa[step, index],
                constants[0],
            )
            neuron.potential_mv, neuron.current_pa = potential, current
            neuron.slope_pa_per_ms, neuron.refractory = slope, refractory
            if has_fired:
                fired[firings].step = step
                fired[firings].source = index
                firings += 1
    return neurons, _keep_flying(spikes, arrived, window), fired[:firings]


@uncounted
def run_several(  # type: ignore[no-untyped-def]
    neurons, flying, n_flying, fired, n_fired, members, weights_pa, constants, delay, arriving
):
    """Run a window of the networks of several robots at the same time; see `run_network`.

    Args:
        neurons: Their states, of NEURON_DTYPE, (n_robots, n_neurons).
        flying: Spikes in flight and those that the inputs fire, (n_robots, room).
        n_flying: How many of them count, (n_robots,).
        fired: The neurons' spikes are written here, (n_robots, room).
        n_fired: How many there are, (n_robots,).
        members: The rows of these robots, together of at most `LANES` neurons.
        weights_pa: As there, the same for all robots.
        constants: As there.
        delay: As there.
        arriving: Is overwritten, (window, LANES).
    """
    window, number = len(arriving), neurons.shape[1]
    lanes = resting_lanes()
    arriving[:] = 0.0
    for m in range(len(members)):
        row = members[m]
        n_fired[row], spikes = 0, flying[row, : n_flying[row]]
        n_flying[row] = _let_arrive(spikes, weights_pa, delay, arriving[:, m * number :])
        for i in range(number):
            put_in_lane(neurons[row, i], lanes, m * number + i)
    step = 0
    while step < window:
        step = advance_neurons(lanes, arriving, step, window, constants[0])
        for lane in range(len(members) * number):
            if lanes.has_fired[lane]:
                row = members[lane // number]
                spike = fired[row, n_fired[row]]
                spike.step, spike.source = step - 1, lane % number
                n_fired[row] += 1
    for m in range(len(members)):
        for i in range(number):
            take_from_lane(neurons[members[m], i], lanes, m * number + i)


@uncounted
def _let_arrive(spikes, weights_pa, delay, arriving):  # type: ignore[no-untyped-def]
    """Add to what arrives in a window; return how many spikes fly on, for the next window to see.

    Args:
        spikes: In flight and fired in this window; those that fly on are moved to the front.
        weights_pa: As in `run_network`.
        delay: As there.
        arriving: What arrives in each grid step [pA], (window, n_neurons) or more columns.
    """
    flying = 0
    for k in range(len(spikes)):
        step, source = spikes[k].step + delay, spikes[k].source
        if step < len(arriving):
            for i in range(len(weights_pa)):
                arriving[step, i] += weights_pa[i, source]
        else:
            spikes[flying].step = spikes[k].step - len(arriving)
            spikes[flying].source = source
            flying += 1
    return flying
