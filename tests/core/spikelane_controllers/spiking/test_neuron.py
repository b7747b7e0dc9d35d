"""The neuron model against closed forms and hand calculations, and the network's state."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from spikelane_controllers.spiking.network import (
    DelayParameters,
    NetworkState,
    resting_state,
    run_network,
)
from spikelane_controllers.spiking.neuron import neuron_constants, NeuronParameters
from spikelane_controllers.spiking.spikes import (
    GRID_STEPS,
    no_spikes,
    spike_counts,
    SPIKE_DTYPE,
    Spikes,
)
from spikelane_sim.errors import ParameterError

PAPER = neuron_constants(NeuronParameters())
DELAY = 20


def spikes(*pairs: tuple[int, int]) -> Spikes:
    """Make spikes of (grid step, source)."""
    return np.array(list(pairs), SPIKE_DTYPE)


def potentials(weight_pa: float, grid_steps: int, tau_m_ms: float = 10.0) -> list[float]:
    """Return the potential above rest [mV] after each grid step, for one spike in grid step 0."""
    constants = neuron_constants(NeuronParameters(v_th_mv=1000.0, tau_m_ms=tau_m_ms))
    state, inputs, trace = resting_state(1), spikes((0, 0)), []
    for _ in range(grid_steps):
        state, _ = run_network(state, inputs, np.array([[weight_pa]]), constants, DELAY, 1)
        inputs = no_spikes()
        trace.append(float(state.neurons['potential_mv'][0]))
    return trace


def test_a_postsynaptic_potential_is_the_one_of_the_closed_form() -> None:
    """A spike of weight w, arriving at t = 0: solved by hand for tau_m = 10, tau_syn = 2 ms.

    With b = 1/2 - 1/10 = 0.4 per ms and C = 250 pF:
    V(t) = (w e / (2 C)) (exp(-t/10) - exp(-t/2) (1 + b t)) / b^2.
    """
    trace = potentials(1000.0, 200)
    for grid_step in (21, 30, 50, 120, 199):
        t = (grid_step - 20) * 0.1
        scale = 1000.0 * math.e / (2 * 250 * 0.4**2)
        expected = scale * (math.exp(-t / 10) - math.exp(-t / 2) * (1 + 0.4 * t))
        assert trace[grid_step] == pytest.approx(expected, rel=1e-12)


def test_a_postsynaptic_potential_peaks_where_it_should() -> None:
    """The slope is zero where exp(0.4 t) = 1 + 2 t: at 6.65 ms; 13.0001 mV at the nearest step."""
    trace = potentials(1000.0, 200)
    assert trace[20] == 0.0
    assert max(trace) == pytest.approx(13.0001, abs=5e-5)
    assert (np.argmax(trace) - 20) * 0.1 == pytest.approx(6.7)


def test_equal_time_constants_are_no_special_case() -> None:
    """With tau_m = tau_syn = 2 ms the potential is w e t^2 exp(-t/2) / (4 C)."""
    trace = potentials(1000.0, 200, tau_m_ms=2.0)
    for t in (0.1, 2.0, 4.0, 10.0):
        expected = 1000.0 * math.e * t**2 * math.exp(-t / 2) / (4 * 250)
        assert trace[20 + round(t * 10)] == pytest.approx(expected, rel=1e-12)


def test_a_constant_current_fires_at_the_rate_of_the_closed_form() -> None:
    """I tau_m / C = 30 mV: 15 mV are reached after 10 ln 2 = 6.93 ms, 2 ms refractory follow.

    On the grid that is 7.0 + 2.0 ms; so 20 s have 1 + floor((20000 - 7) / 9) = 2222 spikes.
    """
    constants = neuron_constants(NeuronParameters(i_e_pa=750.0))
    _, fired = run_network(resting_state(1), no_spikes(), np.ones((1, 1)), constants, 20, 200_000)
    assert fired['step'][:3].tolist() == [69, 159, 249]
    assert len(fired) == 2222


def test_a_current_too_weak_for_the_threshold_never_fires() -> None:
    """374 pA end 0.04 mV below it, 376 pA above."""
    for current_pa, expected in ((374.0, False), (376.0, True)):
        constants = neuron_constants(NeuronParameters(i_e_pa=current_pa))
        _, fired = run_network(resting_state(1), no_spikes(), np.ones((1, 1)), constants, 20, 5000)
        assert bool(len(fired)) == expected


def test_spikes_arrive_after_both_delays() -> None:
    """1.0 + 2.5 ms after grid step 4, the current's slope jumps by w e / tau_syn."""
    delay = DelayParameters(to_relay_ms=1.0, to_neuron_ms=2.5).steps
    assert delay == 35
    weights = np.array([[100.0]])
    for window, expected in ((39, 0.0), (40, 100.0 * math.e / 2)):
        state, _ = run_network(resting_state(1), spikes((4, 0)), weights, PAPER, delay, window)
        assert state.neurons['slope_pa_per_ms'][0] == pytest.approx(expected)


