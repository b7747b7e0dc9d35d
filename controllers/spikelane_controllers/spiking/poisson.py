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
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking.spikes import GRID_MS, GRID_STEPS, SPIKE_DTYPE, Spikes
from spikelane_sim.compiled import inner, uncounted
from spikelane_sim.encoding import Counts, EncodingParameters
from spikelane_sim.parameters import check_size, parameter, Parameters

_TABLE = 'table "Simulation parameters specification"'
#: Up to so many spikes are sorted in groups, of which there are at most so many.
_FEW_SPIKES, _FEW_GROUPS = 128, 64


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


def firing_rates(
    counts: Counts, parameters: PoissonParameters, share: float = 1.0
) -> NDArray[np.float64]:
    """Return the rate of each input [Hz]: max_rate_hz min(counts / max_events, 1).

    Args:
        counts: Events in each cell, (rows, columns).
        parameters: The scale.
        share: Length of the step in steps of 50 ms, for which max_events is.

    Returns:
        Rates [Hz] in the order of rows, then columns, (rows * columns,).
    """
    most = parameters.max_events * share
    return np.minimum(counts, most).ravel() * (parameters.max_rate_hz / most)


def poisson_spikes(
    rates_hz: NDArray[np.float64], rng: np.random.Generator, window: int = GRID_STEPS
) -> Spikes:
    """Draw spikes at constant rates.

    Args:
        rates_hz: Rate of each input [Hz], (n_inputs,), at least 0.
        rng: Where the numbers come from.
        window: Grid steps to draw for.
    """
    cumulative_hz = rates_hz.cumsum()
    expected = cumulative_hz[-1] * (window * GRID_MS / 1000)
    uniforms = rng.random(rng.poisson(expected))
    return _place(uniforms, cumulative_hz, window)  # type: ignore[no-any-return]


@numba.njit(cache=True)
def _place(
    uniforms: NDArray[np.float64], cumulative_hz: NDArray[np.float64], window: int
) -> Spikes:
    """Return the spikes of uniform numbers."""
    bounds_hz = np.empty(len(cumulative_hz) + 1)
    sources = np.empty(len(cumulative_hz) + 1, np.int64)
    active, below_hz = 0, 0.0
    for source, bound_hz in enumerate(cumulative_hz):
        active = _add_input(bounds_hz, sources, active, source, below_hz, bound_hz)
        below_hz = bound_hz
    spikes = np.empty(len(uniforms), SPIKE_DTYPE)
    for k, uniform in enumerate(uniforms):
        _place_one(spikes, k, uniform, bounds_hz, sources, active, window)
    return _in_order(spikes, window)  # type: ignore[no-any-return]


class Shares(NamedTuple):
    """Room for the inputs that have a rate, for `spikes_of_counts`; one longer than the inputs.

    Attributes:
        bounds_hz: Where the share of each begins in the summed rate, and where the last one ends.
        sources: Their indices.
    """

    bounds_hz: NDArray[np.float64]
    sources: NDArray[np.int64]


@inner
def spikes_of_counts(counts, scale, share, window, rng, shares):  # type: ignore[no-untyped-def]
    """Return what `poisson_spikes` draws at the `firing_rates` of an image, with fewer new arrays.

    Args:
        counts: Events in each cell, (rows, columns).
        scale: The `PoissonScale`.
        share: Length of the step in steps of 50 ms.
        window: The same in grid steps.
        rng: Where the numbers come from.
        shares: The `Shares`, which are overwritten.
    """
    most = scale.max_events * share
    factor = scale.max_rate_hz / most
    total_hz, source, active = 0.0, 0, 0
    for row in counts:
        for count in row:
            below_hz = total_hz
            total_hz += min(np.float64(count), most) * factor
            active = _add_input(
                shares.bounds_hz, shares.sources, active, source, below_hz, total_hz
            )
            source += 1
    spikes = np.empty(rng.poisson(total_hz * (window * GRID_MS / 1000)), SPIKE_DTYPE)
    for k in range(len(spikes)):
        _place_one(spikes, k, rng.random(), shares.bounds_hz, shares.sources, active, window)
    return _in_order(spikes, window)


@uncounted
def _add_input(  # type: ignore[no-untyped-def]
    bounds_hz, sources, active, source, below_hz, bound_hz
):
    """Write down an input's share of the summed rate; return how many inputs have one now."""
    bounds_hz[active], bounds_hz[active + 1] = below_hz, bound_hz
    sources[active] = source
    return active + (bound_hz > below_hz)  # without a branch, which would be unpredictable


@uncounted
def _place_one(  # type: ignore[no-untyped-def]
    spikes, k, uniform, bounds_hz, sources, active, window
):
    """Give a uniform number an input, and a grid step by where in the input's share it lies."""
    place_hz = uniform * bounds_hz[active]
    which = 0
    for bound in range(1, active):  # quicker than a bisection, which branches unpredictably
        which += place_hz >= bounds_hz[bound]
    below_hz = bounds_hz[which]
    share = (place_hz - below_hz) / (bounds_hz[which + 1] - below_hz)
    spikes['step'][k] = min(int(share * window), window - 1)
    spikes['source'][k] = sources[which]


@inner
def _in_order(spikes, window):  # type: ignore[no-untyped-def]
    """Return spikes in the order of grid steps; those of one step keep their order.

    A counting sort would sum as many counts as there are grid steps. Few spikes are counted by
    groups of grid steps instead, and sorted by insertion within a group.
    """
    shift = 0
    while len(spikes) <= _FEW_SPIKES and (window - 1) >> shift >= _FEW_GROUPS:
        shift += 1
    positions = np.zeros(((window - 1) >> shift) + 2, np.int64)
    for step in spikes['step']:
        positions[(step >> shift) + 1] += 1
    for group in range(len(positions) - 1):
        positions[group + 1] += positions[group]
    in_order = np.empty_like(spikes)
    for k, step in enumerate(spikes['step']):
        in_order[positions[step >> shift]] = spikes[k]
        positions[step >> shift] += 1
    if shift:
        _insert(in_order)
    return in_order


@uncounted
def _insert(spikes):  # type: ignore[no-untyped-def]
    """Sort spikes that are nearly in order."""
    for k in range(1, len(spikes)):
        step, source = spikes['step'][k], spikes['source'][k]
        at = k
        while at > 0 and spikes['step'][at - 1] > step:
            spikes[at] = spikes[at - 1]
            at -= 1
        if at < k:
            spikes['step'][at], spikes['source'][at] = step, source
