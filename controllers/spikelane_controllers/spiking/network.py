"""Leaky integrate-and-fire neurons with alpha-shaped currents, integrated exactly.

The model is NEST's iaf_psc_alpha, as in the paper's parameter table, on a grid of h = 0.1 ms:

    dV/dt = -(V - E_L) / tau_m + (I + I_e) / C_m,

where a spike arriving at time 0 adds w (e / tau_syn) t exp(-t / tau_syn) to the current I. It
peaks at w after tau_syn. Between the points of the grid the solution is exact (Rotter & Diesmann
1999, Biological Cybernetics 81), and as in NEST arrivals and threshold crossings happen at points.

Grid step k of a window lasts from k h to (k + 1) h after the window's start; a spike "in" it is
one at its end. Inputs reach a relay (NEST's parrot neuron, the presynaptic side of a plastic
synapse) and from there the neurons, each way after a delay. Spikes on their way when a window
ends are part of the state, so that it does not matter how time is divided into windows.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.contract import STEP_S
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import parameter, Parameters

#: Grid on which the neurons are integrated [ms] (paper table: time resolution).
GRID_MS = 0.1
#: Grid steps in a step of the simulation.
GRID_STEPS = round(STEP_S * 1000 / GRID_MS)

_TABLE = 'table "Simulation parameters specification"'

#: A spike: its grid step, 0 the window's first, and the index of the input or neuron that fired.
SPIKE_DTYPE = np.dtype([('step', '<i8'), ('source', '<i8')])

#: State of a neuron: membrane potential above E_L; synaptic current; the part of the current's
#: slope that decays; grid steps of refractory period left.
NEURON_DTYPE = np.dtype(
    [
        ('potential_mv', '<f8'),
        ('current_pa', '<f8'),
        ('slope_pa_per_ms', '<f8'),
        ('refractory', '<i8'),
    ]
)

#: What takes a neuron over one grid step, made by `neuron_constants`.
CONSTANTS_DTYPE = np.dtype(
    [
        ('membrane', '<f8'),  # exp(-h / tau_m) - 1
        ('synapse', '<f8'),  # exp(-h / tau_syn)
        ('current_from_slope', '<f8'),  # [ms]
        ('potential_from_current', '<f8'),  # [mV/pA]
        ('potential_from_slope', '<f8'),  # [mV ms/pA]
        ('potential_from_constant', '<f8'),  # what I_e adds [mV]
        ('slope_from_spike', '<f8'),  # e / tau_syn [1/ms]
        ('threshold_mv', '<f8'),  # above E_L
        ('reset_mv', '<f8'),  # above E_L
        ('refractory', '<i8'),  # [grid steps]
    ]
)

Spikes = NDArray[np.void]  # of SPIKE_DTYPE, in the order of grid steps, (n_spikes,)
Neurons = NDArray[np.void]  # of NEURON_DTYPE, (n_neurons,)
Constants = NDArray[np.void]  # of CONSTANTS_DTYPE, (1,)


@dataclasses.dataclass(frozen=True, kw_only=True)
class NeuronParameters(Parameters):
    """NEST's parameters of iaf_psc_alpha, with one time constant for both signs of current."""

    e_l_mv: float = parameter(
        -70.0, 'Resting membrane potential.', unit='mV', low=-1e4, high=1e4, source=_TABLE
    )
    v_th_mv: float = parameter(
        -55.0, 'Spike threshold.', unit='mV', low=-1e4, high=1e4, source=_TABLE
    )
    v_reset_mv: float = parameter(
        -70.0, 'Membrane potential after a spike.', unit='mV', low=-1e4, high=1e4, source=_TABLE
    )
    c_m_pf: float = parameter(
        250.0, 'Capacity of the membrane.', unit='pF', low=1e-3, high=1e6, source=_TABLE
    )
    tau_m_ms: float = parameter(
        10.0, 'Membrane time constant.', unit='ms', low=GRID_MS, high=1e6, source=_TABLE
    )
    tau_syn_ms: float = parameter(
        2.0, 'Rise time of synaptic currents.', unit='ms', low=GRID_MS, high=1e6, source=_TABLE
    )
    t_ref_ms: float = parameter(
        2.0, 'Refractory period.', unit='ms', low=0.0, high=1e4, source=_TABLE
    )
    i_e_pa: float = parameter(
        0.0, 'Constant input current.', unit='pA', low=-1e6, high=1e6, source=_TABLE
    )

    def _check_relations(self) -> None:
        if not self.v_reset_mv < self.v_th_mv:
            raise ParameterError(
                f'v_reset_mv: expected less than v_th_mv = {self.v_th_mv:g} mV, '
                f'got {self.v_reset_mv:g}'
            )
        grid_steps('t_ref_ms', self.t_ref_ms)


