"""The kernel of the learning synapses, compiled; `plasticity` says what it solves."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking import (
    advance,
    Constants,
    keep_flying,
    merge_spikes,
    Neurons,
    SPIKE_DTYPE,
    Spikes,
)

#: A neuron's spike as its synapses remember it: stamp, neuron, K_minus just after it.
POST_DTYPE = np.dtype([('stamp', '<i8'), ('source', '<i8'), ('k_minus', '<f8')])

#: What synapses have in common, made by `plasticity.synapse_rule`.
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

Posts = NDArray[np.void]  # of POST_DTYPE, in the order of stamps, (n_spikes,)


class _Synapses(NamedTuple):
    """Synapses on their way through a window; all arrays (n_neurons, n_inputs)."""

    weight: Any
    eligibility: Any
    k_plus: Any
    time: Any  # to which they are brought up
    next_post: Any  # index of the neuron's first spike that they have not met


class _PostSpikes(NamedTuple):
    """Spikes of each neuron."""

    stamp: Any  # (n_neurons, most)
    k_minus: Any  # just after the spike, (n_neurons, most)
    count: Any  # (n_neurons,)


@numba.njit(cache=True)
def _bring(
    synapses: Any, i: int, j: int, to: int, posts: Any, dopamine: float, scalars: Any, tables: Any
) -> None:
    """Take a synapse to a time, also an earlier one, by way of the spikes that reach it."""
    weight, time = synapses.weight[i, j], synapses.time[i, j]
    c, k_plus = synapses.eligibility[i, j], synapses.k_plus[i, j]
    k, zero = synapses.next_post[i, j], scalars.interval  # index of 0 in the tables
    while time != to:
        is_spike = k < posts.count[i] and posts.stamp[i, k] + scalars.delay <= to
        at = posts.stamp[i, k] + scalars.delay if is_spike else to
        index = zero + at - time
        weight += c * dopamine * tables[zero + time, 1] * tables[index, 3]
        weight = min(max(weight, scalars.w_min), scalars.w_max)
        c *= tables[index, 0]
        k_plus *= tables[index, 2]
        time = at
        if is_spike:
            c += scalars.a_plus * k_plus
            k += 1
    while k > 0 and posts.stamp[i, k - 1] + scalars.delay > to:
        k -= 1  # taken back before a spike, the synapse will meet it again
    synapses.weight[i, j], synapses.time[i, j] = weight, time
    synapses.eligibility[i, j], synapses.k_plus[i, j] = c, k_plus
    synapses.next_post[i, j] = k


@numba.njit(cache=True)
def _k_minus(posts: Any, i: int, time: int, rate: float) -> float:
    """Return the neuron's trace just before a spike at a time."""
    k = posts.count[i] - 1
    while k >= 0 and posts.stamp[i, k] >= time:
        k -= 1
    return posts.k_minus[i, k] * math.exp((posts.stamp[i, k] - time) * rate) if k >= 0 else 0.0


@numba.njit(cache=True)
def _add_post(posts: Any, i: int, stamp: int, rate: float) -> None:
    """Record a spike of a neuron."""
    k = posts.count[i]
    posts.k_minus[i, k] = _k_minus(posts, i, stamp, rate) + 1.0
    posts.stamp[i, k] = stamp
    posts.count[i] = k + 1


@numba.njit(cache=True)
def _load_posts(history: Posts, neurons: int, window: int, refractory: int) -> Any:
    """Return the spikes that synapses remember, with room for those of a window."""
    most = len(history) + 1 + (window - 1) // (1 + refractory)
    stamp, k_minus = np.zeros((neurons, most), np.int64), np.zeros((neurons, most))
    count = np.zeros(neurons, np.int64)
    for post in history:
        i = post.source
        stamp[i, count[i]], k_minus[i, count[i]] = post.stamp, post.k_minus
        count[i] += 1
    return _PostSpikes(stamp, k_minus, count)


@numba.njit(cache=True)
def _keep_posts(posts: Any, window: int, since: int) -> Posts:
    """Return what the next window must remember: spikes after `since`, and each last before."""
    history = np.empty(posts.count.sum(), POST_DTYPE)
    kept = 0
    for i in range(len(posts.count)):
        for k in range(posts.count[i]):
            is_last = k + 1 == posts.count[i]
            if posts.stamp[i, k] > since or is_last or posts.stamp[i, k + 1] > since:
                history[kept].stamp = posts.stamp[i, k] - window
                history[kept].source = i
                history[kept].k_minus = posts.k_minus[i, k]
                kept += 1
    return history[:kept]


