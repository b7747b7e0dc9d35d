"""Networks whose synapses learn: of any number of neurons, and of several robots, compiled.

A neuron's next grid step has to wait for its last one, which takes longer than to compute the same
step of 16 neurons with vector instructions. The bits are those of `plasticity_kernel`.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking.neuron import (
    advance_neurons,
    LANES,
    Neurons,
    put_in_lane,
    resting_lanes,
    take_from_lane,
)
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
def run_many(
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
    """Run a window of a network of any number of neurons; see `plasticity_kernel.run_two`."""
    work = borrowed(
        Workspace(
            neurons, synapses, dopamine, arriving_pa, arrived_pa, posts, flying, fired, counts
        )
    )
    network, tables, inputs = borrowed(network), borrowed(tables), borrowed(inputs)
    alone, due = stack_array((1,), np.int64), stack_array((1,), np.int64)
    number, earlier, arriving = len(work.neurons), work.counts.copy(), make_arriving(network)
    n_flying = take_up(work.flying, n_flying, inputs)
    alone[0], due[0] = 0, count_due(work.flying, n_flying, network[0])
    for first in range(0, number, LANES):
        block = min(LANES, number - first)
        _run_lanes(_as_rows(work), alone, due, first, block, network, tables, arriving)
    n_flying, n_fired = end_window(work, earlier, due[0], n_flying, network[0], tables)
    return n_flying, n_fired


@uncounted
def run_several(
    work: Any,
    n_flying: NDArray[np.int64],
    n_fired: NDArray[np.int64],
    members: NDArray[np.int64],
    network: NDArray[np.void],
    tables: NDArray[np.float64],
    arriving: NDArray[np.float64],
) -> None:
    """Run a window of the networks of several robots at the same time; see `run_two`.

    Args:
        work: A `Workspace` with a row for each robot.
        n_flying: How many spikes of each row are flying, those that the inputs fire included.
        n_fired: How many the neurons of each row fired is written here.
        members: The rows, together of at most `LANES` neurons.
        network: One of `NETWORK_DTYPE`, (1,).
        tables: `SynapseRule.tables`.
        arriving: From `make_arriving`.
    """
    number = work.neurons.shape[1]
    due, earlier = stack_array((LANES,), np.int64), stack_array((LANES,), np.int64)
    for m in range(len(members)):
        row = members[m]
        due[m] = count_due(work.flying[row], n_flying[row], network[0])
        for i in range(number):
            earlier[m * number + i] = work.counts[row, i]
    _run_lanes(work, members, due, 0, number, network, tables, arriving)
    for m in range(len(members)):
        row, before = members[m], earlier[m * number : (m + 1) * number]
        n_flying[row], n_fired[row] = end_window(
            _row(work, row), before, due[m], n_flying[row], network[0], tables
        )


@numba.njit(cache=True, inline='always')
def make_arriving(network: NDArray[np.void]) -> NDArray[np.float64]:
    """Return room for what arrives at `LANES` neurons [pA], (window + delay, LANES)."""
    return np.empty((network[0].window + network[0].synapse.delay, LANES))


@numba.njit(cache=True, inline='always')
def _row(work: Any, row: int) -> Any:
    """Return the workspace of one robot of several."""
    return Workspace(
        work.neurons[row],
        work.synapses[row],
        work.dopamine[row],
        work.arriving_pa[row],
        work.arrived_pa[row],
        work.posts[row],
        work.flying[row],
        work.fired[row],
        work.counts[row],
    )


@numba.njit(cache=True, inline='always')
def _as_rows(work: Any) -> Any:
    """Return the workspace of one robot as that of several, of which there is one."""
    return Workspace(
        work.neurons.reshape((1, *work.neurons.shape)),
        work.synapses.reshape((1, *work.synapses.shape)),
        work.dopamine.reshape((1, *work.dopamine.shape)),
        work.arriving_pa.reshape((1, *work.arriving_pa.shape)),
        work.arrived_pa.reshape((1, *work.arrived_pa.shape)),
        work.posts.reshape((1, *work.posts.shape)),
        work.flying.reshape((1, *work.flying.shape)),
        work.fired.reshape((1, *work.fired.shape)),
        work.counts.reshape((1, *work.counts.shape)),
    )


@uncounted
def _run_lanes(
    work: Any,
    members: Any,
    due: Any,
    first: int,
    number: int,
    network: Any,
    tables: Any,
    arriving: Any,
) -> None:
    """Take up to `LANES` neurons, and their synapses, through a window at the same time.

    Neuron first + i of member m is in lane m * number + i.

    Args:
        work: A `Workspace` with a row for each robot.
        members: Rows of `work`.
        due: How many of the flying spikes of each member the synapses are given in this window.
        first: The first of each member's neurons.
        number: How many neurons of each member.
        network: One of `NETWORK_DTYPE`, (1,).
        tables: Those of the synapses' rule.
        arriving: Is overwritten, (window + delay, LANES).
    """
    constants, rule, window = network[0].neuron, network[0].synapse, network[0].window
    lanes = resting_lanes()
    met = stack_array((LANES,), np.int64)
    handed, following = stack_array((LANES,), np.int64), stack_array((LANES,), np.int64)
    arriving[:] = 0.0
    for m in range(len(members)):
        row, handed[m] = members[m], 0
        following[m] = next_hand_over(work.flying[row], 0, due[m], network[0])
        for i in range(number):
            lane, index = m * number + i, first + i
            neuron, posts = work.neurons[row, index], work.posts[row, index]
            put_in_lane(neuron, lanes, lane)
            met[lane] = begin_all(work.synapses[row, index], posts, work.counts[row, index], rule)
            for k in range(rule.delay):
                arriving[k, lane] = work.arriving_pa[row, k, index]
    begin = 0
    while begin < window:
        end = window
        for m in range(len(members)):
            if following[m] <= begin:
                lane = m * number
                handed[m] = hand_over_due(
                    _row(work, members[m]),
                    handed[m],
                    due[m],
                    begin,
                    first,
                    number,
                    met[lane:],
                    rule,
                    tables,
                    arriving[:, lane:],
                )
                following[m] = next_hand_over(
                    work.flying[members[m]], handed[m], due[m], network[0]
                )
            end = min(end, following[m])
        while begin < end:
            begin = advance_neurons(lanes, arriving, begin, end, constants)
            for lane in range(len(members) * number):
                if lanes.has_fired[lane]:
                    row, index = members[lane // number], first + lane % number
                    record(work.posts[row], work.counts[row], index, begin, rule, tables)
    for m in range(len(members)):
        for i in range(number):
            lane = m * number + i
            take_from_lane(work.neurons[members[m], first + i], lanes, lane)
            _end_neuron(
                work, members[m], first + i, met[lane], window, rule, tables, arriving[:, lane]
            )


@numba.njit(cache=True, inline='always')
def _end_neuron(
    work: Any,
    row: int,
    index: int,
    met: int,
    window: int,
    rule: Any,
    tables: Any,
    arriving: Any,
) -> None:
    """Take the synapses of a neuron to the window's end, and keep what arrives after it.

    Args:
        work: A `Workspace` with a row for each robot.
        row: Which robot.
        index: Which neuron.
        met: How many of its spikes its synapses have met.
        window: Length of the window.
        rule: The synapses' rule.
        tables: Those of the rule.
        arriving: What arrives at the neuron, (window + delay,).
    """
    synapses, posts = work.synapses[row, index], work.posts[row, index]
    count, dopamine = work.counts[row, index], work.dopamine[row, index]
    meet_all(synapses, met, window, posts, count, dopamine, rule, tables)
    bring_all(synapses, window, posts, count, dopamine, rule, tables)
    for k in range(work.arrived_pa.shape[1]):
        work.arrived_pa[row, k, index] = arriving[k]
    for k in range(rule.delay):
        work.arriving_pa[row, k, index] = arriving[window + k]