@dataclasses.dataclass(frozen=True, kw_only=True)
class DelayParameters(Parameters):
    """Delays of the connections; NEST's default for both."""

    to_relay_ms: float = parameter(
        1.0, 'From an input to its relay.', unit='ms', low=GRID_MS, high=1000.0
    )
    to_neuron_ms: float = parameter(
        1.0, 'From a relay to a neuron.', unit='ms', low=GRID_MS, high=1000.0
    )

    def _check_relations(self) -> None:
        _ = self.steps

    @property
    def steps(self) -> int:
        """From an input to a neuron [grid steps]."""
        to_relay = grid_steps('to_relay_ms', self.to_relay_ms)
        return to_relay + grid_steps('to_neuron_ms', self.to_neuron_ms)


def grid_steps(name: str, duration_ms: float) -> int:
    """Return how many grid steps last duration_ms.

    Raises:
        ParameterError: It is not a multiple of the grid step.
    """
    steps = round(duration_ms / GRID_MS)
    if abs(steps * GRID_MS - duration_ms) > 1e-9:
        raise ParameterError(f'{name}: expected a multiple of {GRID_MS:g} ms, got {duration_ms:g}')
    return steps


class NetworkState(NamedTuple):
    """State of the neurons, and the spikes on their way to them."""

    neurons: Neurons
    in_flight: Spikes  # fired by inputs before this window: their grid steps are negative


def neuron_constants(neuron: NeuronParameters) -> Constants:
    """Solve the neuron's equations over one grid step h.

    With x = h (1/tau_syn - 1/tau_m), a current I that decays with tau_syn adds to V in a step
    (h / C_m) exp(-h / tau_m) I times the integral over [0, 1] of exp(-x s) ds, and a slope that
    does so adds h times the slope times the same with s exp(-x s).
    """
    x = GRID_MS * (1 / neuron.tau_syn_ms - 1 / neuron.tau_m_ms)
    membrane = math.expm1(-GRID_MS / neuron.tau_m_ms)
    synapse = math.exp(-GRID_MS / neuron.tau_syn_ms)
    gain = GRID_MS / neuron.c_m_pf * math.exp(-GRID_MS / neuron.tau_m_ms)
    constants = np.zeros(1, CONSTANTS_DTYPE)
    constants['membrane'] = membrane
    constants['synapse'] = synapse
    constants['current_from_slope'] = GRID_MS * synapse
    constants['potential_from_current'] = gain * _moment(0, x)
    constants['potential_from_slope'] = GRID_MS * gain * _moment(1, x)
    constants['potential_from_constant'] = (
        -neuron.tau_m_ms / neuron.c_m_pf * membrane * neuron.i_e_pa
    )
    constants['slope_from_spike'] = math.e / neuron.tau_syn_ms
    constants['threshold_mv'] = neuron.v_th_mv - neuron.e_l_mv
    constants['reset_mv'] = neuron.v_reset_mv - neuron.e_l_mv
    constants['refractory'] = grid_steps('t_ref_ms', neuron.t_ref_ms)
    return constants


def _moment(n: int, x: float) -> float:
    """Return the integral over [0, 1] of s^n exp(-x s) ds for |x| <= 1, without cancellation."""
    return math.fsum((-x) ** k / (math.factorial(k) * (n + k + 1)) for k in range(20))


