"""The synapses against hand calculations and an integration in small steps."""

from __future__ import annotations

import math
from typing import NamedTuple

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from numpy.typing import NDArray
import pytest

from spikelane_controllers.spiking.network import DelayParameters, NetworkState, run_network
from spikelane_controllers.spiking.neuron import neuron_constants, NeuronParameters
from spikelane_controllers.spiking.plasticity import (
    PlasticState,
    resting_plastic_state,
    run_plastic_network,
)
from spikelane_controllers.spiking.spikes import GRID_STEPS, no_spikes, SPIKE_DTYPE, Spikes
from spikelane_controllers.spiking.synapse import synapse_rule, SynapseParameters, SynapseRule
from spikelane_sim.errors import ParameterError

CONSTANTS = neuron_constants(NeuronParameters())
#: A neuron that spikes at 7, 16, 25, 34 ms, whatever little reaches it.
STEADY = neuron_constants(NeuronParameters(i_e_pa=750.0))
DELAYS = DelayParameters()
NEST = synapse_rule(SynapseParameters(), DELAYS)
EXACT = synapse_rule(SynapseParameters(interval_ms=0.1), DELAYS)


def spikes(*pairs: tuple[int, int]) -> Spikes:
    """Make spikes of (grid step, source)."""
    return np.array(list(pairs), SPIKE_DTYPE)


def random_inputs(rng: np.random.Generator, inputs: int = 4, number: int = 60) -> Spikes:
    """Make random spikes in the order of grid steps."""
    drawn = np.empty(number, SPIKE_DTYPE)
    drawn['step'] = np.sort(rng.integers(0, GRID_STEPS, number))
    drawn['source'] = rng.integers(0, inputs, number)
    return drawn


def active_state(rng: np.random.Generator, rule: SynapseRule, dopamine: float) -> PlasticState:
    """Return two neurons and eight synapses that are in the midst of things."""
    state = resting_plastic_state(rng.uniform(500, 2500, (2, 4)), DELAYS)
    state, _ = run_plastic_network(state, random_inputs(rng), CONSTANTS, rule)
    return state._replace(dopamine=np.array([-dopamine, dopamine]))


@pytest.mark.parametrize('rule', [NEST, EXACT])
def test_a_relays_spike_before_the_neurons_by_hand(rule: SynapseRule) -> None:
    """The relay spikes at 3 ms, the neuron at 7 ms, which the synapse knows at 8 ms.

    K_plus is then exp(-5/20) = 0.778801, and that is the eligibility; with dopamine 0.5 at 0,
    0.480395 at 8 ms, the weight is at 10 ms 0.778801 0.480395 tau (1 - exp(-2 / tau)) for
    1 / tau = 1 / 1000 + 1 / 200 per ms, which is 0.778801 0.480395 1.988048 = 0.743792.
    """
    state = resting_plastic_state(np.zeros((1, 1)), DELAYS)._replace(dopamine=np.array([0.5]))
    state, fired = run_plastic_network(state, spikes((19, 0)), STEADY, rule, 100)
    assert fired['step'].tolist() == [69]
    assert state.eligibility[0, 0] == pytest.approx(0.777245, abs=1e-6)
    assert state.weights_pa[0, 0] == pytest.approx(0.743792, abs=2e-6)
    assert state.k_plus[0, 0] == pytest.approx(0.704688, abs=1e-6)  # exp(-7/20)
    assert state.dopamine[0] == pytest.approx(0.475615, abs=1e-6)  # 0.5 exp(-10/200)


@pytest.mark.parametrize('rule', [NEST, EXACT])
def test_a_relays_spike_after_the_neurons_by_hand(rule: SynapseRule) -> None:
    """The neuron spikes at 7 ms, the relay at 12 ms, when the synapse knows the neuron at 11 ms.

    K_minus is then exp(-4/20) = 0.818731, and its negative the eligibility; with dopamine -0.5 at
    0, -0.470882 at 12 ms, the weight is at 14 ms 0.818731 0.470882 1.988048 = 0.766444.
    """
    state = resting_plastic_state(np.zeros((1, 1)), DELAYS)._replace(dopamine=np.array([-0.5]))
    state, _ = run_plastic_network(state, spikes((109, 0)), STEADY, rule, 140)
    assert state.weights_pa[0, 0] == pytest.approx(0.766444, abs=2e-6)


