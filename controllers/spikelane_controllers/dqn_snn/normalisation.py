"""Weight normalisation (paper section 3.5, algorithm 1; Diehl et al. 2015).

Model-based, each layer is divided by the largest input that any of its neurons can get when
everything that excites it fires at once. Then no neuron gets more than its threshold in a time
step, and so none would have to fire twice in one. Weights that are learnt for long are large, and
what is divided by so much hardly ever fires.

Data-based, each layer is divided by the largest activation on some data, which is much less. Rates
are then at most 1 on average; in a single time step a neuron may get more than its threshold.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.dqn_snn.feedforward import activate, FeedForward
from spikelane_sim.errors import SpikelaneError

#: Normalised weights are multiples of this. Sums of them are exact in double precision, and in
#: single precision below 16, in whatever order a simulator adds: all get the same spikes.
GRID = 2.0**-20

Weights = NDArray[np.float32]


class NormalisationError(SpikelaneError):
    """Weights cannot be normalised."""

    exit_status = 1


class Normalised(NamedTuple):
    """A normalised network, and what its layers were divided by."""

    network: FeedForward
    hidden_divisor: float
    output_divisor: float


def largest_input(weights: Weights, bias: Weights | None = None) -> float:
    """Return the largest sum of positive weights of any neuron, a positive bias counted.

    Args:
        weights: Weights of a layer, (n_neurons, n_inputs).
        bias: Biases of its neurons, (n_neurons,), or None.
    """
    sums = np.maximum(weights, 0).sum(axis=1, dtype=np.float64)
    if bias is not None:
        sums = sums + np.maximum(bias, 0)
    return float(sums.max())


def normalise(network: FeedForward, values: NDArray[np.float32] | None = None) -> Normalised:
    """Divide each layer by its largest possible input (algorithm 1), or by that on data.

    The weights are rounded towards zero to multiples of GRID, so that no sum exceeds what it was
    to be. Outputs keep their order: the first layer's divisor scales the second one's inputs
    alike.

    Args:
        network: As it was trained.
        values: Inputs to take the largest activations on, (n, n_inputs); None for those that
            are possible.

    Raises:
        NormalisationError: Nothing excites a layer.
    """
    if values is None:
        hidden = largest_input(network.hidden_weights, network.hidden_bias)
        output = largest_input(network.output_weights)
    else:
        activations = activate(network, values)
        hidden = float(activations.hidden.max())
        output = float(activations.output.max()) / (hidden or 1.0)
    for name, divisor in (('hidden', hidden), ('output', output)):
        if not divisor > 0:
            raise NormalisationError(f'{name} layer: expected something to excite it, got nothing')
    return Normalised(
        FeedForward(
            _scaled(network.hidden_weights, hidden),
            _scaled(network.hidden_bias, hidden),
            _scaled(network.output_weights, output),
        ),
        hidden,
        output,
    )


def _scaled(weights: Weights, divisor: float) -> Weights:
    scaled = weights.astype(np.float64) / divisor
    on_grid: Weights = (np.trunc(scaled / GRID) * GRID).astype(np.float32)
    return on_grid
