"""The leaky integrate-and-fire neuron with alpha-shaped currents, integrated exactly.

The model is NEST's iaf_psc_alpha, as in the paper's parameter table, on a grid of h = 0.1 ms:

    dV/dt = -(V - E_L) / tau_m + (I + I_e) / C_m,

where a spike arriving at time 0 adds w (e / tau_syn) t exp(-t / tau_syn) to the current I. It
peaks at w after tau_syn. Between the points of the grid the solution is exact (Rotter & Diesmann
1999, Biological Cybernetics 81), and as in NEST arrivals and threshold crossings happen at points.

All that is special to the model is here: parameters, state, constants, and the grid step
(`advance_neuron`) that the kernels of static and of learning synapses take.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking.spikes import GRID_MS, grid_steps
from spikelane_sim.compiled import inlined
from spikelane_sim.errors import ParameterError
from spikelane_sim.kernel_arrays import stack_array
from spikelane_sim.parameters import parameter, Parameters

_TABLE = 'table "Simulation parameters specification"'

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

#: Grid steps between two samples of potentials: 1 ms.
SAMPLE_STEPS = 10

#: Neurons that `advance_neurons` takes over a grid step at the same time. A step of so many takes
#: little longer than one of a few, as each has to wait for the last one: two vectors of 512 bits.
LANES = 16

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
        250.0, 'Membrane capacitance.', unit='pF', low=1e-3, high=1e6, source=_TABLE
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


@numba.njit(cache=True, inline='always')
def advance_neuron(
    potential: float,
    current: float,
    slope: float,
    refractory: int,
    arriving_pa: float,
    constants: Any,
) -> tuple[float, float, float, int, bool]:
    """Take a neuron over a grid step; for kernels.

    Args:
        potential: Field potential_mv of NEURON_DTYPE.
        current: Field current_pa.
        slope: Field slope_pa_per_ms.
        refractory: Field refractory.
        arriving_pa: Sum of the weights of the spikes that arrive at the grid step's end.
        constants: A record of CONSTANTS_DTYPE.

    Returns:
        The four fields a grid step later, and whether the neuron fires at its end.
    """
    if refractory > 0:
        refractory -= 1
    else:
        potential = _next_potential(potential, current, slope, constants)
    current, slope = _next_current(current, slope, arriving_pa, constants)
    has_fired = potential >= constants.threshold_mv
    if has_fired:
        potential, refractory = constants.reset_mv, constants.refractory
    return potential, current, slope, refractory, has_fired


class Lanes(NamedTuple):
    """The state of neurons that are integrated at the same time, one in each lane.

    Attributes:
        potential_mv: As in `NEURON_DTYPE`, as are the next three; (LANES,).
        current_pa: As there.
        slope_pa_per_ms: As there.
        refractory: As there.
        has_fired: Whether the neuron fired at the end of the last grid step, (LANES,).
    """

    potential_mv: NDArray[np.float64]
    current_pa: NDArray[np.float64]
    slope_pa_per_ms: NDArray[np.float64]
    refractory: NDArray[np.int64]
    has_fired: NDArray[np.int64]


@inlined
def resting_lanes() -> Lanes:
    """Return neurons at rest, on the stack of the caller."""
    lanes = Lanes(
        stack_array((LANES,), np.float64),
        stack_array((LANES,), np.float64),
        stack_array((LANES,), np.float64),
        stack_array((LANES,), np.int64),
        stack_array((LANES,), np.int64),
    )
    lanes.potential_mv[:] = 0.0
    lanes.current_pa[:] = 0.0
    lanes.slope_pa_per_ms[:] = 0.0
    lanes.refractory[:] = 0
    return lanes


@numba.njit(cache=True, inline='always')
def put_in_lane(neuron: Any, lanes: Lanes, lane: int) -> None:
    """Copy a neuron's state into a lane."""
    lanes.potential_mv[lane], lanes.current_pa[lane] = neuron.potential_mv, neuron.current_pa
    lanes.slope_pa_per_ms[lane] = neuron.slope_pa_per_ms
    lanes.refractory[lane] = neuron.refractory


