"""Model-based weight normalisation (paper section 3.5, algorithm 1; Diehl et al. 2015).

Each layer is divided by the largest input that any of its neurons can get when everything that
excites it fires at once. Then no neuron gets more than its threshold in a time step, and so none
would have to fire twice in one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.feedforward import FeedForward
from spikelane_sim.errors import SpikelaneError

#: Normalised weights are multiples of this. Sums of them are exact in double precision, and in
#: single precision below 16, in whatever order a simulator adds: all get the same spikes.
GRID = 2.0**-20

Weights = NDArray[np.float32]


class NormalisationError(SpikelaneError):
    """Weights cannot be normalised."""

    exit_status = 1


class Normalised(NamedTuple):
    """A network of which no neuron's input exceeds 1, and what its layers were divided by."""

    network: FeedForward
    hidden_divisor: float
    output_divisor: float


def largest_input(weights: Weights, bias: Weights | None = None) -> float:
    """Return the largest sum of positive weights of any neuron, a positive bias counted.

    Args:
        weights: Of a layer, (n_neurons, n_inputs).
        bias: Of its neurons, (n_neurons,), or None.
    """
    sums = np.maximum(weights, 0).sum(axis=1, dtype=np.float64)
    if bias is not None:
        sums = sums + np.maximum(bias, 0)
    return float(sums.max())


def normalise(network: FeedForward) -> Normalised:
    """Divide each layer by its largest possible input (algorithm 1).

    The weights are rounded towards zero to multiples of GRID, so that no sum exceeds 1. Outputs
    keep their order: the first layer's divisor scales the second one's inputs alike.

    Raises:
        NormalisationError: No weight of a layer is positive.
    """
    hidden = _divisor('hidden', network.hidden_weights, network.hidden_bias)
    output = _divisor('output', network.output_weights, None)
    return Normalised(
        FeedForward(
            _scaled(network.hidden_weights, hidden),
            _scaled(network.hidden_bias, hidden),
            _scaled(network.output_weights, output),
        ),
        hidden,
        output,
    )


def _divisor(name: str, weights: Weights, bias: Weights | None) -> float:
    divisor = largest_input(weights, bias)
    if not divisor > 0:
        raise NormalisationError(f'{name} layer: expected a positive weight, got none')
    return divisor


def _scaled(weights: Weights, divisor: float) -> Weights:
    scaled = weights.astype(np.float64) / divisor
    on_grid: Weights = (np.trunc(scaled / GRID) * GRID).astype(np.float32)
    return on_grid
