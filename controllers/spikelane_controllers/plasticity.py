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

Dopamine is set between windows, when all synapses have been brought to the boundary. So it acts
from there on; the relays' spikes of the last interval before, handed over after it, see dopamine
as if it had been the new one's decay all along.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking import (
    advance,
    Constants,
    DelayParameters,
    GRID_MS,
    GRID_STEPS,
    grid_steps,
    keep_flying,
    merge_spikes,
    NEURON_DTYPE,
    Neurons,
    no_spikes,
    SPIKE_DTYPE,
    Spikes,
)
from spikelane_sim.errors import CheckpointError, ParameterError
from spikelane_sim.parameters import parameter, Parameters

_TABLE = 'table "Simulation parameters specification"'

#: A neuron's spike as its synapses remember it: stamp, neuron, K_minus just after it.
POST_DTYPE = np.dtype([('stamp', '<i8'), ('source', '<i8'), ('k_minus', '<f8')])

_RULE_DTYPE = np.dtype(
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

Weights = NDArray[np.float64]
Posts = NDArray[np.void]  # of POST_DTYPE, in the order of stamps, (n_spikes,)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SynapseParameters(Parameters):
    """NEST's parameters of stdp_dopamine_synapse; its baseline b is 0."""

    a_plus: float = parameter(
        1.0, 'Eligibility gained when the neuron spikes after the relay.', low=0.0, source=_TABLE
    )
    a_minus: float = parameter(
        1.0, 'Eligibility lost when the relay spikes after the neuron.', low=0.0, source=_TABLE
    )
    tau_plus_ms: float = parameter(
        20.0, "Time constant of the relay's trace K_plus.", unit='ms', low=GRID_MS, source=_TABLE
    )
    tau_minus_ms: float = parameter(
        20.0, "Time constant of the neuron's trace K_minus (NEST's).", unit='ms', low=GRID_MS
    )
    tau_c_ms: float = parameter(
        1000.0, 'Time constant of the eligibility trace.', unit='ms', low=GRID_MS, source=_TABLE
    )
    tau_n_ms: float = parameter(
        200.0, 'Time constant of dopamine.', unit='ms', low=GRID_MS, source=_TABLE
    )
    w_min_pa: float = parameter(0.0, 'Smallest weight.', unit='pA', source=_TABLE)
    w_max_pa: float = parameter(3000.0, 'Largest weight.', unit='pA', source=_TABLE)
    interval_ms: float = parameter(
        1.0, "How often NEST's bookkeeping is done; 0.1: without it.", unit='ms', low=GRID_MS
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

    scalars: NDArray[np.void]  # of _RULE_DTYPE, (1,)
    # Per number k of grid steps from -interval to the longest window plus interval: what decays
    # in them of c, n and K_plus, and the integral of exp(-t / tau_c - t / tau_n) [ms]. (n, 4)
    tables: NDArray[np.float64]


class PlasticState(NamedTuple):
    """State of the neurons and of their synapses, all brought up to date at a window's end."""

    neurons: Neurons
    weights_pa: Weights  # w, (n_neurons, n_inputs)
    eligibility: NDArray[np.float64]  # c, (n_neurons, n_inputs)
    k_plus: NDArray[np.float64]  # (n_neurons, n_inputs)
    dopamine: NDArray[np.float64]  # n [1/ms], (n_neurons,); set it with _replace
    in_flight: Spikes  # of inputs, not yet handed to the synapses: steps may be negative
    arriving_pa: NDArray[np.float64]  # on its way to the neurons, (delay, n_neurons)
    history: Posts  # the neurons' spikes that may still pair, by neuron and stamp, which is <= 0


def synapse_rule(
    synapse: SynapseParameters, delays: DelayParameters, window: int = GRID_STEPS
) -> SynapseRule:
    """Solve the synapses' equations for every number of grid steps in a window.

    Args:
        synapse: The synapses.
        delays: From the inputs to the relays, from these to the neurons.
        window: Length of the longest window to come [grid steps].

    Raises:
        ParameterError: interval_ms is longer than the delay from relay to neuron.
    """
    interval = grid_steps('interval_ms', synapse.interval_ms)
    delay = grid_steps('to_neuron_ms', delays.to_neuron_ms)
    if interval > delay:
        raise ParameterError(
            f'interval_ms: expected at most the delay to_neuron_ms = {delays.to_neuron_ms:g} ms, '
            f'got {synapse.interval_ms:g}'
        )
    scalars = np.zeros(1, _RULE_DTYPE)
    scalars['a_plus'], scalars['a_minus'] = synapse.a_plus, synapse.a_minus
    scalars['minus_rate'] = GRID_MS / synapse.tau_minus_ms
    scalars['w_min'], scalars['w_max'] = synapse.w_min_pa, synapse.w_max_pa
    scalars['to_relay'] = grid_steps('to_relay_ms', delays.to_relay_ms)
    scalars['delay'], scalars['interval'] = delay, interval
    t_ms = np.arange(-interval, window + interval + 1) * GRID_MS
    rate = 1 / synapse.tau_c_ms + 1 / synapse.tau_n_ms
    tables = np.stack(
        [
            np.exp(-t_ms / synapse.tau_c_ms),
            np.exp(-t_ms / synapse.tau_n_ms),
            np.exp(-t_ms / synapse.tau_plus_ms),
            -np.expm1(-rate * t_ms) / rate,
        ],
        axis=1,
    )
    return SynapseRule(scalars, tables)


def resting_plastic_state(weights_pa: Weights, delays: DelayParameters) -> PlasticState:
    """Return neurons at rest and synapses that know of no spikes and no dopamine.

    Args:
        weights_pa: Initial weights [pA], (n_neurons, n_inputs).
        delays: As in `synapse_rule`.
    """
    neurons = len(weights_pa)
    return PlasticState(
        neurons=np.zeros(neurons, NEURON_DTYPE),
        weights_pa=np.array(weights_pa, np.float64),
        eligibility=np.zeros(weights_pa.shape),
        k_plus=np.zeros(weights_pa.shape),
        dopamine=np.zeros(neurons),
        in_flight=no_spikes(),
        arriving_pa=np.zeros((grid_steps('to_neuron_ms', delays.to_neuron_ms), neurons)),
        history=np.empty(0, POST_DTYPE),
    )


def run_plastic_network(
    state: PlasticState,
    inputs: Spikes,
    constants: Constants,
    rule: SynapseRule,
    window: int = GRID_STEPS,
) -> tuple[PlasticState, Spikes]:
    """Run a network whose synapses learn for a window of time.

    Without dopamine the weights stay as they are, and only the traces go on.

    Args:
        state: State at the window's start.
        inputs: What the inputs fire in this window, in the order of grid steps; an input may do
            so several times in one. Sources are below n_inputs, which is not checked.
        constants: The neurons.
        rule: The synapses.
        window: Length of the window [grid steps], a multiple of the rule's interval and not
            longer than the rule was made for.

    Returns:
        State at the window's end, and the spikes of the neurons in the window.
    """
    *arrays, fired = _run(*state, inputs, constants, *rule, window)
    return PlasticState(*arrays), fired


def check_plastic_state(state: PlasticState, like: PlasticState, rule: SynapseRule) -> None:
    """Check what the kernel relies on, in a state that was stored.

    Args:
        state: The state, its arrays of the same types as like's.
        like: A state of the same network.
        rule: The synapses.

    Raises:
        CheckpointError: It is not a state of such a network.
    """
    n_neurons, n_inputs = like.weights_pa.shape
    scalars = rule.scalars[0]
    earliest = -scalars['to_relay'] - scalars['interval']
    in_flight, history = state.in_flight, state.history
    stamps = [history['stamp'][history['source'] == i] for i in range(n_neurons)]
    _expect(state.neurons.shape == like.neurons.shape, f'{n_neurons} neurons')
    _expect(_is_within(state.weights_pa, scalars['w_min'], scalars['w_max']), 'weights in range')
    _expect(_is_within(in_flight['source'], 0, n_inputs - 1), 'spikes in flight of its inputs')
    _expect(_is_within(in_flight['step'], earliest, -1), 'spikes in flight that are still so')
    _expect(bool((np.diff(in_flight['step']) >= 0).all()), 'spikes in flight in order')
    _expect(_is_within(history['source'], 0, n_neurons - 1), 'spikes of its neurons')
    _expect(all(_is_within(s, -np.inf, 0) and (np.diff(s) > 0).all() for s in stamps), 'a past')


def _is_within(values: NDArray[Any], low: float, high: float) -> bool:
    return bool(((values >= low) & (values <= high)).all())


def _expect(is_met: bool, what: str) -> None:
    if not is_met:
        raise CheckpointError(f'state of the network: expected {what}')


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
def _run(
    neurons: Neurons,
    weights_pa: Weights,
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