def no_spikes() -> Spikes:
    """Return an empty array of spikes."""
    return np.empty(0, SPIKE_DTYPE)


def spike_counts(spikes: Spikes, sources: int) -> tuple[int, ...]:
    """Return how often each of `sources` inputs or neurons fired."""
    return tuple(np.bincount(spikes['source'], minlength=sources).tolist())


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
    neurons, in_flight, fired = _run(*state, inputs, weights_pa, constants, delay, window)
    return NetworkState(neurons, in_flight), fired


@numba.njit(cache=True)
def advance_potential(potential: float, current: float, slope: float, constants: Any) -> float:
    """Return a neuron's potential a grid step later, where it is not refractory; for kernels.

    Args:
        potential: Field potential_mv of NEURON_DTYPE.
        current: Field current_pa.
        slope: Field slope_pa_per_ms.
        constants: A record of CONSTANTS_DTYPE.
    """
    after: float = (
        constants.potential_from_constant
        + constants.potential_from_slope * slope
        + constants.potential_from_current * current
        + constants.membrane * potential
        + potential
    )
    return after


@numba.njit(cache=True)
def advance_current(
    current: float, slope: float, arriving_pa: float, constants: Any
) -> tuple[float, float]:
    """Return a neuron's synaptic current and its slope a grid step later; for kernels.

    Args:
        current: Field current_pa of NEURON_DTYPE.
        slope: Field slope_pa_per_ms.
        arriving_pa: Sum of the weights of the spikes that arrive at the grid step's end.
        constants: A record of CONSTANTS_DTYPE.
    """
    after = constants.current_from_slope * slope + constants.synapse * current
    return after, constants.synapse * slope + constants.slope_from_spike * arriving_pa


@numba.njit(cache=True)
def _merge_spikes(in_flight: Spikes, inputs: Spikes) -> Spikes:
    """Return the spikes that a window has to do with, in the order of grid steps."""
    spikes = np.empty(len(in_flight) + len(inputs), SPIKE_DTYPE)
    spikes[: len(in_flight)] = in_flight
    spikes[len(in_flight) :] = inputs
    return spikes


@numba.njit(cache=True)
def _keep_flying(spikes: Spikes, arrived: int, window: int) -> Spikes:
    """Return the spikes from `arrived` on as the next window sees them."""
    in_flight = spikes[arrived:].copy()
    for k in range(len(in_flight)):
        in_flight[k].step -= window
    return in_flight


@numba.njit(cache=True)
def _run(
    neurons: Neurons,
    in_flight: Spikes,
    inputs: Spikes,
    weights_pa: NDArray[np.float64],
    constants: Constants,
    delay: int,
    window: int,
) -> tuple[Neurons, Spikes, Spikes]:
    neurons = neurons.copy()
    spikes = _merge_spikes(in_flight, inputs)
    arriving_pa = np.zeros((window, len(neurons)))
    arrived = 0
    while arrived < len(spikes) and spikes[arrived].step + delay < window:
        spike = spikes[arrived]
        for index in range(len(neurons)):
            arriving_pa[spike.step + delay, index] += weights_pa[index, spike.source]
        arrived += 1
    most = 1 + (window - 1) // (1 + constants[0].refractory)
    fired = np.empty(len(neurons) * most, SPIKE_DTYPE)
    firings = 0
    for step in range(window):
        for index in range(len(neurons)):
            neuron = neurons[index]
            current, slope = neuron.current_pa, neuron.slope_pa_per_ms
            if neuron.refractory > 0:
                neuron.refractory -= 1
            else:
                neuron.potential_mv = advance_potential(
                    neuron.potential_mv, current, slope, constants[0]
                )
            neuron.current_pa, neuron.slope_pa_per_ms = advance_current(
                current, slope, arriving_pa[step, index], constants[0]
            )
            if neuron.potential_mv >= constants[0].threshold_mv:
                neuron.potential_mv = constants[0].reset_mv
                neuron.refractory = constants[0].refractory
                fired[firings].step = step
                fired[firings].source = index
                firings += 1
    return neurons, _keep_flying(spikes, arrived, window), fired[:firings]
