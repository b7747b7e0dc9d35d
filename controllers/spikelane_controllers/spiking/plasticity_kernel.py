"""The kernel of the learning synapses, compiled; `plasticity` says what it solves.

It changes the arrays of a `Workspace` in place: of the time that a window takes, making and
handing over new arrays would be half.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking.neuron import advance_neuron, CONSTANTS_DTYPE, Neurons
from spikelane_controllers.spiking.spikes import Spikes
from spikelane_sim.compiled import inner
from spikelane_sim.kernel_arrays import borrowed, stack_array

#: A neuron's spike as its synapses remember it: stamp, neuron, K_minus just after it.
POST_DTYPE = np.dtype([('stamp', '<i8'), ('source', '<i8'), ('k_minus', '<f8')])

#: A synapse: weight, eligibility, K_plus; the time to which it is brought, the index of the
#: neuron's first spike that it has not met, and when it was last given spikes of its relay.
SYNAPSE_DTYPE = np.dtype(
    [
        ('weight_pa', '<f8'),
        ('eligibility', '<f8'),
        ('k_plus', '<f8'),
        ('time', '<i8'),
        ('next_post', '<i8'),
        ('given', '<i8'),
    ]
)

#: What synapses have in common, made by `synapse.synapse_rule`.
RULE_DTYPE = np.dtype(
    [
        ('a_plus', '<f8'),
        ('a_minus', '<f8'),
        ('minus_rate', '<f8'),  # 1 / tau_minus [1/grid step]
        ('w_min', '<f8'),
        ('w_max', '<f8'),
        ('to_relay', '<i8'),  # [grid steps]
        ('delay', '<i8'),  # from a relay to a neuron [grid steps]
        ('interval', '<i8'),  # [grid steps]
    ]
)

#: What a network is made of: its neurons, its synapses, and the length of its windows.
NETWORK_DTYPE = np.dtype(
    [('neuron', CONSTANTS_DTYPE), ('synapse', RULE_DTYPE), ('window', '<i8')]  # [grid steps]
)

#: Up to so many neurons, spikes are merged without sorting.
_FEW = 8
#: exp(-x) is 0 for x from here on.
_NOTHING_REMAINS = 746.0

Posts = NDArray[np.void]  # of POST_DTYPE, in the order of stamps, (n_spikes,)


class Workspace(NamedTuple):
    """Arrays that a network lives in between windows and while one runs."""

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


@inner
def _pass(synapse: Any, at: int, dopamine: float, rule: Any, tables: Any) -> None:
    """Take a synapse to a time, also an earlier one, that no spike comes before."""
    zero, time, c = rule.interval, synapse.time, synapse.eligibility
    index = zero + at - time  # of the time that passes; zero is the index of none
    weight = synapse.weight_pa + c * dopamine * tables[zero + time, 1] * tables[index, 3]
    synapse.weight_pa = min(max(weight, rule.w_min), rule.w_max)
    synapse.eligibility = c * tables[index, 0]
    synapse.k_plus *= tables[index, 2]
    synapse.time = at


@inner
def _meet(synapse: Any, posts: Any, dopamine: float, rule: Any, tables: Any) -> None:
    """Take a synapse to the next spike of its neuron."""
    _pass(synapse, posts[synapse.next_post].stamp + rule.delay, dopamine, rule, tables)
    synapse.eligibility += rule.a_plus * synapse.k_plus
    synapse.next_post += 1


@inner
def _bring(
    synapse: Any, to: int, posts: Any, count: int, dopamine: float, rule: Any, tables: Any
) -> None:
    """Take a synapse to a time, also an earlier one, by way of the spikes that reach it."""
    while synapse.time != to:
        k = synapse.next_post
        if k < count and posts[k].stamp + rule.delay <= to:
            _meet(synapse, posts, dopamine, rule, tables)
        else:
            _pass(synapse, to, dopamine, rule, tables)
    while synapse.next_post > 0 and posts[synapse.next_post - 1].stamp + rule.delay > to:
        synapse.next_post -= 1  # taken back before a spike, the synapse will meet it again


@numba.njit(cache=True, inline='always')
def _meet_all(
    synapses: Any,
    met: int,
    to: int,
    posts: Any,
    count: int,
    dopamine: float,
    rule: Any,
    tables: Any,
) -> int:
    """Take all synapses of a neuron to its spikes that reach them up to a time.

    It makes no difference to the bits when they are taken there, but spike by spike is quicker
    than synapse by synapse, as synapses do not wait for each other.

    Returns:
        How many of the spikes are met, `met` before.
    """
    while met < count and posts[met].stamp + rule.delay <= to:
        for j in range(len(synapses)):
            while synapses[j].next_post <= met:
                _meet(synapses[j], posts, dopamine, rule, tables)
        met += 1
    return met


@inner
def _k_minus(posts: Any, count: int, time: int, rule: Any, tables: Any) -> float:
    """Return the neuron's trace just before a spike at a time."""
    k = count - 1
    while k >= 0 and posts[k].stamp >= time:
        k -= 1
    if k < 0:
        return 0.0
    trace: float = posts[k].k_minus
    passed = time - posts[k].stamp
    if rule.interval + passed < len(tables):
        return trace * float(tables[rule.interval + passed, 4])
    # A neuron's last spike can be hours ago. The C library is slow where exp is 0.
    past = passed * rule.minus_rate
    return trace * math.exp(-past) if past < _NOTHING_REMAINS else 0.0


