"""Integrate-and-fire neurons: by hand, and their rates against the rectified network's."""

from __future__ import annotations

import math

import numpy as np
import pytest

from spikelane_controllers.dqn_snn.feedforward import activate, FeedForward
from spikelane_controllers.dqn_snn.integrate_and_fire import (
    Fired,
    input_spikes,
    IntegrateAndFire,
    IntegrateAndFireParameters,
    Potentials,
    resting_potentials,
)
from spikelane_controllers.dqn_snn.normalisation import normalise
from spikelane_controllers.spiking.spikes import no_spikes, SPIKE_DTYPE, Spikes
from spikelane_sim.errors import ParameterError


def network(hidden: object, bias: object, output: object) -> FeedForward:
    """Make a network of lists."""
    return FeedForward(*(np.array(each, np.float32) for each in (hidden, bias, output)))


def drawn_network(rng: np.random.Generator, inputs: int, hidden: int) -> FeedForward:
    """Make a normalised network of random weights, with three outputs."""
    shapes = ((hidden, inputs), (hidden,), (3, hidden))
    return normalise(network(*(rng.normal(size=shape) for shape in shapes))).network


def spikes(*pairs: tuple[int, int]) -> Spikes:
    """Make input spikes of (time step, source)."""
    return np.array(list(pairs), SPIKE_DTYPE)


def run(
    net: FeedForward, inputs: Spikes, steps: int, **parameters: object
) -> tuple[Potentials, Fired]:
    """Run a network from rest."""
    settings = IntegrateAndFireParameters(**parameters)  # type: ignore[arg-type]
    return IntegrateAndFire(net, settings).run(resting_potentials(net), inputs, steps)


#: One hidden neuron, excited by input 0 and inhibited by input 1, that drives one output.
ONE = network([[0.5, -0.75]], [0.0], [[1.0]])


def test_a_neuron_by_hand() -> None:
    """0.5, 1.0 fires and is 0; -0.75 is 0; 0.5; 0.5 - 0.75 is 0; 0.5; 1.0 fires."""
    inputs = spikes((0, 0), (1, 0), (2, 1), (3, 0), (4, 1), (5, 0), (6, 0))
    potentials, fired = run(ONE, inputs, 7)
    assert fired.output.ravel().tolist() == [0, 1, 0, 0, 0, 0, 1]
    assert fired.hidden.tolist() == [2]
    assert potentials.hidden.tolist() == [0.0]
    assert run(ONE, inputs[:4], 4)[0].hidden.tolist() == [0.5]


def test_without_the_clamp_what_was_lost_is_owed() -> None:
    """0.5, fires, -0.75, -0.25, -1, -0.5, 0."""
    inputs = spikes((0, 0), (1, 0), (2, 1), (3, 0), (4, 1), (5, 0), (6, 0))
    potentials, fired = run(ONE, inputs, 7, clamped=False)
    assert fired.output.ravel().tolist() == [0, 1, 0, 0, 0, 0, 0]
    assert potentials.hidden.tolist() == [0.0]
    assert run(ONE, inputs[:5], 5, clamped=False)[0].hidden.tolist() == [-1.0]


def test_what_is_above_the_threshold_is_lost_or_kept() -> None:
    """0.75, 1.5: reset to 0, or to 0.5, which with another 0.75 fires again."""
    net = network([[0.75]], [0.0], [[1.0]])
    inputs = spikes((0, 0), (1, 0), (2, 0))
    potentials, fired = run(net, inputs, 3)
    assert (fired.hidden.tolist(), potentials.hidden.tolist()) == ([1], [0.75])
    potentials, fired = run(net, inputs, 3, reset='subtract')
    assert (fired.hidden.tolist(), potentials.hidden.tolist()) == ([2], [0.25])


def test_a_bias_is_a_constant_input() -> None:
    """0.25 a step fires every fourth; a negative one holds back."""
    _, fired = run(network([[1.0]], [0.25], [[1.0]]), no_spikes(), 12)
    assert np.flatnonzero(fired.output).tolist() == [3, 7, 11]
    inputs = spikes(*((step, 0) for step in range(12)))
    _, fired = run(network([[1.0]], [-0.5], [[1.0]]), inputs, 12)
    assert np.flatnonzero(fired.output).tolist() == [1, 3, 5, 7, 9, 11]


