"""The grid of time on which spikes happen, and arrays of spikes.

Grid step k of a window lasts from k h to (k + 1) h after the window's start; a spike "in" it is
one at its end.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.compiled import uncounted
from spikelane_sim.errors import ParameterError
from spikelane_sim.period import PERIOD_MS

#: Grid on which the neurons are integrated [ms] (paper table: time resolution).
GRID_MS = 0.1
#: Grid steps in a step of 50 ms.
GRID_STEPS = round(PERIOD_MS / GRID_MS)

#: A spike: its grid step, 0 the window's first, and the index of the input or neuron that fired.
SPIKE_DTYPE = np.dtype([('step', '<i8'), ('source', '<i8')])

Spikes = NDArray[np.void]  # of SPIKE_DTYPE, in the order of grid steps, (n_spikes,)


def grid_steps(name: str, duration_ms: float) -> int:
    """Return how many grid steps last duration_ms.

    Raises:
        ParameterError: It is not a multiple of the grid step.
    """
    steps = round(duration_ms / GRID_MS)
    if abs(steps * GRID_MS - duration_ms) > 1e-9:
        raise ParameterError(f'{name}: expected a multiple of {GRID_MS:g} ms, got {duration_ms:g}')
    return steps


def no_spikes() -> Spikes:
    """Return an empty array of spikes."""
    return np.empty(0, SPIKE_DTYPE)


def spike_counts(spikes: Spikes, sources: int) -> tuple[int, ...]:
    """Return how often each of `sources` inputs or neurons fired."""
    return tuple(np.bincount(spikes['source'], minlength=sources).tolist())


@uncounted
def take_up(flying: Spikes, n_flying: int, inputs: Spikes) -> int:
    """Let the spikes of inputs fly, too; return how many fly now."""
    for k in range(len(inputs)):
        flying[n_flying + k] = inputs[k]
    return n_flying + len(inputs)
