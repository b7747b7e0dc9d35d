"""Reads the weights that a training of R-STDP has learnt."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.saved_state import array
from spikelane_controllers.weights import find_checkpoint
from spikelane_sim.errors import CheckpointError

#: Name of the weights [pA] in a checkpoint.
WEIGHTS = 'controller.network.weights_pa'


def read_weights(
    controller: str, name: str, shape: tuple[int, int], low_pa: float, high_pa: float
) -> NDArray[np.float64]:
    """Read weights [pA].

    Args:
        controller: Name of the controller they must be of.
        name: As in `weights.find_checkpoint`.
        shape: (n_neurons, n_inputs) that they must have.
        low_pa: Smallest allowed.
        high_pa: Largest allowed.

    Raises:
        CheckpointError: There are none, or others; the message names the file, what was expected
            and what came.
    """
    file = find_checkpoint(controller, name)
    arrays = read_checkpoint(file, controller).arrays
    try:
        weights_pa = array(arrays, WEIGHTS, np.dtype(np.float64), shape)
    except CheckpointError as error:
        raise CheckpointError(f'{file}: {error}') from None
    if weights_pa.size and not low_pa <= weights_pa.min() <= weights_pa.max() <= high_pa:
        raise CheckpointError(
            f'{file}: {WEIGHTS}: expected from {low_pa:g} to {high_pa:g} pA, '
            f'got from {weights_pa.min():g} to {weights_pa.max():g} pA'
        )
    return weights_pa
