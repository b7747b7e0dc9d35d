"""The paper's weights set by hand, and how like them learnt weights are (section 5.3).

One controller drives with these weights; what another one learns is compared with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking.steering import MOTOR_NEURONS
from spikelane_sim.errors import SpikelaneError

# fmt: off
#: From the cells of the image's left half to the left neuron [pA], row by row (figure
#: "Scenario 1: Braitenberg network weights").
LEFT_WEIGHTS_PA = (
    250.0,  250.0,  250.0,  500.0,
    250.0,  250.0,  500.0,  1000.0,
    250.0,  500.0,  1000.0, 1500.0,
    500.0,  1000.0, 1500.0, 2000.0,
)
# fmt: on

_ROWS = 4


def mirrored(left_pa: Sequence[float], rows: int) -> NDArray[np.float64]:
    """Return weights to both motor neurons: the right one's are the mirror of the left one's.

    Args:
        left_pa: From the image's left half to the left neuron [pA], row by row.
        rows: Rows of cells.

    Returns:
        To the left and the right neuron [pA], (2, n_inputs); each half of the image has weights to
        the neuron of its side alone.
    """
    half = np.reshape(left_pa, (rows, -1))
    left = np.hstack([half, np.zeros_like(half)])
    return np.stack([left.ravel(), left[:, ::-1].ravel()])


def weights_correlation(
    weights_pa: NDArray[Any], initial_pa: NDArray[Any] | None = None
) -> dict[str, float | None]:
    """Compare learnt weights with those set by hand, by correlation.

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
    by_hand = mirrored(LEFT_WEIGHTS_PA, _ROWS)
    if weights_pa.shape != by_hand.shape:
        raise SpikelaneError(
            f'weights: expected {by_hand.shape[0]} x {by_hand.shape[1]}, as those set by hand, '
            f'got {" x ".join(map(str, weights_pa.shape))}'
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
        **{name: (weights_pa[i], by_hand[i]) for i, name in enumerate(MOTOR_NEURONS)},
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
