"""Synapses that learn by reward: dopamine-modulated spike-timing-dependent plasticity.

The model is NEST's stdp_dopamine_synapse (Potjans, Morrison & Diesmann 2010, Frontiers in
Computational Neuroscience 4:141), the paper's R-STDP rule (section 4.1), without a baseline of
dopamine. Each synapse has a weight w and an eligibility trace c; dopamine n is given per neuron:

    dc/dt = -c / tau_c  + A_plus K_plus  when a spike of the neuron reaches the synapse
                        - A_minus K_minus  when the relay spikes,
    dn/dt = -n / tau_n,    dw/dt = c n,    w_min <= w <= w_max,

where K_plus and K_minus grow by 1 with each spike of the relay or the neuron and decay with
tau_plus or tau_minus. A relay's spike takes a delay to the neuron, and a neuron's spike as long
back to the synapse (NEST: all of the delay is dendritic). Simultaneous spikes do not pair.

Between spikes the solution is exact and is evaluated at spikes only. Spikes have stamps, the grid
step at whose end they are, counted from the window's start: a spike "in" step k has stamp k + 1.

NEST's bookkeeping. NEST brings every synapse up to date at the end of each interval of 1 ms (the
shortest delay of the network), and hands a relay's spikes to the synapses only then. A synapse
whose relay spiked at t is taken from the interval's end back to t, where the weight is read and
the eligibility lowered, and then forward again. On its second way it meets the neuron's spikes
between t and the interval's end once more, which add to the eligibility a second time. The
paper's results come from this model, so it is the default; with an interval of one grid step the
equations above are solved as they stand.

The interval is NEST's own where it is the shortest delay of the network. The weights are NEST's
only where a neuron fires at most once in an interval: its refractory period and a grid step last
at least as long. With 0.6 ms and an interval of 1 ms, weights differ by up to 23 pA after 5 s.

Dopamine is set between windows, when all synapses have been brought to the boundary. So it acts
from there on; the relays' spikes of the last interval before, handed over after it, see dopamine
as if it had been the new one's decay all along.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking.network import DelayParameters
from spikelane_controllers.spiking.spikes import GRID_MS, GRID_STEPS, grid_steps
from spikelane_controllers.spiking.synapse_kernel import RULE_DTYPE
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import parameter, Parameters

_TABLE = 'table "Simulation parameters specification"'


@dataclasses.dataclass(frozen=True, kw_only=True)
class SynapseParameters(Parameters):
    """NEST's parameters of stdp_dopamine_synapse; its baseline b is 0."""

    a_plus: float = parameter(
        1.0,
        'Eligibility added when the neuron spikes after the relay.',
        low=0.0,
        high=1e6,
        source=_TABLE,
    )
    a_minus: float = parameter(
        1.0,
        'Eligibility subtracted when the relay spikes after the neuron.',
        low=0.0,
        high=1e6,
        source=_TABLE,
    )
    tau_plus_ms: float = parameter(
        20.0,
        "Time constant of the relay's trace K_plus.",
        unit='ms',
        low=GRID_MS,
        high=1e6,
        source=_TABLE,
    )
    tau_minus_ms: float = parameter(
        20.0,
        "Time constant of the neuron's trace K_minus; the default is NEST's.",
        unit='ms',
        low=GRID_MS,
        high=1e6,
    )
    tau_c_ms: float = parameter(
        1000.0,
        'Time constant of the eligibility trace.',
        unit='ms',
        low=GRID_MS,
        high=1e6,
        source=_TABLE,
    )
    tau_n_ms: float = parameter(
        200.0, 'Time constant of dopamine.', unit='ms', low=GRID_MS, high=1e6, source=_TABLE
    )
    w_min_pa: float = parameter(
        0.0,
        'Smallest weight that learning can reach.',
        unit='pA',
        low=-1e6,
        high=1e6,
        source=_TABLE,
    )
    w_max_pa: float = parameter(
        3000.0,
        'Largest weight that learning can reach.',
        unit='pA',
        low=-1e6,
        high=1e6,
        source=_TABLE,
    )
    interval_ms: float = parameter(
        1.0,
        "Interval at which NEST's bookkeeping brings the synapses up to date; 0.1: the "
        'equations in continuous time.',
        unit='ms',
        low=GRID_MS,
        high=1e4,
    )

    def _check_relations(self) -> None:
        if self.w_max_pa < self.w_min_pa:
            raise ParameterError(
                f'w_max_pa: expected at least w_min_pa = {self.w_min_pa:g} pA, '
                f'got {self.w_max_pa:g}'
            )
        interval = grid_steps('interval_ms', self.interval_ms)
        if GRID_STEPS % interval:
            raise ParameterError(
                f'interval_ms: expected a divisor of {GRID_STEPS * GRID_MS:g} ms, '
                f'got {self.interval_ms:g}'
            )


class SynapseRule(NamedTuple):
    """What takes synapses from spike to spike; made by `synapse_rule`."""

    scalars: NDArray[np.void]  # of RULE_DTYPE, (1,)
    # Per number k of grid steps from -interval to the longest window plus interval: what decays
    # in them of c, n and K_plus, the integral of exp(-t / tau_c - t / tau_n) [ms], and what decays
    # of K_minus. (n, 5)
    tables: NDArray[np.float64]


def synapse_rule(
    synapse: SynapseParameters, delays: DelayParameters, window: int = GRID_STEPS
) -> SynapseRule:
    """Solve the synapses' equations for every number of grid steps in a window.

    Args:
        synapse: The synapses.
        delays: From the inputs to the relays, from these to the neurons.
        window: Length of the longest window to come [grid steps].

    Raises:
        ParameterError: interval_ms is longer than the delay from relay to neuron, or does not
            divide the window.
    """
    interval = grid_steps('interval_ms', synapse.interval_ms)
    delay = grid_steps('to_neuron_ms', delays.to_neuron_ms)
    if interval > delay:
        raise ParameterError(
            f'interval_ms: expected at most the delay to_neuron_ms = {delays.to_neuron_ms:g} ms, '
            f'got {synapse.interval_ms:g}'
        )
    if window % interval:
        raise ParameterError(
            f'synapse.interval_ms: expected a divisor of {window * GRID_MS:g} ms, the control '
            f'period, got {synapse.interval_ms:g}'
        )
    scalars = np.zeros(1, RULE_DTYPE)
    scalars['a_plus'], scalars['a_minus'] = synapse.a_plus, synapse.a_minus
    scalars['minus_rate'] = GRID_MS / synapse.tau_minus_ms
    scalars['w_min'], scalars['w_max'] = synapse.w_min_pa, synapse.w_max_pa
    scalars['to_relay'] = grid_steps('to_relay_ms', delays.to_relay_ms)
    scalars['delay'], scalars['interval'] = delay, interval
    steps = np.arange(-interval, window + interval + 1)
    t_ms = steps * GRID_MS
    rate = 1 / synapse.tau_c_ms + 1 / synapse.tau_n_ms
    tables = np.stack(
        [
            np.exp(-t_ms / synapse.tau_c_ms),
            np.exp(-t_ms / synapse.tau_n_ms),
            np.exp(-t_ms / synapse.tau_plus_ms),
            -np.expm1(-rate * t_ms) / rate,
            # The same bits as `exp` in the kernel, which computes longer times itself.
            [math.exp(-k * scalars['minus_rate'].item()) for k in steps.tolist()],
        ],
        axis=1,
    )
    return SynapseRule(scalars, tables)
