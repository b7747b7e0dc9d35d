"""One update of the Q-network, compiled: `TorchQLearning` computes the same with PyTorch.

States are binary, and few of their inputs are 1. The outputs of the first layer are therefore sums
of few rows of its weights, and the gradient of these weights has few rows. The sums of the next
layers leave out the outputs that rectification has set to 0. Adam and the soft update pass over
the weights once, without the rows of inputs that have never been 1: their gradient was always 0.
Sums are taken in a fixed order and without fused multiply-add, so that the same input gives the
same bits.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.dqn.q_network import add_nonzero, forward, QNetwork
from spikelane_sim.compiled import inner

Flat = NDArray[np.float32]

_MEAN_DECAY = np.float32(0.9)  # Adam's, as in Kingma and Ba 2015
_SQUARE_DECAY = np.float32(0.999)
_EPSILON = np.float32(1e-8)
# Means of gradients that have vanished would become subnormal, which takes ten times as long.
_SMALLEST = np.float32(np.finfo(np.float32).tiny)
_CHUNK = 1024  # weights whose moments stay in the first cache


class Shape(NamedTuple):
    """Number of units of each layer."""

    n_inputs: int
    hidden_1: int
    hidden_2: int
    n_actions: int


def shape_of(network: QNetwork) -> Shape:
    """Return the sizes of a network."""
    weights = network.weights_1, network.weights_2, network.weights_3
    return Shape(len(network.weights_1), *(each.shape[1] for each in weights))


class Learnt(NamedTuple):
    """All that an update changes; weights and biases of all layers, one after the other.

    Attributes:
        weights: Those of the network.
        target: Those of the target network.
        mean: Adam's running mean of the gradient.
        square: Adam's running mean of the squared gradient.
        gradient: Zeros between updates.
        is_moving: Inputs that were 1 in a state that was learnt from, (n_inputs,).
    """

    weights: Flat
    target: Flat
    mean: Flat
    square: Flat
    gradient: Flat
    is_moving: NDArray[np.bool_]


class Rates(NamedTuple):
    """How far an update goes."""

    discount: np.float32
    learning_rate: float
    soft_update: np.float32


@numba.njit(cache=True, error_model='numpy')
def update(  # type: ignore[no-untyped-def]
    learnt, shape, rates, replay, drawn, number
):
    """Change the network by the transitions drawn; return the loss before.

    Args:
        learnt: The `Learnt`.
        shape: The `Shape`.
        rates: The `Rates`.
        replay: The `experience_buffer.Transitions`.
        drawn: Rows of these, (n,).
        number: How many updates there were before.
    """
    size = len(drawn)
    network = layers(learnt.weights, shape)
    states = _active(replay.states, drawn, shape.n_inputs)
    after = _active(replay.next_states, drawn, shape.n_inputs)
    outputs = forward(network, *states)
    best = forward(network, *after)[2]
    worth = forward(layers(learnt.target, shape), *after)[2]
    slopes, loss = np.zeros((size, shape.n_actions), np.float32), np.float32(0.0)
    for n in range(size):
        row, action = drawn[n], np.int64(replay.actions[drawn[n]])
        aim = replay.rewards[row]
        if not replay.is_final[row]:
            aim += rates.discount * worth[n, np.argmax(best[n])]
        error = outputs[2][n, action] - aim
        loss += error * error
        slopes[n, action] = error * np.float32(2 / size)
    _backward(network, layers(learnt.gradient, shape), states, outputs, slopes)
    _note_moving(states, learnt.is_moving)
    _descend(learnt, shape, rates, number + 1)
    return loss / np.float32(size)


@numba.njit(cache=True)
def find_moving(learnt, shape):  # type: ignore[no-untyped-def]
    """Find the inputs whose weights have moved, of what was restored."""
    width = shape.hidden_1
    for i in range(shape.n_inputs):
        learnt.is_moving[i] = False
        for k in range(i * width, (i + 1) * width):
            has_moments = learnt.mean[k] != 0.0 or learnt.square[k] != 0.0
            if has_moments or learnt.weights[k] != learnt.target[k]:
                learnt.is_moving[i] = True
                break


@inner
def layers(flat, shape):  # type: ignore[no-untyped-def]
    """Return the layers' weights and biases without copies; see `q_network.network_views`."""
    n_0, n_1, n_2, n_3 = shape
    end_1 = n_0 * n_1
    end_2 = end_1 + n_1 + n_1 * n_2
    end_3 = end_2 + n_2 + n_2 * n_3
    return (
        flat[:end_1].reshape(n_0, n_1),
        flat[end_1 : end_1 + n_1],
        flat[end_1 + n_1 : end_2].reshape(n_1, n_2),
        flat[end_2 : end_2 + n_2],
        flat[end_2 + n_2 : end_3].reshape(n_2, n_3),
        flat[end_3:],
    )


