"""Poisson spikes: how the counts of an image enter a spiking network (paper section 4.2).

Each cell of the image drives one input, whose rate is proportional to the cell's events and
constant for a step. The inputs together are one Poisson process of the summed rate, each of its
spikes belonging to an input with a probability proportional to that input's rate, at a uniform
time. So a step takes one Poisson and one uniform number per spike, and an input may spike several
times in a grid step, as often as a generator that draws a Poisson number for every grid step.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numba
from numba.extending import register_jitable
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking.spikes import GRID_MS, GRID_STEPS, SPIKE_DTYPE, Spikes
from spikelane_sim.encoding import Counts, EncodingParameters
from spikelane_sim.parameters import check_size, parameter, Parameters

_TABLE = 'table "Simulation parameters specification"'


@dataclasses.dataclass(frozen=True, kw_only=True)
class PoissonParameters(Parameters):
    """Rate of an input: proportional to the events in its cell, up to a largest rate."""

    max_rate_hz: float = parameter(
        300.0, 'Largest firing rate of an input.', unit='Hz', low=0.0, high=1e4, source=_TABLE
    )
    max_events: int = parameter(
        15,
        'Events in one cell and 50 ms at which an input reaches its largest rate.',
        low=1,
        high=1_000_000,
        source=_TABLE,
    )


class PoissonScale(NamedTuple):
    """The fields of `PoissonParameters`, for kernels."""

    max_rate_hz: float
    max_events: int


def check_spikes(
    parameters: PoissonParameters, encoding: EncodingParameters, period_s: float
) -> None:
    """Check that the spikes of all inputs can be drawn in a reasonable time.

    Raises:
        ParameterError: There would be too many; each is compared with each input.
    """
    inputs = encoding.rows * encoding.columns
    check_size(
        'comparisons in a step',
        {
            'spikes (poisson.max_rate_hz)': parameters.max_rate_hz * period_s * inputs,
            'inputs (encoding.width, encoding.height, encoding.cell)': inputs,
        },
        1e8,
    )


@register_jitable
def firing_rates(
    counts: Counts, parameters: PoissonParameters, share: float = 1.0
) -> NDArray[np.float64]:
    """Return the rate of each input [Hz]: max_rate_hz min(counts / max_events, 1).

    Args:
        counts: Events in each cell, (rows, columns).
        parameters: The scale; in a kernel a named tuple of the same fields.
        share: Length of the step in steps of 50 ms, for which max_events is.

    Returns:
        Rates [Hz] in the order of rows, then columns, (rows * columns,).
    """
    most = parameters.max_events * share
    return np.minimum(counts, most).ravel() * (parameters.max_rate_hz / most)


@register_jitable
def poisson_spikes(
    rates_hz: NDArray[np.float64], rng: np.random.Generator, window: int = GRID_STEPS
) -> Spikes:
    """Draw spikes at constant rates.

    Args:
        rates_hz: Rate of each input [Hz], (n_inputs,), at least 0.
        rng: Where the numbers come from.
        window: Grid steps to draw for.
    """
    cumulative = rates_hz.cumsum()
    expected = cumulative[-1] * (window * GRID_MS / 1000)
    uniforms = rng.random(rng.poisson(expected))
    return _place(uniforms, cumulative, window)  # type: ignore[no-any-return]


@numba.njit(cache=True)
def _place(uniforms: NDArray[np.float64], cumulative: NDArray[np.float64], window: int) -> Spikes:
    """Give each uniform number an input, and a grid step by where in the input's share it lies."""
    spikes = np.empty(len(uniforms), SPIKE_DTYPE)
    positions = np.zeros(window + 1, np.int64)  # in the order of grid steps: a counting sort
    for k, uniform in enumerate(uniforms):
        place = uniform * cumulative[-1]
        source = 0
        for bound in cumulative:  # quicker than a bisection, which branches unpredictably
            source += place >= bound
        below = cumulative[source - 1] if source > 0 else 0.0
        share = (place - below) / (cumulative[source] - below)
        step = min(int(share * window), window - 1)
        spikes['step'][k], spikes['source'][k] = step, source
        positions[step + 1] += 1
    for step in range(window):
        positions[step + 1] += positions[step]
    in_order = np.empty_like(spikes)
    for k, step in enumerate(spikes['step']):
        in_order[positions[step]] = spikes[k]
        positions[step] += 1
    return in_order
