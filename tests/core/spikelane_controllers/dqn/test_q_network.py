"""The Q-network: its values, and how it begins."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from spikelane_controllers.dqn.q_network import (
    action_values,
    greedy_action,
    initial_network,
    network_views,
    QNetwork,
    QNetworkParameters,
)

#: Two inputs, two and two hidden units, three actions; small enough to be computed by hand.
SMALL = QNetwork(
    *(
        np.array(values, np.float32)
        for values in (
            [[1, -1], [2, 3]],
            [0.5, 0.0],
            [[1, 0], [-1, 2]],
            [0, -1],
            [[1, 0, -1], [0, 2, 0]],
            [0, 0, 0.25],
        )
    )
)


@pytest.mark.parametrize(
    ('state', 'values'),
    [
        ([0, 0], [0.5, 0, -0.25]),  # hidden 0.5 0, then 0.5 0
        ([1, 0], [1.5, 0, -1.25]),  # hidden 1.5 0, then 1.5 0
        ([0, 1], [0, 10, 0.25]),  # hidden 2.5 3, then 0 5
        ([1, 1], [1.5, 6, -1.25]),  # hidden 3.5 2, then 1.5 3
    ],
)
def test_values_are_those_computed_by_hand(state: list[int], values: list[float]) -> None:
    """The largest one's action is chosen."""
    got = action_values(SMALL, np.array([state], np.uint8))
    assert got.tolist() == [values]
    assert greedy_action(SMALL, np.array(state, np.uint8)) == values.index(max(values))


def test_values_are_those_of_torch() -> None:
    """The network has the paper's size; many states at once give the bits of one at a time."""
    rng = np.random.default_rng(1)
    network = initial_network(rng, 512, 3, QNetworkParameters())
    states = (rng.random((50, 512)) < 0.05).astype(np.uint8)
    values = action_values(network, states)
    layers = [torch.tensor(each) for each in network]
    x = torch.tensor(states, dtype=torch.float32)
    for weights, biases in zip(layers[:4:2], layers[1:4:2], strict=True):
        x = torch.relu(x @ weights + biases)
    np.testing.assert_allclose(values, (x @ layers[4] + layers[5]).numpy(), rtol=1e-4, atol=1e-6)
    one_by_one = [action_values(network, state[None])[0] for state in states]
    assert np.array_equal(values, one_by_one)


def test_a_network_begins_as_torch_begins_one() -> None:
    """Uniformly within 1 / sqrt(inputs), or within a given bound."""
    shapes = [(512, 200), (200,), (200, 200), (200,), (200, 3), (3,)]
    network = initial_network(np.random.default_rng(0), 512, 3, QNetworkParameters())
    assert [each.shape for each in network] == shapes
    assert {each.dtype for each in network} == {np.dtype(np.float32)}
    for each, inputs in zip(network[:4], (512, 512, 200, 200), strict=True):
        assert 0.95 * inputs**-0.5 < np.abs(each).max() <= inputs**-0.5
        assert abs(each.mean()) < 0.1 * inputs**-0.5
    narrow = QNetworkParameters(initial_bound=1e-3, hidden_1=7)
    network = initial_network(np.random.default_rng(0), 512, 3, narrow)
    assert network.weights_1.shape == (512, 7)
    assert all(np.abs(each).max() <= np.float32(1e-3) for each in network)
    assert np.abs(network.weights_1).max() > 9e-4


def test_views_share_the_memory() -> None:
    """One number after the other, none copied."""
    flat = np.arange(13, dtype=np.float32)
    network = network_views(flat, [(2, 2), (2,), (2, 1), (1,), (1, 3), (1,)])
    assert network.weights_1.tolist() == [[0, 1], [2, 3]]
    assert network.biases_3.tolist() == [12]
    flat[4] = -1
    assert network.biases_1.tolist() == [-1, 5]