@inner
def _active(packed, drawn, n_inputs):  # type: ignore[no-untyped-def]
    """Return the inputs that are 1, (n, n_inputs), and how many of each row count, (n,)."""
    active, number = np.empty((len(drawn), n_inputs), np.int32), np.zeros(len(drawn), np.int64)
    for n in range(len(drawn)):
        found = 0
        for k in range(packed.shape[1]):
            byte = np.int64(packed[drawn[n], k])
            for bit in range(8):
                if byte == 0:
                    break
                if byte & 128:
                    active[n, found] = 8 * k + bit
                    found += 1
                byte = (byte << 1) & 255
        number[n] = found
    return active, number


@inner
def _note_moving(states, is_moving):  # type: ignore[no-untyped-def]
    active, number = states
    for n in range(len(number)):
        for k in range(number[n]):
            is_moving[active[n, k]] = True


@inner
def _backward(network, gradient, states, outputs, slopes):  # type: ignore[no-untyped-def]
    """Add the gradients of the mean squared error.

    Args:
        network: The layers.
        gradient: Their gradients, zeros.
        states: Inputs of the first layer that are 1.
        outputs: Outputs of the layers.
        slopes: Derivatives of the error with respect to the values, (n, n_actions).
    """
    first, second, _ = outputs
    active, number = states
    chosen = np.empty(max(len(slopes), second.shape[1]) + 1, np.int32)
    over_second = _into_layer(second, slopes, np.ascontiguousarray(network[4].T), chosen)
    over_first = _into_layer(first, over_second, np.ascontiguousarray(network[2].T), chosen)
    _add_products(gradient[4], second, slopes, chosen)
    _add_products(gradient[2], first, over_second, chosen)
    for n in range(len(slopes)):
        for i in range(len(gradient[5])):
            gradient[5][i] += slopes[n, i]
        for i in range(len(gradient[3])):
            gradient[3][i] += over_second[n, i]
        for i in range(len(gradient[1])):
            gradient[1][i] += over_first[n, i]
        for k in range(number[n]):
            row, slope = gradient[0][active[n, k]], over_first[n]
            for i in range(len(row)):
                row[i] += slope[i]


@inner
def _into_layer(outputs, slopes, transposed, chosen):  # type: ignore[no-untyped-def]
    """Return the slopes over a layer's outputs before rectification, (n, number of units)."""
    into = np.zeros_like(outputs)
    for n in range(len(outputs)):
        add_nonzero(into[n], slopes[n], transposed, chosen)
        for i in range(outputs.shape[1]):
            if outputs[n, i] <= 0.0:
                into[n, i] = 0.0
    return into


@inner
def _add_products(gradient, inputs, slopes, chosen):  # type: ignore[no-untyped-def]
    """Add the gradient of a layer's weights."""
    turned = np.ascontiguousarray(inputs.T)
    for i in range(len(gradient)):
        add_nonzero(gradient[i], turned[i], slopes, chosen)


@inner(error_model='numpy')
def _descend(learnt, shape, rates, number):  # type: ignore[no-untyped-def]
    """Take the step of Adam, and move the target network."""
    step = np.float32(rates.learning_rate / (1 - 0.9**number))
    root = np.float32(np.sqrt(1 - 0.999**number))
    width, first = shape.hidden_1, 0
    while first < shape.n_inputs:
        last = first
        while last < shape.n_inputs and learnt.is_moving[last]:
            last += 1
        _adam(learnt, first * width, last * width, step, root, rates.soft_update)
        first = last + 1
    _adam(learnt, shape.n_inputs * width, len(learnt.weights), step, root, rates.soft_update)


@inner(error_model='numpy')
def _adam(learnt, start, end, step, root, soft_update):  # type: ignore[no-untyped-def]
    """Do so for the weights from start to end."""
    while start < end:
        part = slice(start, min(start + _CHUNK, end))
        mean, square, gradient = learnt.mean[part], learnt.square[part], learnt.gradient[part]
        weights, target = learnt.weights[part], learnt.target[part]
        for i in range(len(mean)):
            slope = gradient[i]
            new = mean[i] + (slope - mean[i]) * (np.float32(1) - _MEAN_DECAY)
            mean[i] = np.float32(0) if abs(new) < _SMALLEST else new
            new = square[i] * _SQUARE_DECAY + slope * slope * (np.float32(1) - _SQUARE_DECAY)
            square[i] = np.float32(0) if new < _SMALLEST else new
        for i in range(len(mean)):
            weights[i] -= step * mean[i] / (np.sqrt(square[i]) / root + _EPSILON)
        for i in range(len(mean)):
            target[i] += (weights[i] - target[i]) * soft_update
        gradient[:] = np.float32(0)
        start += _CHUNK


def make_learnt(number: int, n_inputs: int) -> Learnt:
    """Return zeros for so many weights."""
    return Learnt(
        weights=np.zeros(number, np.float32),
        target=np.zeros(number, np.float32),
        mean=np.zeros(number, np.float32),
        square=np.zeros(number, np.float32),
        gradient=np.zeros(number, np.float32),
        is_moving=np.zeros(n_inputs, np.bool_),
    )
