"""How like the Braitenberg controller's weights, set by hand, learnt weights are."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.braitenberg.controller import (
    Braitenberg,
    braitenberg_weights,
    BraitenbergParameters,
)
from spikelane_sim.errors import SpikelaneError


def weights_correlation(
    weights_pa: NDArray[Any], initial_pa: NDArray[Any] | None = None
) -> dict[str, float | None]:
    """Compare learnt weights with the Braitenberg controller's, set by hand, by correlation.

    Args:
        weights_pa: To the left and the right neuron [pA], (2, 32), of the default image's cells.
        initial_pa: What they were before training. An input that never saw an event kept its
            weights exactly; given these, such inputs are left out of a second comparison.

    Returns:
        Pearson's correlation of each neuron's weights (`left`, `right`) and of all (`overall`);
        with `initial_pa` the same without inputs that saw no events (`left_seen`, ...) and how
        many inputs saw some (`inputs_seen`). None where weights do not differ among themselves.

    Raises:
        SpikelaneError: The weights are of another shape.
    """
    by_hand = braitenberg_weights(BraitenbergParameters())
    if weights_pa.shape != by_hand.shape:
        raise SpikelaneError(
            f'weights: expected {by_hand.shape[0]} x {by_hand.shape[1]}, as the Braitenberg '
            f'controller has, got {" x ".join(map(str, weights_pa.shape))}'
        )
    result = _correlations(weights_pa, by_hand, '')
    if initial_pa is not None:
        seen = _saw_events(weights_pa, initial_pa)
        result |= _correlations(weights_pa[:, seen], by_hand[:, seen], '_seen')
        result['inputs_seen'] = int(seen.sum())
    return result


def _correlations(
    weights_pa: NDArray[Any], by_hand: NDArray[np.float64], suffix: str
) -> dict[str, float | None]:
    pairs = {
        **{name: (weights_pa[i], by_hand[i]) for i, name in enumerate(Braitenberg.neurons)},
        'overall': (weights_pa.ravel(), by_hand.ravel()),
    }
    return {name + suffix: _pearson(*pair) for name, pair in pairs.items()}


def _pearson(first: NDArray[Any], second: NDArray[Any]) -> float | None:
    if not len(first) or np.ptp(first) == 0 or np.ptp(second) == 0:
        return None
    return float(np.corrcoef(first.astype(np.float64), second)[0, 1])


def _saw_events(weights_pa: NDArray[Any], initial_pa: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which inputs' weights moved, in the precision in which histories are kept."""
    moved = weights_pa.astype(np.float32) != initial_pa.astype(np.float32)
    seen: NDArray[np.bool_] = moved.any(axis=0)
    return seen