def test_spikes_of_one_input_in_the_same_grid_step_add_up() -> None:
    """Three at 100 pA are one at 300 pA."""
    thrice, _ = run_network(
        resting_state(1), spikes((0, 0), (0, 0), (0, 0)), np.array([[100.0]]), PAPER, DELAY
    )
    once, _ = run_network(resting_state(1), spikes((0, 0)), np.array([[300.0]]), PAPER, DELAY)
    np.testing.assert_allclose(
        thrice.neurons['potential_mv'], once.neurons['potential_mv'], rtol=1e-13
    )


def random_inputs(rng: np.random.Generator, inputs: int = 4, number: int = 120) -> Spikes:
    """Make random spikes in the order of grid steps."""
    drawn = np.empty(number, SPIKE_DTYPE)
    drawn['step'] = np.sort(rng.integers(0, GRID_STEPS, number))
    drawn['source'] = rng.integers(0, inputs, number)
    return drawn


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 1000),
    cuts=st.lists(st.integers(1, GRID_STEPS - 1), max_size=6, unique=True).map(sorted),
)
def test_it_does_not_matter_how_time_is_cut_into_windows(seed: int, cuts: list[int]) -> None:
    """The same spikes and the same final state, bit for bit, spikes in flight included."""
    rng = np.random.default_rng(seed)
    inputs, weights = random_inputs(rng), rng.uniform(200, 3000, (2, 4))
    whole_state, whole = run_network(resting_state(2), inputs, weights, PAPER, DELAY)
    state, parts = resting_state(2), []
    for begin, end in zip([0, *cuts], [*cuts, GRID_STEPS], strict=True):
        part = inputs[(inputs['step'] >= begin) & (inputs['step'] < end)].copy()
        part['step'] -= begin
        state, fired = run_network(state, part, weights, PAPER, DELAY, end - begin)
        parts += [(step + begin, source) for step, source in fired.tolist()]
    assert parts == whole.tolist()
    assert state.neurons.tobytes() == whole_state.neurons.tobytes()
    assert state.in_flight.tolist() == whole_state.in_flight.tolist()


def test_a_step_leaves_its_arguments_as_they_were() -> None:
    """State in, state out: neither state, spikes, weights nor constants are written to."""
    rng = np.random.default_rng(3)
    weights = rng.uniform(200, 3000, (2, 4))
    state, _ = run_network(resting_state(2), random_inputs(rng), weights, PAPER, DELAY)
    inputs = random_inputs(rng)
    arrays = (state.neurons, state.in_flight, inputs, weights, PAPER)
    before = [array.tobytes() for array in arrays]
    run_network(state, inputs, weights, PAPER, DELAY)
    assert [array.tobytes() for array in arrays] == before


def test_read_only_arrays_are_taken() -> None:
    """Arrays of a bag or a checkpoint may be so."""
    state = resting_state(1)
    inputs, weights = spikes((0, 0)), np.array([[100.0]])
    for array in (state.neurons, state.in_flight, inputs, weights):
        array.flags.writeable = False
    after, _ = run_network(state, inputs, weights, PAPER, DELAY)
    assert after.neurons['potential_mv'][0] > 0


def test_spikes_are_counted_by_source() -> None:
    """Sources that never fired count zero."""
    assert spike_counts(spikes((3, 1), (3, 1), (9, 0)), 3) == (1, 2, 0)
    assert spike_counts(no_spikes(), 2) == (0, 0)


def test_the_resting_state_is_rest() -> None:
    """Without input nothing happens."""
    state, fired = run_network(resting_state(2), no_spikes(), np.ones((2, 1)), PAPER, DELAY)
    assert isinstance(state, NetworkState)
    assert not state.neurons['potential_mv'].any()
    assert not len(fired)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'t_ref_ms': 1.23}, 't_ref_ms: expected a multiple of 0.1 ms, got 1.23'),
        ({'v_reset_mv': -55.0}, 'v_reset_mv: expected less than v_th_mv = -55 mV, got -55'),
        ({'tau_m_ms': 0.0}, 'tau_m_ms: expected a number from 0.1 to 1000000 ms, got 0.0'),
    ],
)
def test_impossible_neurons_are_refused(values: dict[str, float], message: str) -> None:
    """The message names the parameter, what is allowed and what came."""
    with pytest.raises(ParameterError, match=message):
        NeuronParameters(**values)


def test_delays_off_the_grid_are_refused() -> None:
    """A delay is a number of grid steps."""
    with pytest.raises(ParameterError, match=r'to_neuron_ms: expected a multiple of 0.1 ms'):
        DelayParameters(to_neuron_ms=1.05)