def test_the_threshold_is_a_parameter() -> None:
    """At 2 it takes four spikes of 0.5."""
    inputs = spikes(*((step, 0) for step in range(8)))
    _, fired = run(network([[0.5]], [0.0], [[2.0]]), inputs, 8, threshold_mv=2.0)
    assert np.flatnonzero(fired.output).tolist() == [3, 7]


def test_two_inputs_in_a_step_add_up() -> None:
    """And go to every neuron."""
    net = network([[0.5, 0.5], [0.25, 0.25], [-1.0, 1.0]], [0.0] * 3, [[0.5, 1.0, 0.0]])
    _, fired = run(net, spikes((0, 0), (0, 1), (1, 0), (1, 1)), 2)
    assert fired.hidden.tolist() == [2, 1, 0]
    assert fired.output.ravel().tolist() == [0, 1]


def test_potentials_live_on_between_windows() -> None:
    """Windows of any length give the same; nothing given is written to."""
    rng = np.random.default_rng(6)
    net = drawn_network(rng, 11, 7)
    steps, sources = np.nonzero(rng.random((60, 11)) < 0.4)
    inputs = np.array(list(zip(steps, sources, strict=True)), SPIKE_DTYPE)
    whole_potentials, whole = run(net, inputs, 60)
    assert whole.output.sum() > 3
    simulated = IntegrateAndFire(net)
    potentials, outputs, hidden = resting_potentials(net), [], np.zeros(7, np.int64)
    for first, last in ((0, 1), (1, 25), (25, 25), (25, 60)):
        part = inputs[(inputs['step'] >= first) & (inputs['step'] < last)].copy()
        part['step'] -= first
        before = [each.copy() for each in potentials]
        after, fired = simulated.run(potentials, part, last - first)
        assert all((a == b).all() for a, b in zip(before, potentials, strict=True))
        potentials, hidden = after, hidden + fired.hidden
        outputs.append(fired.output)
    assert (np.vstack(outputs) == whole.output).all()
    assert (hidden == whole.hidden).all()
    assert all((a == b).all() for a, b in zip(potentials, whole_potentials, strict=True))


def test_inputs_fire_with_the_probability_that_their_value_is() -> None:
    """At 1,000 Hz in steps of 1 ms: value 1 in each, 0 in none, 0.25 in a quarter."""
    settings = IntegrateAndFireParameters(simulated_ms=4000.0)
    drawn = input_spikes(np.array([0.25, 0.0, 1.0]), settings, np.random.default_rng(1))
    counts = np.bincount(drawn['source'], minlength=3)
    assert counts[1:].tolist() == [0, 4000]
    assert abs(counts[0] - 1000) < 4 * math.sqrt(4000 * 0.25 * 0.75)
    assert (np.diff(drawn['step']) >= 0).all()
    slower = IntegrateAndFireParameters(simulated_ms=4000.0, max_rate_hz=500.0)
    drawn = input_spikes(np.array([1.0]), slower, np.random.default_rng(1))
    assert abs(len(drawn) - 2000) < 4 * math.sqrt(4000 * 0.5 * 0.5)


def test_a_seed_gives_the_same_spikes() -> None:
    """Another one others."""
    values, settings = np.full(40, 0.3, np.float32), IntegrateAndFireParameters()
    one, same, other = (
        input_spikes(values, settings, np.random.default_rng(seed)).tolist() for seed in (1, 1, 2)
    )
    assert one == same
    assert one != other


def test_a_normalised_network_never_needs_two_spikes_in_a_step() -> None:
    """With everything that excites firing at once, what is above the threshold is below another.

    Reset by subtraction, which keeps what is above, potentials stay below the threshold.
    """
    rng = np.random.default_rng(2)
    net = drawn_network(rng, 64, 30)
    inputs = spikes(*((step, source) for step in range(200) for source in range(64)))
    for values in (inputs, inputs[rng.random(len(inputs)) < 0.7]):
        potentials, fired = run(net, values, 200, reset='subtract')
        assert max(each.max() for each in potentials) < 1.0
        assert fired.hidden.max() <= 200
    doubled = net._replace(hidden_weights=net.hidden_weights * 4, hidden_bias=net.hidden_bias * 4)
    excited = spikes(
        *((s, i) for s in range(200) for i in np.flatnonzero(net.hidden_weights[0] > 0))
    )
    assert run(doubled, excited, 200, reset='subtract')[0].hidden.max() > 1.0