class Trace(NamedTuple):
    """A synapse integrated in small steps."""

    weight: float
    eligibility: float


def euler(
    weight: float, dopamine: float, relay: NDArray[np.float64], post: NDArray[np.float64], n: int
) -> Trace:
    """Integrate one synapse over 50 ms by Euler's method, n steps in a grid step.

    Args:
        weight: At the start; there are no traces then.
        dopamine: At the start.
        relay: Stamps of the relay's spikes [grid steps].
        post: Stamps of the neuron's spikes, when they reach the synapse.
        n: Steps in a grid step.
    """
    h = 0.1 / n
    c = k_plus = k_minus = 0.0
    for step in range(GRID_STEPS):
        for _ in range(n):
            weight += h * c * dopamine
            c -= h * c / 1000.0
            dopamine -= h * dopamine / 200.0
            k_plus -= h * k_plus / 20.0
            k_minus -= h * k_minus / 20.0
        is_relay, is_post = (relay == step + 1).sum(), (post == step + 1).sum()
        c += is_post * k_plus - is_relay * k_minus
        k_plus, k_minus = k_plus + is_relay, k_minus + is_post
    return Trace(weight, c)


@pytest.mark.parametrize('seed', range(3))
def test_the_equations_are_solved(seed: int) -> None:
    """Euler's method extrapolated to no step at all gives the same to a millionth."""
    rng = np.random.default_rng(seed)
    state = resting_plastic_state(rng.uniform(900, 2000, (2, 4)), DELAYS)
    inputs = random_inputs(rng, number=40)
    state = state._replace(dopamine=np.array([-0.05, 0.03]))
    after, fired = run_plastic_network(state, inputs, CONSTANTS, EXACT)
    assert len(fired) > 5
    for i, j in ((0, 0), (0, 3), (1, 1), (1, 2)):
        relay = inputs['step'][inputs['source'] == j] + 1.0 + 10.0
        post = fired['step'][fired['source'] == i] + 1.0 + 10.0
        w0, n0 = state.weights_pa[i, j], state.dopamine[i]
        coarse, middle, fine = (np.array(euler(w0, n0, relay, post, n)) for n in (4, 8, 16))
        # Richardson: away go the errors of first, then of second order.
        first, second = 2 * middle - coarse, 2 * fine - middle
        weight, eligibility = (4 * second - first) / 3
        change = after.weights_pa[i, j] - w0
        assert abs(change) > 1e-3
        assert change == pytest.approx(weight - w0, rel=1e-6, abs=1e-9)
        assert after.eligibility[i, j] == pytest.approx(eligibility, rel=1e-6, abs=1e-9)


