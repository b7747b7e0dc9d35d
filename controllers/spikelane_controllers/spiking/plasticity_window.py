"""A window of a network whose synapses learn: its arrays, and what happens in them, compiled.

`plasticity_kernel` takes a network of two neurons through a window, and `plasticity_lanes` others.
Times are grid steps since the window's start.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking.neuron import CONSTANTS_DTYPE, Neurons
from spikelane_controllers.spiking.spikes import Spikes
from spikelane_controllers.spiking.synapse_kernel import forget, hand_over, meet_all, RULE_DTYPE
from spikelane_sim.compiled import inner, uncounted
from spikelane_sim.kernel_arrays import stack_array

#: What a network is made of: its neurons, its synapses, and the length of its windows.
NETWORK_DTYPE = np.dtype(
    [('neuron', CONSTANTS_DTYPE), ('synapse', RULE_DTYPE), ('window', '<i8')]  # [grid steps]
)

#: Up to so many neurons, spikes are merged without sorting.
_FEW = 8


class Workspace(NamedTuple):
    """Arrays that a network lives in between windows and while one runs.

    Those of several robots have another axis in front, and so has each field.
    """

    neurons: Neurons
    synapses: NDArray[np.void]  # of SYNAPSE_DTYPE, (n_neurons, n_inputs)
    dopamine: NDArray[np.float64]  # n [1/ms], (n_neurons,)
    arriving_pa: NDArray[np.float64]  # at the neurons, (window + delay, n_neurons)
    # What arrived in the last window, (window, n_neurons); (0, n_neurons) where nobody asks.
    arrived_pa: NDArray[np.float64]
    # Spikes of each neuron that may still pair, in order, (n_neurons, most).
    posts: NDArray[np.void]
    flying: Spikes  # of inputs, not yet handed to the synapses
    fired: Spikes  # by the neurons in the last window
    counts: NDArray[np.int64]  # how many of each neuron's posts count, (n_neurons,)


@uncounted
def count_due(flying: Spikes, n_flying: int, network: Any) -> int:
    """Return how many of the flying spikes the synapses are given in this window."""
    rule, due = network.synapse, 0
    last = network.window - rule.interval
    while due < n_flying and flying[due].step + rule.to_relay < last:
        due += 1
    return due


@numba.njit(cache=True, inline='always')
def next_hand_over(flying: Spikes, handed: int, due: int, network: Any) -> int:
    """Return when synapses are given a spike next: at the beginning of an interval, or never.

    Args:
        flying: The spikes.
        handed: How many of them synapses have been given.
        due: How many are given in this window.
        network: A record of `NETWORK_DTYPE`.

    Returns:
        The time, and the window's end for never.
    """
    if handed == due:
        return int(network.window)
    rule = network.synapse
    return int(((flying[handed].step + rule.to_relay) // rule.interval + 1) * rule.interval)


@numba.njit(cache=True, inline='always')
def hand_over_due(
    work: Any,
    handed: int,
    due: int,
    begin: int,
    first: int,
    number: int,
    met: Any,
    rule: Any,
    tables: Any,
    arriving: Any,
) -> int:
    """Give the synapses of some neurons the relays' spikes that they are given at a time.

    Args:
        work: The workspace of one robot.
        handed: How many of the flying spikes they have been given.
        due: How many they are given in this window.
        begin: The time.
        first: The first of the neurons.
        number: How many neurons.
        met: How many of each neuron's spikes its synapses have met, (number,).
        rule: The synapses' rule.
        tables: Those of the rule.
        arriving: What arrives at these neurons, (window + delay, number).

    Returns:
        How many of the flying spikes they have been given now.
    """
    synapses, posts = work.synapses[first:], work.posts[first:]
    counts, dopamine, flying = work.counts[first:], work.dopamine[first:], work.flying
    for i in range(number):
        met[i] = meet_all(
            synapses[i], met[i], begin, posts[i], counts[i], dopamine[i], rule, tables
        )
    while handed < due and flying[handed].step + rule.to_relay < begin:
        source, stamp = flying[handed].source, flying[handed].step + rule.to_relay + 1
        for i in range(number):
            arriving[stamp - 1 + rule.delay, i] += hand_over(
                synapses[i, source],
                stamp,
                begin,
                posts[i],
                counts[i],
                dopamine[i],
                rule,
                tables,
            )
        handed += 1
    return handed


@uncounted
def end_window(
    work: Any, earlier: Any, due: int, n_flying: int, network: Any, tables: Any
) -> tuple[int, int]:
    """Let a window end for one robot, whose neurons and synapses are there.

    Returns:
        As `run` does.
    """
    rule, window, counts, flying = network.synapse, network.window, work.counts, work.flying
    n_fired = _list_fired(work.posts, earlier, counts, window, work.fired)
    for i in range(len(counts)):
        work.dopamine[i] *= tables[rule.interval + window, 1]
        counts[i] = forget(work.posts[i], counts[i], window, window - rule.delay - rule.interval)
    for k in range(due, n_flying):
        flying[k - due].step = flying[k].step - window
        flying[k - due].source = flying[k].source
    return n_flying - due, n_fired


@uncounted
def _list_fired(posts: Any, earlier: Any, counts: Any, window: int, fired: Spikes) -> int:
    """List the neurons' spikes of this window in the order of grid steps; return how many.

    Spikes of the same step are in the order of neurons.
    """
    if len(counts) > _FEW:
        return int(_sort_fired(posts, earlier, counts, window, fired))
    following, n_fired = stack_array((_FEW,), np.int64), 0
    for i in range(len(counts)):
        following[i] = earlier[i]
        n_fired += counts[i] - earlier[i]
    for k in range(n_fired):
        first = -1
        for i in range(len(counts)):
            if following[i] < counts[i] and (
                first < 0 or posts[i, following[i]].stamp < posts[first, following[first]].stamp
            ):
                first = i
        fired[k].step, fired[k].source = posts[first, following[first]].stamp - 1, first
        following[first] += 1
    return n_fired


@inner
def _sort_fired(posts: Any, earlier: Any, counts: Any, window: int, fired: Spikes) -> int:
    """List them as `_list_fired` does, by a counting sort: its time is linear."""
    place = np.zeros(window + 1, np.int64)  # of the next spike with this stamp
    for i in range(len(counts)):
        for k in range(earlier[i], counts[i]):
            place[posts[i, k].stamp] += 1
    n_fired = 0
    for stamp in range(1, window + 1):
        number = place[stamp]
        place[stamp] = n_fired
        n_fired += number
    for i in range(len(counts)):
        for k in range(earlier[i], counts[i]):
            stamp = posts[i, k].stamp
            fired[place[stamp]].step, fired[place[stamp]].source = stamp - 1, i
            place[stamp] += 1
    return n_fired
