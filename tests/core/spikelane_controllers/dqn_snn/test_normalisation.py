"""Model-based weight normalisation, by hand on tiny networks."""

from __future__ import annotations

import numpy as np
import pytest

from spikelane_controllers.dqn_snn.feedforward import activate, FeedForward
from spikelane_controllers.dqn_snn.normalisation import (
    GRID,
    largest_input,
    NormalisationError,
    normalise,
)


def network(hidden: object, bias: object, output: object) -> FeedForward:
    """Make a network of lists."""
    return FeedForward(*(np.array(each, np.float32) for each in (hidden, bias, output)))


#: Positive sums: 1 + 3 = 4 and 2 + 6 (bias) = 8 in the hidden layer; 5 and 2 + 0.5 in the output.
TINY = network([[1, 3, -7], [2, -4, -1]], [-2, 6], [[5, -3], [2, 0.5]])


def test_the_largest_input_is_a_sum_of_positive_weights() -> None:
    """A positive bias counts, a negative one does not."""
    assert largest_input(TINY.hidden_weights) == 4.0
    assert largest_input(TINY.hidden_weights, TINY.hidden_bias) == 8.0
    assert largest_input(np.array([[-1.0, -2.0], [-3.0, 0.25]])) == 0.25


def test_each_layer_is_divided_by_its_largest_input() -> None:
    """Negative weights and biases too; all are multiples of the grid here."""
    network, hidden, output = normalise(TINY)
    assert (hidden, output) == (8.0, 5.0)
    assert network.hidden_weights.tolist() == [[0.125, 0.375, -0.875], [0.25, -0.5, -0.125]]
    assert network.hidden_bias.tolist() == [-0.25, 0.75]
    expected = np.array([[1.0, -0.6], [0.4, 0.1]])
    assert (network.output_weights <= np.where(expected > 0, expected, 0)).all()
    assert np.abs(network.output_weights - expected).max() < 2**-20


def test_the_answers_are_the_same_but_for_a_factor() -> None:
    """So the largest output stays the largest."""
    rng = np.random.default_rng(4)
    drawn = network(*(rng.normal(size=shape) for shape in ((6, 9), (6,), (3, 6))))
    inputs = rng.random((50, 9), np.float32)
    normalised, hidden, output = normalise(drawn)
    before, after = activate(drawn, inputs), activate(normalised, inputs)
    assert after.hidden * hidden == pytest.approx(before.hidden, abs=1e-3)
    assert after.output * (hidden * output) == pytest.approx(before.output, abs=1e-3)


@pytest.mark.parametrize('seed', range(20))
def test_no_neuron_can_get_more_than_its_threshold(seed: int) -> None:
    """Not even by rounding, and the neuron with most gets it almost."""
    rng = np.random.default_rng(seed)
    drawn = network(*(rng.normal(size=shape) for shape in ((20, 512), (20,), (3, 20))))
    scaled, _, _ = normalise(drawn)
    for weights, bias in (
        (scaled.hidden_weights, scaled.hidden_bias),
        (scaled.output_weights, np.zeros(3)),
    ):
        most = [
            sum(w for w in row if w > 0) + max(b, 0)
            for row, b in zip(weights.astype(float).tolist(), bias.tolist(), strict=True)
        ]
        assert 1 - 513 * 2**-20 <= max(most) <= 1


def test_normalised_weights_are_multiples_of_the_grid() -> None:
    """So that every simulator's sums are exact; those below -1 as well."""
    rng = np.random.default_rng(0)
    drawn = network(*(rng.normal(size=shape) - 0.5 for shape in ((9, 30), (9,), (3, 9))))
    for values in normalise(drawn).network:
        assert values.dtype == np.float32
        multiples = values.astype(np.float64) * 2**20
        assert (multiples == np.rint(multiples)).all()
    assert GRID == 2**-20


def test_by_data_activations_become_one_at_most() -> None:
    """By hand: 8 is the largest hidden activation, 6 / 8 the largest output for it as 1."""
    values = np.array([[1, 1, 0], [1, 0, 0]], np.float32)
    before = activate(TINY, values)
    assert before.hidden.tolist() == [[2.0, 4.0], [0.0, 8.0]]
    assert before.output.tolist() == [[-2.0, 6.0], [-24.0, 4.0]]
    network, hidden, output = normalise(TINY, values)
    assert (hidden, output) == (8.0, 0.75)
    after = activate(network, values)
    assert after.hidden.tolist() == [[0.25, 0.5], [0.0, 1.0]]
    assert after.output.max() == pytest.approx(1.0, abs=1e-5)
    assert largest_input(network.output_weights) > 1


@pytest.mark.parametrize('layer', ['hidden', 'output'])
def test_a_layer_that_nothing_excites_is_refused(layer: str) -> None:
    """It would be divided by 0."""
    one = {'hidden': -1.0, 'output': 1.0} if layer == 'hidden' else {'hidden': 1.0, 'output': 0.0}
    silent = network([[one['hidden']]], [0.0], [[one['output']]])
    with pytest.raises(
        NormalisationError, match=f'{layer} layer: expected something to excite it'
    ):
        normalise(silent)