def test_a_neurons_spike_counts_twice_where_nest_counts_it_twice() -> None:
    """NEST's bookkeeping by hand.

    The neuron spikes at 25 ms, which the synapse knows at 26 ms. The relay spiked at 19.1 ms and
    25.5 ms. The equations as they stand add exp(-6.9/20) + exp(-0.5/20) to the eligibility; NEST,
    taking the synapse from 26 ms back to 25.5 ms and forward again, adds exp(-6.9/20) once more.
    """
    state = resting_plastic_state(np.zeros((1, 1)), DELAYS)
    inputs = spikes((180, 0), (244, 0))  # the relay spikes at 19.1 and 25.5 ms
    results = []
    for rule in (EXACT, NEST):
        after, fired = run_plastic_network(state, inputs, STEADY, rule, 300)
        assert fired['step'].tolist() == [69, 159, 249]
        results.append(after.eligibility[0, 0])
    expected = math.exp(-6.9 / 20) * math.exp(-4 / 1000)  # decayed from 26 to 30 ms
    assert results[1] - results[0] == pytest.approx(expected, rel=1e-9)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 1000),
    cuts=st.lists(st.integers(1, 49), max_size=6, unique=True).map(sorted),
)
def test_it_does_not_matter_how_time_is_cut_into_windows(seed: int, cuts: list[int]) -> None:
    """The same spikes, and weights and traces but for rounding."""
    rng = np.random.default_rng(seed)
    begin_state, inputs = active_state(rng, NEST, 1e-3), random_inputs(rng)
    whole_state, whole = run_plastic_network(begin_state, inputs, CONSTANTS, NEST)
    state, parts = begin_state, []
    for begin, end in zip([0, *cuts], [*cuts, 50], strict=True):
        begin, end = 10 * begin, 10 * end
        part = inputs[(inputs['step'] >= begin) & (inputs['step'] < end)].copy()
        part['step'] -= begin
        state, fired = run_plastic_network(state, part, CONSTANTS, NEST, end - begin)
        parts += [(step + begin, source) for step, source in fired.tolist()]
    assert parts == whole.tolist()
    for name in ('weights_pa', 'eligibility', 'k_plus', 'dopamine', 'arriving_pa'):
        one, other = getattr(state, name), getattr(whole_state, name)
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9, err_msg=name)
    assert state.in_flight.tolist() == whole_state.in_flight.tolist()


@pytest.mark.parametrize('n_neurons', [1, 3, 4, 20])
def test_each_neuron_is_as_it_would_be_alone(n_neurons: int) -> None:
    """Neurons are integrated two at a time, which changes nothing, also where one is left over."""
    rng = np.random.default_rng(5)
    weights_pa = rng.uniform(500, 2500, (n_neurons, 4))
    dopamine = rng.uniform(-1, 1, n_neurons)
    together = resting_plastic_state(weights_pa, DELAYS)._replace(dopamine=dopamine)
    alone = [
        resting_plastic_state(weights_pa[[i]], DELAYS)._replace(dopamine=dopamine[[i]])
        for i in range(n_neurons)
    ]
    for _ in range(3):
        inputs = random_inputs(rng)
        together, fired = run_plastic_network(together, inputs, CONSTANTS, NEST)
        assert len(fired) > 0
        assert fired.tolist() == sorted(fired.tolist())  # by grid step, then by neuron
        for i in range(n_neurons):
            alone[i], own = run_plastic_network(alone[i], inputs, CONSTANTS, NEST)
            assert own['step'].tolist() == fired['step'][fired['source'] == i].tolist()
            assert alone[i].weights_pa[0].tolist() == together.weights_pa[i].tolist()
            assert alone[i].eligibility[0].tolist() == together.eligibility[i].tolist()


@pytest.mark.parametrize('silent_windows', [1, 2, 40, 400])
def test_a_neuron_that_fell_silent_is_forgotten_exponentially(silent_windows: int) -> None:
    """Its only spike is at 7 ms, the relay's some windows of 50 ms later.

    The spike was at the synapse's end at 8 ms, and the relay's arrives at 12 ms of its window, so
    that K_minus has decayed for 4 ms and all windows between, to less than any number after 400.
    """
    state = resting_plastic_state(np.zeros((1, 1)), DELAYS)
    state, fired = run_plastic_network(state, no_spikes(), STEADY, NEST, 100)
    assert fired['step'].tolist() == [69]
    state, _ = run_plastic_network(state, no_spikes(), CONSTANTS, NEST, 400)
    for _ in range(silent_windows - 1):
        state, _ = run_plastic_network(state, no_spikes(), CONSTANTS, NEST)
    state, _ = run_plastic_network(state, spikes((109, 0)), CONSTANTS, NEST)
    # The eligibility decays from 12 ms to the window's end.
    expected = -math.exp(-(4 + 50 * silent_windows) / 20) * math.exp(-(50 - 12) / 1000)
    assert state.eligibility[0, 0] == pytest.approx(expected, rel=1e-12)


