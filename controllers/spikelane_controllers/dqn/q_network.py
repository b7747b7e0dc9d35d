"""The Q-network: values of the actions in a state (paper section 3.4).

Three fully connected layers, the first two rectified. States are binary, so that the first layer
is a sum of few rows of its weights: a value takes microseconds, without torch, which only learning
needs. Sums are always taken in the same order, so that the same network gives the same bits,
one state at a time or many.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
import itertools
import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.operations import Operations
from spikelane_sim.compiled import copy, inner
from spikelane_sim.parameters import parameter, Parameters

Array = NDArray[np.float32]


class QNetwork(NamedTuple):
    """Weights (n_inputs, n_outputs) and biases (n_outputs,) of the layers."""

    weights_1: Array
    biases_1: Array
    weights_2: Array
    biases_2: Array
    weights_3: Array
    biases_3: Array


#: In one network: training keeps four times as many numbers of 4 bytes.
MOST_WEIGHTS = 40_000_000


@dataclasses.dataclass(frozen=True, kw_only=True)
class QNetworkParameters(Parameters):
    """Size and beginning of the Q-network."""

    hidden_1: int = parameter(
        200,
        'Number of units in the first hidden layer.',
        low=1,
        high=16_384,
        source='table "DQN parameters"',
    )
    hidden_2: int = parameter(
        200,
        'Number of units in the second hidden layer.',
        low=1,
        high=16_384,
        source='table "DQN parameters"',
    )
    initial_bound: float = parameter(
        0.0,
        'Initial weights and biases are drawn uniformly from minus this bound to this bound '
        "(1e-3 in the authors' program); 0: the bound is 1 / sqrt(inputs of the layer), "
        "PyTorch's default.",
        low=0.0,
        high=100.0,
    )


def initial_network(
    rng: np.random.Generator, n_inputs: int, n_actions: int, parameters: QNetworkParameters
) -> QNetwork:
    """Draw a network."""
    sizes = (n_inputs, parameters.hidden_1, parameters.hidden_2, n_actions)
    arrays = []
    for n_in, n_out in itertools.pairwise(sizes):
        bound = parameters.initial_bound or 1 / math.sqrt(n_in)
        for shape in ((n_in, n_out), (n_out,)):
            arrays.append(rng.uniform(-bound, bound, shape).astype(np.float32))
    return QNetwork(*arrays)


def network_views(flat: Array, shapes: Sequence[tuple[int, ...]]) -> QNetwork:
    """Return the arrays of a network that lie one after the other in `flat`, without copies."""
    ends = np.cumsum([math.prod(shape) for shape in shapes])
    parts = np.split(flat, ends[:-1])
    return QNetwork(*(part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)))


def flat_weights(network: QNetwork) -> Array:
    """Return copies of the arrays of a network, one after the other."""
    return np.concatenate([part.ravel() for part in network])


def action_values(network: QNetwork, states: NDArray[np.uint8]) -> Array:
    """Return the values of all actions.

    Args:
        network: The network.
        states: Binary, (n, n_inputs).

    Returns:
        (n, n_actions).
    """
    values: Array = _values(*network, states)
    return values


def greedy_action(network: QNetwork, state: NDArray[np.uint8]) -> int:
    """Return the action of the largest value, the first of equals, in a state (n_inputs,)."""
    return int(action_values(network, state[None])[0].argmax())


def decision_operations(network: QNetwork, state: NDArray[np.uint8]) -> Operations:
    """Count what a decision in a state (n_inputs,) takes: every weight once, biases left out."""
    return network_operations(network, 1, int(np.count_nonzero(state)))


def network_operations(network: QNetwork, decisions: int, active: int) -> Operations:
    """Count what some decisions take, whose states had `active` inputs of 1 in sum."""
    first, *others = (weights.size for weights in network[::2])
    return Operations(
        decisions=decisions,
        multiply_accumulates=decisions * (first + sum(others)),
        active_inputs=active,
        active_multiply_accumulates=active * network.weights_1.shape[1] + decisions * sum(others),
    )


@inner
def add_rows(sums, factors, rows, chosen, number):  # type: ignore[no-untyped-def]
    """Add factors[i] * rows[i] for the chosen i, in their order; four of them in one pass."""
    k = 0
    while k + 4 <= number:
        a, b, c, d = chosen[k], chosen[k + 1], chosen[k + 2], chosen[k + 3]
        by_a, by_b, by_c, by_d = factors[a], factors[b], factors[c], factors[d]
        row_a, row_b, row_c, row_d = rows[a], rows[b], rows[c], rows[d]
        for j in range(len(sums)):
            total = sums[j] + by_a * row_a[j]
            total += by_b * row_b[j]
            total += by_c * row_c[j]
            sums[j] = total + by_d * row_d[j]
        k += 4
    while k < number:
        by_a, row_a = factors[chosen[k]], rows[chosen[k]]
        for j in range(len(sums)):
            sums[j] += by_a * row_a[j]
        k += 1


@inner
def add_nonzero(sums, factors, rows, chosen):  # type: ignore[no-untyped-def]
    """Add factors[i] * rows[i] for all i whose factor is not 0; `chosen` is overwritten."""
    number = 0
    for i in range(len(factors)):
        chosen[number] = i
        number += factors[i] != 0.0
    add_rows(sums, factors, rows, chosen, number)


@inner
def _rectify(values):  # type: ignore[no-untyped-def]
    """Set negative values to 0."""
    for i in range(len(values)):
        if values[i] < 0.0:  # what is not a number stays so
            values[i] = 0.0


@inner
def forward(network, active, number):  # type: ignore[no-untyped-def]
    """Return the outputs of the three layers, (n, number of units).

    Args:
        network: The layers.
        active: Inputs that are 1, (n, n_inputs).
        number: How many of each row count, (n,).
    """
    weights_1, biases_1, weights_2, biases_2, weights_3, biases_3 = network
    first = np.empty((len(number), len(biases_1)), np.float32)
    second = np.empty((len(number), len(biases_2)), np.float32)
    values = np.empty((len(number), len(biases_3)), np.float32)
    ones = np.ones(len(weights_1), np.float32)
    chosen = np.empty(max(first.shape[1], second.shape[1]) + 1, np.int32)
    for n in range(len(number)):
        copy(biases_1, first[n])
        copy(biases_2, second[n])
        copy(biases_3, values[n])
        add_rows(first[n], ones, weights_1, active[n], number[n])
        _rectify(first[n])
        add_nonzero(second[n], first[n], weights_2, chosen)
        _rectify(second[n])
        for i in range(second.shape[1]):
            for action in range(values.shape[1]):
                values[n, action] += second[n, i] * weights_3[i, action]
    return first, second, values


@inner
def values_of(network, states):  # type: ignore[no-untyped-def]
    """Return `action_values`, compiled; `network` is the tuple of its arrays."""
    active, number = np.empty(states.shape, np.int32), np.zeros(len(states), np.int64)
    for n in range(len(states)):
        for i in range(states.shape[1]):
            if states[n, i]:
                active[n, number[n]] = i
                number[n] += 1
    return forward(network, active, number)[2]


@numba.njit(cache=True)
def _values(
    w1: Array, b1: Array, w2: Array, b2: Array, w3: Array, b3: Array, states: NDArray[np.uint8]
) -> Array:
    return values_of((w1, b1, w2, b2, w3, b3), states)  # type: ignore[no-any-return]
