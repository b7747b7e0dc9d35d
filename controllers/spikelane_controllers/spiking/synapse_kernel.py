"""One synapse that learns, compiled: what happens to it between spikes and at them.

`synapse` says what is solved. Times are grid steps since the window's start.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.compiled import uncounted

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

#: exp(-x) is 0 for x from here on.
_NOTHING_REMAINS = 746.0

Posts = NDArray[np.void]  # of POST_DTYPE, in the order of stamps, (n_spikes,)


@numba.njit(cache=True, inline='always')
def _factors(time: int, at: int, rule: Any, tables: Any) -> tuple[float, float, float, float]:
    """Return what `_pass_by` multiplies with: of the dopamine, the weight and both traces."""
    index = rule.interval + at - time  # of the time that passes; the interval is the index of none
    return (
        tables[rule.interval + time, 1],
        tables[index, 3],
        tables[index, 0],
        tables[index, 2],
    )


@numba.njit(cache=True, inline='always')
def _pass_by(synapse: Any, at: int, dopamine: float, rule: Any, factors: Any) -> None:
    """Take a synapse to a time that no spike comes before, by the factors of its way there."""
    of_dopamine, of_weight, of_eligibility, of_k_plus = factors
    c = synapse.eligibility
    weight = synapse.weight_pa + c * dopamine * of_dopamine * of_weight
    synapse.weight_pa = min(max(weight, rule.w_min), rule.w_max)
    synapse.eligibility = c * of_eligibility
    synapse.k_plus *= of_k_plus
    synapse.time = at


@uncounted
def _pass(synapse: Any, at: int, dopamine: float, rule: Any, tables: Any) -> None:
    """Take a synapse to a time, also an earlier one, that no spike comes before."""
    _pass_by(synapse, at, dopamine, rule, _factors(synapse.time, at, rule, tables))


@numba.njit(cache=True, inline='always')
def _pair(synapse: Any, rule: Any) -> None:
    """Let a synapse meet a spike of its neuron."""
    synapse.eligibility += rule.a_plus * synapse.k_plus
    synapse.next_post += 1


@uncounted
def _meet(synapse: Any, posts: Any, dopamine: float, rule: Any, tables: Any) -> None:
    """Take a synapse to the next spike of its neuron."""
    _pass(synapse, posts[synapse.next_post].stamp + rule.delay, dopamine, rule, tables)
    _pair(synapse, rule)


@uncounted
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
def begin_all(synapses: Any, posts: Any, count: int, rule: Any) -> int:
    """Let a window begin for all synapses of a neuron; return how many of its spikes are met."""
    met = 0
    while met < count and posts[met].stamp + rule.delay <= 0:
        met += 1
    for j in range(len(synapses)):
        synapses[j].time, synapses[j].next_post, synapses[j].given = 0, met, -1
    return met


@numba.njit(cache=True, inline='always')
def bring_all(
    synapses: Any, to: int, posts: Any, count: int, dopamine: float, rule: Any, tables: Any
) -> None:
    """Take all synapses of a neuron to a time; see `_bring`.

    Most of them are at the same time and meet no spike on the way: for these the factors are read
    once.
    """
    time = synapses[0].time
    factors = _factors(time, to, rule, tables)
    for j in range(len(synapses)):
        if synapses[j].time == time and synapses[j].next_post == count:
            _pass_by(synapses[j], to, dopamine, rule, factors)
        else:
            _bring(synapses[j], to, posts, count, dopamine, rule, tables)


@numba.njit(cache=True, inline='always')
def meet_all(
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
        time, at = synapses[0].time, posts[met].stamp + rule.delay
        factors = _factors(time, at, rule, tables)
        for j in range(len(synapses)):
            synapse = synapses[j]
            if synapse.time == time and synapse.next_post == met:
                _pass_by(synapse, at, dopamine, rule, factors)
                _pair(synapse, rule)
            else:
                while synapse.next_post <= met:
                    _meet(synapse, posts, dopamine, rule, tables)
        met += 1
    return met


@uncounted
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


@uncounted
def forget(posts: Any, count: int, window: int, since: int) -> int:
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
def hand_over(
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


@uncounted
def record(posts: Any, counts: Any, i: int, stamp: int, rule: Any, tables: Any) -> None:
    """Record a spike of a neuron."""
    count = counts[i]
    posts[i, count].k_minus = _k_minus(posts[i], count, stamp, rule, tables) + 1.0
    posts[i, count].stamp = stamp
    counts[i] = count + 1
