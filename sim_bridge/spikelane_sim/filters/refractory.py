"""A filter that limits how fast a pixel can fire.

An event passes if its pixel had no event before it, whether that passed or not, for a period: as
the low-pass filter of dv-processing has it. A pixel that fires faster all the time is silent from
its second event on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.events import Events
from spikelane_sim.filters.kind import CompiledFilter, FilterKind, LONG_AGO_NS, Passes, REST
from spikelane_sim.parameters import parameter, Parameters


@dataclass(frozen=True, kw_only=True)
class RefractoryParameters(Parameters):
    """The refractory filter."""

    period_s: float = parameter(
        0.001,
        'An event passes if the previous event of the same pixel is at least this long ago.',
        unit='s',
        low=0.0,
        high=100.0,
        source='our own choice',
    )


class RefractoryFilter:
    """Lets a pixel's event pass that is not too soon after the one before; an `EventFilter`."""

    def __init__(self, parameters: RefractoryParameters, width: int, height: int) -> None:
        """Begin without events.

        Args:
            parameters: The period.
            width: Columns of the image [px].
            height: Rows of the image [px].
        """
        self._period_ns = round(parameters.period_s * 1e9)
        self._last_ns = np.empty((height, width), np.int64)
        self.reset()

    def reset(self) -> None:
        """Forget all events."""
        self._last_ns[:] = LONG_AGO_NS

    def compiled(self) -> CompiledFilter:
        """Return it for the kernel of a fleet."""
        return CompiledFilter(REST, (self._period_ns, 0, 0), self._last_ns[None])

    def passes(self, events: Events) -> Passes:
        """Return which events come late enough; see `EventFilter`."""
        found = np.empty(len(events), np.bool_)
        find_late(events, self._last_ns, self._period_ns, found)
        return found


@numba.njit(cache=True)
def find_late(events: Events, last_ns: NDArray[np.int64], period_ns: int, found: Passes) -> None:
    """Write which events pass, and when each pixel had its last event."""
    for number in range(len(events)):
        event = events[number]
        found[number] = event.t - last_ns[event.y, event.x] >= period_ns
        last_ns[event.y, event.x] = event.t


REFRACTORY = FilterKind(RefractoryFilter, RefractoryParameters, is_compiled=True)