def test_without_dopamine_it_is_the_static_network_bit_for_bit() -> None:
    """Neurons and spikes as `run_network` has them, weights untouched."""
    rng = np.random.default_rng(1)
    weights_pa = rng.uniform(200, 3000, (2, 4))
    plastic = resting_plastic_state(weights_pa, DELAYS)
    static = NetworkState(plastic.neurons, no_spikes())
    for _ in range(20):
        inputs = random_inputs(rng)
        plastic, ours = run_plastic_network(plastic, inputs, CONSTANTS, NEST)
        static, theirs = run_network(static, inputs, weights_pa, CONSTANTS, 20)
        assert ours.tolist() == theirs.tolist()
        assert (plastic.weights_pa == weights_pa).all()
    np.testing.assert_allclose(
        plastic.neurons['potential_mv'], static.neurons['potential_mv'], rtol=1e-12
    )


@pytest.mark.parametrize(('dopamine', 'bound'), [(1e3, (0.0, 3000.0)), (-1e3, (3000.0, 0.0))])
def test_weights_stay_within_their_bounds(dopamine: float, bound: tuple[float, float]) -> None:
    """Eligible synapses end at one bound with much dopamine, at the other with a lack of it."""
    state = active_state(np.random.default_rng(4), NEST, dopamine)
    after, _ = run_plastic_network(state, no_spikes(), CONSTANTS, NEST)
    for i in (0, 1):
        gaining = state.eligibility[i] > 0.5
        assert gaining.any()
        assert (after.weights_pa[i, gaining] == bound[i]).all()


def test_a_step_leaves_its_arguments_as_they_were() -> None:
    """State in, state out."""
    rng = np.random.default_rng(3)
    state, inputs = active_state(rng, NEST, 1e-3), random_inputs(rng)
    arrays = (*state, inputs, CONSTANTS, *NEST)
    before = [array.tobytes() for array in arrays]
    run_plastic_network(state, inputs, CONSTANTS, NEST)
    assert [array.tobytes() for array in arrays] == before


def test_the_past_does_not_grow() -> None:
    """Only the neurons' last spikes are remembered."""
    rng = np.random.default_rng(3)
    state = active_state(rng, NEST, 0.0)
    for _ in range(30):
        state, fired = run_plastic_network(state, random_inputs(rng), CONSTANTS, NEST)
        assert len(fired) > 5
        assert len(state.history) <= 4
        assert len(state.in_flight) < 20


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'interval_ms': 0.3}, 'interval_ms: expected a divisor of 50 ms, got 0.3'),
        ({'interval_ms': 0.25}, 'interval_ms: expected a multiple of 0.1 ms, got 0.25'),
        ({'w_min_pa': 5000.0}, 'w_max_pa: expected at least w_min_pa = 5000 pA, got 3000'),
        ({'tau_c_ms': 0.0}, 'tau_c_ms: expected a number from 0.1 to 1000000 ms, got 0.0'),
    ],
)
def test_impossible_synapses_are_refused(values: dict[str, float], message: str) -> None:
    """The message names the parameter, what is allowed and what came."""
    with pytest.raises(ParameterError, match=message):
        SynapseParameters(**values)


def test_a_window_that_no_interval_divides_is_refused() -> None:
    """Spikes would lie behind its end."""
    state = resting_plastic_state(np.zeros((1, 1)), DELAYS)
    expected = "window: expected a multiple of the rule's interval of 10 grid steps, got 95"
    with pytest.raises(ParameterError, match=expected):
        run_plastic_network(state, no_spikes(), CONSTANTS, NEST, 95)


def test_an_interval_longer_than_the_delay_is_refused() -> None:
    """A spike would have to arrive before it is handed over."""
    with pytest.raises(ParameterError, match='at most the delay to_neuron_ms = 1 ms, got 2'):
        synapse_rule(SynapseParameters(interval_ms=2.0), DELAYS)