@inner
def _forget(posts: Any, count: int, window: int, since: int) -> int:
    """Keep what the next window must remember: spikes after `since`, and the last before.

    Returns:
        How many are kept; their stamps count from the window's end.
    """
    kept = 0
    for k in range(count):
        if posts[k].stamp > since or k + 1 == count or posts[k + 1].stamp > since:
            posts[kept].stamp = posts[k].stamp - window
            posts[kept].k_minus = posts[k].k_minus
            kept += 1
    return kept


@numba.njit(cache=True, inline='always')
def _hand_over(
    synapse: Any,
    stamp: int,
    now: int,
    posts: Any,
    count: int,
    dopamine: float,
    rule: Any,
    tables: Any,
) -> float:
    """Give a relay's spike to its synapse, at the end of the interval it lies in.

    Returns:
        The weight that the spike takes to the neuron.
    """
    if synapse.given != now:  # the first of this interval
        synapse.given = now
        _bring(synapse, now, posts, count, dopamine, rule, tables)
    _bring(synapse, stamp, posts, count, dopamine, rule, tables)
    k_minus = _k_minus(posts, count, stamp - rule.delay, rule, tables)
    synapse.eligibility -= rule.a_minus * k_minus
    synapse.k_plus += 1.0
    weight_pa: float = synapse.weight_pa
    return weight_pa


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
            _record(posts, counts, 0, step + 1, rule, tables)
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
            _record(posts, counts, 0, step + 1, rule, tables)
        if has_fired_2:
            _record(posts, counts, 1, step + 1, rule, tables)
    one.potential_mv, one.current_pa, one.slope_pa_per_ms = potential_1, current_1, slope_1
    two.potential_mv, two.current_pa, two.slope_pa_per_ms = potential_2, current_2, slope_2
    one.refractory, two.refractory = refractory_1, refractory_2


