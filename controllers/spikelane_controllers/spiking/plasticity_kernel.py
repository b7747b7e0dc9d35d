"""A network of two neurons whose synapses learn, compiled; `plasticity_lanes` has others.

It changes the arrays of a `Workspace` in place: of the time that a window takes, making and
handing over new arrays would be half. The neurons are integrated in registers, which takes half
as long for two of them as in vectors.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking.neuron import advance_neuron, Neurons
from spikelane_controllers.spiking.plasticity_window import (
    count_due,
    end_window,
    hand_over_due,
    next_hand_over,
    Workspace,
)
from spikelane_controllers.spiking.spikes import Spikes, take_up
from spikelane_controllers.spiking.synapse_kernel import begin_all, bring_all, meet_all, record
from spikelane_sim.kernel_arrays import borrowed, stack_array


@numba.njit(cache=True)
def run_two(
    neurons: Neurons,
    synapses: NDArray[np.void],
    dopamine: NDArray[np.float64],
    arriving_pa: NDArray[np.float64],
    arrived_pa: NDArray[np.float64],
    posts: NDArray[np.void],
    flying: Spikes,
    fired: Spikes,
    counts: NDArray[np.int64],
    network: NDArray[np.void],
    tables: NDArray[np.float64],
    n_flying: int,
    inputs: Spikes,
) -> tuple[int, int]:
    """Run a window of a network of two neurons in a `Workspace`.

    After the workspace's arrays come one of `NETWORK_DTYPE` (1,), `SynapseRule.tables`, how many
    spikes are flying, and what the inputs fire; `flying` has room for all of that.

    Returns:
        How many spikes are flying at the window's end, and how many the neurons fired.
    """
    work = borrowed(
        Workspace(
            neurons, synapses, dopamine, arriving_pa, arrived_pa, posts, flying, fired, counts
        )
    )
    network, tables, inputs = borrowed(network), borrowed(tables), borrowed(inputs)
    constants, rule, window = network[0].neuron, network[0].synapse, network[0].window
    arriving, earlier, met = work.arriving_pa, work.counts.copy(), stack_array((2,), np.int64)
    n_flying = take_up(work.flying, n_flying, inputs)
    due = count_due(work.flying, n_flying, network[0])
    arriving[rule.delay :] = 0.0
    for i in range(2):
        met[i] = begin_all(work.synapses[i], work.posts[i], work.counts[i], rule)
    begin = handed = 0
    while begin < window:
        handed = hand_over_due(work, handed, due, begin, 0, 2, met, rule, tables, arriving)
        end = next_hand_over(work.flying, handed, due, network[0])
        _drive_two(work, arriving, begin, end, constants, rule, tables)
        begin = end
    for i in range(2):
        synapses, posts, count = work.synapses[i], work.posts[i], work.counts[i]
        meet_all(synapses, met[i], window, posts, count, work.dopamine[i], rule, tables)
        bring_all(synapses, window, posts, count, work.dopamine[i], rule, tables)
        for k in range(len(work.arrived_pa)):
            work.arrived_pa[k, i] = arriving[k, i]
        for k in range(rule.delay):
            arriving[k, i] = arriving[window + k, i]
    n_flying, n_fired = end_window(work, earlier, due, n_flying, network[0], tables)
    return n_flying, n_fired


@numba.njit(cache=True, inline='always')
def _drive_two(
    work: Any, arriving: Any, begin: int, end: int, constants: Any, rule: Any, tables: Any
) -> None:
    """Take two neurons over some grid steps at the same time.

    A neuron's next step has to wait for its last one. The processor computes the other neuron in
    the meantime.
    """
    one, two = work.neurons[0], work.neurons[1]
    potential_1, current_1, slope_1 = one.potential_mv, one.current_pa, one.slope_pa_per_ms
    potential_2, current_2, slope_2 = two.potential_mv, two.current_pa, two.slope_pa_per_ms
    refractory_1, refractory_2 = one.refractory, two.refractory
    for step in range(begin, end):
        potential_1, current_1, slope_1, refractory_1, has_fired_1 = advance_neuron(
            potential_1, current_1, slope_1, refractory_1, arriving[step, 0], constants
        )
        potential_2, current_2, slope_2, refractory_2, has_fired_2 = advance_neuron(
            potential_2, current_2, slope_2, refractory_2, arriving[step, 1], constants
        )
        if has_fired_1:
            record(work.posts, work.counts, 0, step + 1, rule, tables)
        if has_fired_2:
            record(work.posts, work.counts, 1, step + 1, rule, tables)
    one.potential_mv, one.current_pa, one.slope_pa_per_ms = potential_1, current_1, slope_1
    two.potential_mv, two.current_pa, two.slope_pa_per_ms = potential_2, current_2, slope_2
    one.refractory, two.refractory = refractory_1, refractory_2