@numba.njit(cache=True, inline='always')
def take_from_lane(neuron: Any, lanes: Lanes, lane: int) -> None:
    """Copy a lane into a neuron's state."""
    neuron.potential_mv, neuron.current_pa = lanes.potential_mv[lane], lanes.current_pa[lane]
    neuron.slope_pa_per_ms = lanes.slope_pa_per_ms[lane]
    neuron.refractory = lanes.refractory[lane]


@numba.njit(cache=True, inline='always')
def advance_neurons(lanes: Lanes, arriving_pa: Any, begin: int, end: int, constants: Any) -> int:
    """Take neurons over grid steps, up to one at whose end any of them fires; for kernels.

    The bits are those of `advance_neuron`. A choice of values takes the place of its branches, so
    that the compiler can use vector instructions. It does so only where it knows that the arrays
    are apart, as those of `resting_lanes` are.

    Args:
        lanes: The neurons, which are changed.
        arriving_pa: As in `advance_neuron`, (n_steps, LANES).
        begin: The first grid step.
        end: The grid step to stop before.
        constants: As there.

    Returns:
        The grid step that is next.
    """
    potential, current, slope = lanes.potential_mv, lanes.current_pa, lanes.slope_pa_per_ms
    refractory, has_fired = lanes.refractory, lanes.has_fired
    reset_mv, threshold_mv = constants.reset_mv, constants.threshold_mv
    refractory_steps = constants.refractory
    for step in range(begin, end):
        any_fired = 0
        arriving = arriving_pa[step]
        for lane in range(LANES):
            before, waits = potential[lane], refractory[lane]
            after = _next_potential(before, current[lane], slope[lane], constants)
            after = before if waits > 0 else after
            current[lane], slope[lane] = _next_current(
                current[lane], slope[lane], arriving[lane], constants
            )
            fires = after >= threshold_mv
            potential[lane] = reset_mv if fires else after
            refractory[lane] = refractory_steps if fires else max(waits - 1, 0)
            has_fired[lane] = fires
            any_fired |= fires
        if any_fired:
            return step + 1
    return end


@numba.njit(cache=True, inline='always')
def _next_potential(potential: Any, current: Any, slope: Any, constants: Any) -> Any:
    """Return the potential a grid step later."""
    return (
        constants.potential_from_constant
        + constants.potential_from_slope * slope
        + constants.potential_from_current * current
        + constants.membrane * potential
        + potential
    )


@numba.njit(cache=True, inline='always')
def _next_current(current: Any, slope: Any, arriving_pa: Any, constants: Any) -> tuple[Any, Any]:
    """Return the current and its slope a grid step later."""
    return (
        constants.current_from_slope * slope + constants.synapse * current,
        constants.synapse * slope + constants.slope_from_spike * arriving_pa,
    )


def membrane_potentials(
    neurons: Neurons, arriving_pa: NDArray[np.float64], constants: Constants
) -> NDArray[np.float64]:
    """Return the potentials that a kernel took neurons through, as it does not keep them.

    Args:
        neurons: State at the window's start.
        arriving_pa: Sum of the weights of the spikes that arrived at the end of each grid step,
            (window, n_neurons).
        constants: The neurons.

    Returns:
        Membrane potentials above E_L [mV] every `SAMPLE_STEPS` grid steps, the window's end
        included, (window // SAMPLE_STEPS, n_neurons).
    """
    return np.asarray(_sample_potentials(neurons, arriving_pa, constants))


@numba.njit(cache=True)
def _sample_potentials(
    neurons: Neurons, arriving_pa: NDArray[np.float64], constants: Constants
) -> NDArray[np.float64]:
    samples = np.empty((len(arriving_pa) // SAMPLE_STEPS, len(neurons)))
    for index in range(len(neurons)):
        neuron = neurons[index]
        potential, current, slope = neuron.potential_mv, neuron.current_pa, neuron.slope_pa_per_ms
        refractory = neuron.refractory
        for step in range(len(arriving_pa)):
            potential, current, slope, refractory, _ = advance_neuron(
                potential, current, slope, refractory, arriving_pa[step, index], constants[0]
            )
            if (step + 1) % SAMPLE_STEPS == 0:
                samples[step // SAMPLE_STEPS, index] = potential
    return samples
