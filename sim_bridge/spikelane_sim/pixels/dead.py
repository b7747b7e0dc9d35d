"""Dead pixels: they give no events, whatever they see."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.events import Events


def dead_pixels(share: float, seed: int, width: int, height: int) -> NDArray[np.bool_]:
    """Return which pixels are dead; a larger share has those of a smaller one with it.

    Args:
        share: Share of the pixels.
        seed: Determines which.
        width: Columns of the image [px].
        height: Rows of the image [px].

    Returns:
        One value for each pixel, row by row, (height * width,).
    """
    dead = np.zeros(width * height, np.bool_)
    order = np.random.default_rng(seed).permutation(len(dead))
    dead[order[: round(share * len(dead))]] = True
    return dead


def without_dead(events: Events, dead: NDArray[np.bool_], width: int) -> Events:
    """Return the events of the pixels that live."""
    living = events.copy()
    return living[: keep_living(dead, width, living)]


@numba.njit(cache=True)
def keep_living(dead, width, events):  # type: ignore[no-untyped-def]
    """Move the events of pixels that live to the front; return how many.

    Args:
        dead: Which pixels are dead, (height * width,).
        width: Columns of the image [px].
        events: Events of a step; changed in place.
    """
    kept = 0
    for k in range(len(events)):
        if not dead[np.int64(events[k].y) * width + np.int64(events[k].x)]:
            if kept != k:
                events[kept] = events[k]
            kept += 1
    return kept
