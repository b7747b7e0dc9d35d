"""The kernel of a network whose synapses learn, compiled.

It changes the arrays of a `Workspace` in place: of the time that a window takes, making and
handing over new arrays would be half.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking.neuron import advance_neuron, LANES, Neurons
from spikelane_controllers.spiking.plasticity_lanes import as_rows, make_arriving, run_lanes
from spikelane_controllers.spiking.plasticity_window import (
    count_due,
    end_window,
    hand_over_due,
    next_hand_over,
    Workspace,
)
from spikelane_controllers.spiking.spikes import Spikes, take_up
from spikelane_controllers.spiking.synapse_kernel import begin_all, bring_all, meet_all, record
from spikelane_sim.compiled import uncounted
from spikelane_sim.kernel_arrays import borrowed, stack_array


@numba.njit(cache=True)
def run(
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
    """Run a window in a `Workspace`, whose `flying` has room for all inputs.

    After the workspace's arrays come one of `NETWORK_DTYPE` (1,), `SynapseRule.tables`, how many
    spikes are flying, and what the inputs fire.

    Returns:
        How many spikes are flying at the window's end, and how many the neurons fired.
    """
    work = borrowed(
        Workspace(
            neurons, synapses, dopamine, arriving_pa, arrived_pa, posts, flying, fired, counts
        )
    )
    network, tables, inputs = borrowed(network), borrowed(tables), borrowed(inputs)
    number, earlier = len(work.neurons), work.counts.copy()
    n_flying = take_up(work.flying, n_flying, inputs)
    due = count_due(work.flying, n_flying, network[0])
    if number == 2:
        _run_neurons(work, due, network, tables, (0, 1))
    elif number == 1:
        _run_neurons(work, due, network, tables, (0,))
    else:
        alone, dues = stack_array((1,), np.int64), stack_array((1,), np.int64)
        alone[0], dues[0] = 0, due
        arriving = make_arriving(network)
        for first in range(0, number, LANES):
            block = min(LANES, number - first)
            run_lanes(as_rows(work), alone, dues, first, block, network, tables, arriving)
    n_flying, n_fired = end_window(work, earlier, due, n_flying, network[0], tables)
    return n_flying, n_fired


@uncounted
def _run_neurons(work: Any, due: int, network: Any, tables: Any, which: Any) -> None:
    """Take one neuron or two, and their synapses, through a window.

    Args:
        work: The workspace.
        due: How many of the flying spikes the synapses are given in this window.
        network: One of `NETWORK_DTYPE`, (1,).
        tables: Those of the synapses' rule.
        which: (0,) or (0, 1). The compiler knows the length of a tuple, and makes a function
            without loops over neurons for each.
    """
    constants, rule, window = network[0].neuron, network[0].synapse, network[0].window
    synapses, posts, counts, dopamine = work.synapses, work.posts, work.counts, work.dopamine
    arriving, number, met = work.arriving_pa, len(which), stack_array((2,), np.int64)
    arriving[rule.delay :] = 0.0
    for i in range(number):
        met[i] = begin_all(synapses[i], posts[i], counts[i], rule)
    begin = handed = 0
    while begin < window:
        handed = hand_over_due(work, handed, due, begin, 0, number, met, rule, tables, arriving)
        end = next_hand_over(work.flying, handed, due, network[0])
        if number == 2:
            _drive_two(work.neurons, arriving, begin, end, constants, posts, counts, rule, tables)
        else:
            _drive(work.neurons, arriving, begin, end, constants, posts, counts, rule, tables)
        begin = end
    for i in range(number):
        meet_all(synapses[i], met[i], window, posts[i], counts[i], dopamine[i], rule, tables)
        bring_all(synapses[i], window, posts[i], counts[i], dopamine[i], rule, tables)
    for i in range(number):
        for k in range(len(work.arrived_pa)):
            work.arrived_pa[k, i] = arriving[k, i]
        for k in range(rule.delay):
            arriving[k, i] = arriving[window + k, i]


@numba.njit(cache=True, inline='always')
def _drive(
    neurons: Any,
    arriving: Any,
    begin: int,
    end: int,
    constants: Any,
    posts: Any,
    counts: Any,
    rule: Any,
    tables: Any,
) -> None:
    """Take a neuron over some grid steps, and record its spikes."""
    one = neurons[0]
    potential, current, slope = one.potential_mv, one.current_pa, one.slope_pa_per_ms
    refractory = one.refractory
    for step in range(begin, end):
        potential, current, slope, refractory, has_fired = advance_neuron(
            potential, current, slope, refractory, arriving[step, 0], constants
        )
        if has_fired:
            record(posts, counts, 0, step + 1, rule, tables)
    one.potential_mv, one.current_pa, one.slope_pa_per_ms = potential, current, slope
    one.refractory = refractory


@numba.njit(cache=True, inline='always')
def _drive_two(
    neurons: Any,
    arriving: Any,
    begin: int,
    end: int,
    constants: Any,
    posts: Any,
    counts: Any,
    rule: Any,
    tables: Any,
) -> None:
    """Take two neurons over some grid steps at the same time.

    A neuron's next step has to wait for its last one. The processor computes the other neuron in
    the meantime.
    """
    one, two = neurons[0], neurons[1]
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
            record(posts, counts, 0, step + 1, rule, tables)
        if has_fired_2:
            record(posts, counts, 1, step + 1, rule, tables)
    one.potential_mv, one.current_pa, one.slope_pa_per_ms = potential_1, current_1, slope_1
    two.potential_mv, two.current_pa, two.slope_pa_per_ms = potential_2, current_2, slope_2
    one.refractory, two.refractory = refractory_1, refractory_2