@pytest.mark.parametrize('reset', ['zero', 'subtract'])
def test_rates_converge_to_the_activations(reset: str) -> None:
    """As 1 / sqrt(time), where weights are a part of the threshold that goes into it whole.

    16 inputs of weight 1 / 16 at most: potentials reach the threshold exactly.
    """
    net = network([[1 / 16], [1 / 4]], [0.0, 0.0], [[1.0, 0.0], [0.0, 1.0]])
    inputs = np.array([[0.6]], np.float32)
    expected = activate(net, inputs)
    assert expected.hidden[0].tolist() == pytest.approx([0.0375, 0.15])
    errors = []
    for duration_ms in (100.0, 1000.0, 10_000.0, 100_000.0):
        settings = IntegrateAndFireParameters(simulated_ms=duration_ms, reset=reset)
        squares = []
        for seed in range(20):
            drawn = input_spikes(inputs[0], settings, np.random.default_rng(seed))
            _, fired = IntegrateAndFire(net, settings).run(resting_potentials(net), drawn)
            squares.append((fired.hidden / settings.steps - expected.hidden[0]) ** 2)
        errors.append(math.sqrt(np.mean(squares)))
    assert errors[0] > 2 * errors[1] > 4 * errors[2] > 8 * errors[3]
    assert errors[3] < 5e-4


def test_rates_of_a_whole_network_converge_when_nothing_is_lost() -> None:
    """Neither above the threshold nor below 0: constant inputs, subtraction, no clamp."""
    rng = np.random.default_rng(3)
    net = drawn_network(rng, 30, 20)
    on = rng.random(30) < 0.5
    expected = activate(net, on[None].astype(np.float32))
    assert (expected.output > 0).any()
    errors = []
    for steps in (100, 1000, 10_000):
        inputs = spikes(
            *((step, source) for step in range(steps) for source in np.flatnonzero(on))
        )
        _, fired = run(net, inputs, steps, reset='subtract', clamped=False)
        hidden = np.abs(fired.hidden / steps - expected.hidden[0]).max()
        output = np.abs(fired.output.mean(axis=0) - np.maximum(expected.output[0], 0)).max()
        errors.append((hidden, output))
        assert hidden <= 1 / steps  # a potential is less than a spike
    assert errors[-1][1] < 5e-3
    assert errors[0][1] > errors[-1][1]


def test_sums_are_exact_in_any_order() -> None:
    """Normalised weights give the same bits, whatever the order of the inputs."""
    rng = np.random.default_rng(6)
    net = drawn_network(rng, 512, 40)
    inputs = spikes(*((0, source) for source in range(512)))
    forwards, _ = run(net, inputs, 1, clamped=False)
    backwards, _ = run(net, inputs[::-1].copy(), 1, clamped=False)
    assert forwards.hidden.tobytes() == backwards.hidden.tobytes()
    exact = [math.fsum(row) for row in np.column_stack([net.hidden_weights, net.hidden_bias])]
    assert forwards.hidden.tolist() == [0.0 if each >= 1 else each for each in exact]


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'simulated_ms': 10.5}, 'simulated_ms: expected a multiple of step_ms = 1 ms, got 10.5'),
        ({'max_rate_hz': 1001.0}, 'max_rate_hz: expected at most one spike in step_ms = 1 ms'),
        ({'reset': 'none'}, "reset: expected one of zero, subtract, got 'none'"),
        ({'threshold_mv': 0.0}, 'threshold_mv: expected a number from 0.001 to 1000000 mV'),
    ],
)
def test_contradictions_are_refused(values: dict[str, object], message: str) -> None:
    """One sentence."""
    with pytest.raises(ParameterError, match=message):
        IntegrateAndFireParameters(**values)  # type: ignore[arg-type]