@inner
def _record(posts: Any, counts: Any, i: int, stamp: int, rule: Any, tables: Any) -> None:
    """Record a spike of a neuron."""
    count = counts[i]
    posts[i, count].k_minus = _k_minus(posts[i], count, stamp, rule, tables) + 1.0
    posts[i, count].stamp = stamp
    counts[i] = count + 1


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
    neurons, synapses, dopamine = borrowed(neurons), borrowed(synapses), borrowed(dopamine)
    arriving_pa, arrived_pa = borrowed(arriving_pa), borrowed(arrived_pa)
    posts, flying, fired = borrowed(posts), borrowed(flying), borrowed(fired)
    counts, network, tables = borrowed(counts), borrowed(network), borrowed(tables)
    inputs = borrowed(inputs)
    constants, rule, window = network[0].neuron, network[0].synapse, network[0].window
    number = len(neurons)
    earlier = counts.copy()
    for k in range(len(inputs)):
        flying[n_flying + k] = inputs[k]
    n_flying += len(inputs)
    handed = 0
    while handed < n_flying and flying[handed].step + rule.to_relay < window - rule.interval:
        handed += 1
    arriving_pa[rule.delay : window + rule.delay] = 0.0
    most = flying[:handed], arriving_pa, dopamine, constants, rule, tables, window
    for i in range(0, number - 1, 2):
        _run_neurons(neurons, synapses, posts, counts, *most, i, (0, 1))
    if number % 2:
        _run_neurons(neurons, synapses, posts, counts, *most, number - 1, (0,))
    n_fired = _list_fired(posts, earlier, counts, window, fired)
    for i in range(number):
        dopamine[i] *= tables[rule.interval + window, 1]
        counts[i] = _forget(posts[i], counts[i], window, window - rule.delay - rule.interval)
    for k in range(len(arrived_pa)):
        arrived_pa[k] = arriving_pa[k]
    for k in range(rule.delay):
        arriving_pa[k] = arriving_pa[window + k]
    for k in range(handed, n_flying):
        flying[k - handed].step = flying[k].step - window
        flying[k - handed].source = flying[k].source
    return n_flying - handed, n_fired


@inner
def _run_neurons(
    neurons: Any,
    synapses: Any,
    posts: Any,
    counts: Any,
    spikes: Any,
    arriving: Any,
    dopamine: Any,
    constants: Any,
    rule: Any,
    tables: Any,
    window: int,
    first: int,
    which: Any,
) -> None:
    """Take one neuron or two, and their synapses, through a window.

    Args:
        neurons: All neurons; this and what follows as in `run`.
        synapses: All synapses.
        posts: Spikes that each neuron remembers.
        counts: How many spikes each neuron remembers.
        spikes: Spikes of the inputs that the synapses are given in this window.
        arriving: What arrives at the neurons.
        dopamine: At each neuron's synapses.
        constants: The neurons' constants.
        rule: The synapses' rule.
        tables: Those of the rule.
        window: Length of the window.
        first: The first of the neurons.
        which: (0,) for that one, (0, 1) for the next one as well. The compiler knows the length of
            a tuple, and makes a function without loops over neurons for each.
    """
    neurons, synapses, posts = neurons[first:], synapses[first:], posts[first:]
    counts, arriving, dopamine = counts[first:], arriving[:, first:], dopamine[first:]
    number, met = len(which), stack_array((2,), np.int64)
    for i in range(number):
        met[i] = 0
        while met[i] < counts[i] and posts[i, met[i]].stamp + rule.delay <= 0:
            met[i] += 1
        for j in range(synapses.shape[1]):
            synapse = synapses[i, j]
            synapse.time, synapse.next_post, synapse.given = 0, met[i], -1
    handed = 0
    for begin in range(0, window, rule.interval):
        for i in range(number):
            met[i] = _meet_all(
                synapses[i], met[i], begin, posts[i], counts[i], dopamine[i], rule, tables
            )
        while handed < len(spikes) and spikes[handed].step + rule.to_relay < begin:
            source, stamp = spikes[handed].source, spikes[handed].step + rule.to_relay + 1
            for i in range(number):
                arriving[stamp - 1 + rule.delay, i] += _hand_over(
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
        end = begin + rule.interval
        if number == 2:
            _drive_two(neurons, arriving, begin, end, constants, posts, counts, rule, tables)
        else:
            _drive(neurons, arriving, begin, end, constants, posts, counts, rule, tables)
    for i in range(number):
        _meet_all(synapses[i], met[i], window, posts[i], counts[i], dopamine[i], rule, tables)
        for j in range(synapses.shape[1]):
            _bring(synapses[i, j], window, posts[i], counts[i], dopamine[i], rule, tables)


@inner
def _list_fired(posts: Any, earlier: Any, counts: Any, window: int, fired: Spikes) -> int:
    """List the neurons' spikes of this window in the order of grid steps; return how many.

    Spikes of the same step are in the order of neurons.
    """
    if len(counts) > _FEW:
        return int(_sort_fired(posts, earlier, counts, window, fired))
    following = earlier.copy()
    n_fired: int = (counts - earlier).sum()
    for k in range(n_fired):
        first = -1
        for i in range(len(following)):
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
