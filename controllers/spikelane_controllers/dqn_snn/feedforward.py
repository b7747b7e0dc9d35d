"""The feed-forward network whose weights a spiking network takes over (paper section 3.5).

One hidden layer; rectified linear units in the hidden and the output layer. The hidden layer has
biases, so that an image without events has an answer too; the output layer has none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class FeedForward(NamedTuple):
    """Weights of the network; spiking or not, they are called the same."""

    hidden_weights: NDArray[np.float32]  # (n_hidden, n_inputs)
    hidden_bias: NDArray[np.float32]  # (n_hidden,)
    output_weights: NDArray[np.float32]  # (n_outputs, n_hidden)


class Activations(NamedTuple):
    """What the units of a network do on some inputs."""

    hidden: NDArray[np.float32]  # (n, n_hidden), at least 0
    output: NDArray[np.float32]  # (n, n_outputs), before rectification


def activate(network: FeedForward, inputs: NDArray[np.float32]) -> Activations:
    """Compute the network.

    Args:
        network: Weights.
        inputs: Values from 0 to 1, (n, n_inputs).

    Returns:
        Activations; those of the output layer are not rectified, so that they tell actions apart
        also where all are negative.
    """
    hidden = np.maximum(inputs @ network.hidden_weights.T + network.hidden_bias, 0)
    return Activations(hidden, hidden @ network.output_weights.T)