@numba.njit(cache=True)
def _hand_over(
    synapses: Any,
    j: int,
    stamp: int,
    now: int,
    posts: Any,
    dopamine: Any,
    arriving_pa: Any,
    scalars: Any,
    tables: Any,
) -> None:
    """Give the spike of relay j to its synapses, at the end of the interval it lies in."""
    for i in range(len(posts.count)):
        if synapses.time[i, j] <= now - scalars.interval:
            _bring(synapses, i, j, now, posts, dopamine[i], scalars, tables)
        _bring(synapses, i, j, stamp, posts, dopamine[i], scalars, tables)
        arriving_pa[stamp - 1 + scalars.delay, i] += synapses.weight[i, j]
        k_minus = _k_minus(posts, i, stamp - scalars.delay, scalars.minus_rate)
        synapses.eligibility[i, j] -= scalars.a_minus * k_minus
        synapses.k_plus[i, j] += 1.0


@numba.njit(cache=True)
def _next_posts(posts: Any, inputs: int, delay: int) -> NDArray[np.int64]:
    """Return the index of the first spike of each neuron that reaches its synapses after 0."""
    following = np.zeros((len(posts.count), inputs), np.int64)
    for i in range(len(posts.count)):
        for k in range(posts.count[i]):
            if posts.stamp[i, k] + delay <= 0:
                following[i] = k + 1
    return following


@numba.njit(cache=True)
def run(
    neurons: Neurons,
    weights_pa: NDArray[np.float64],
    eligibility: NDArray[np.float64],
    k_plus: NDArray[np.float64],
    dopamine: NDArray[np.float64],
    in_flight: Spikes,
    arriving_pa: NDArray[np.float64],
    history: Posts,
    inputs: Spikes,
    constants: Constants,
    rule: NDArray[np.void],
    tables: NDArray[np.float64],
    window: int,
) -> Any:
    """Run a window; see `plasticity.run_plastic_network`, `PlasticState` and `SynapseRule`.

    Returns:
        The fields of the PlasticState at its end, and the neurons' spikes.
    """
    neurons, scalars = neurons.copy(), rule[0]
    count, (_, n_inputs) = len(neurons), weights_pa.shape
    posts = _load_posts(history, count, window, constants[0].refractory)
    earlier = posts.count.copy()
    synapses = _Synapses(
        weights_pa.copy(),
        eligibility.copy(),
        k_plus.copy(),
        np.zeros((count, n_inputs), np.int64),
        _next_posts(posts, n_inputs, scalars.delay),
    )
    spikes = merge_spikes(in_flight, inputs)
    arriving = np.zeros((window + scalars.delay, count))
    arriving[: scalars.delay] = arriving_pa
    handed = 0
    for begin in range(0, window, scalars.interval):
        while handed < len(spikes) and spikes[handed].step + scalars.to_relay < begin:
            j, stamp = spikes[handed].source, spikes[handed].step + scalars.to_relay + 1
            _hand_over(synapses, j, stamp, begin, posts, dopamine, arriving, scalars, tables)
            handed += 1
        for step in range(begin, begin + scalars.interval):
            for i in range(count):
                if advance(neurons[i], arriving[step, i], constants[0]):
                    _add_post(posts, i, step + 1, scalars.minus_rate)
    for i in range(count):
        for j in range(n_inputs):
            _bring(synapses, i, j, window, posts, dopamine[i], scalars, tables)
    return (
        neurons,
        synapses.weight,
        synapses.eligibility,
        synapses.k_plus,
        dopamine * tables[scalars.interval + window, 1],
        keep_flying(spikes, handed, window),
        arriving[window:].copy(),
        _keep_posts(posts, window, window - scalars.delay - scalars.interval),
        _fired(posts, earlier),
    )


@numba.njit(cache=True)
def _fired(posts: Any, earlier: NDArray[np.int64]) -> Spikes:
    """Return the neurons' spikes of this window, in the order of grid steps."""
    fired = np.empty((posts.count - earlier).sum(), SPIKE_DTYPE)
    following = earlier.copy()
    for k in range(len(fired)):
        first = -1
        for i in range(len(following)):
            if following[i] < posts.count[i] and (
                first < 0 or posts.stamp[i, following[i]] < posts.stamp[first, following[first]]
            ):
                first = i
        fired[k].step, fired[k].source = posts.stamp[first, following[first]] - 1, first
        following[first] += 1
    return fired
