"""Filters that let an event pass where events near it support it: noise has no company.

An event passes if at least k of the pixels around its own, which is not one of them, had an event
no longer ago than a window. Every event supports later ones, also one that does not pass.

- `nearest_neighbour`: one supporter among the eight neighbours (T. Delbruck, Frame-free dynamic
  digital vision, 2008).
- `correlation`: k supporters, the spatio-temporal correlation filter (STCF) of S. Guo and
  T. Delbruck, Low cost and latency event camera background activity denoising, TPAMI 2022.

Events of the same time support each other, in whatever order they come: a camera that reads out a
row, or a simulated one that reads out the whole image at once, has no order among them. Where no
two neighbours fire at the same time this is the usual filter, event after event.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.compiled import inner
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import Events
from spikelane_sim.filters.kind import (
    CompiledFilter,
    FilterKind,
    LONG_AGO_NS,
    Passes,
    SUPPORT,
)
from spikelane_sim.parameters import parameter, Parameters


@dataclass(frozen=True, kw_only=True)
class NearestNeighbourParameters(Parameters):
    """The background-activity filter of one supporter."""

    window_s: float = parameter(
        0.05,
        'An event passes if one of the eight pixels around it had an event at most this long '
        'before; 0: only events at the same time count.',
        unit='s',
        low=0.0,
        high=100.0,
        source='our own choice, a step; dv-processing usually has 0.002',
    )


@dataclass(frozen=True, kw_only=True)
class CorrelationParameters(Parameters):
    """The spatio-temporal correlation filter."""

    window_s: float = parameter(
        0.02,
        'Time for which an event supports the events around it; 0: only events at the same '
        'time support each other.',
        unit='s',
        low=0.0,
        high=100.0,
        source='our own choice',
    )
    supporters: int = parameter(
        2,
        'Number of pixels around an event that must have had an event within the window for '
        'the event to pass.',
        low=1,
        high=80,
        source='Guo and Delbruck 2022: 2 or 3 for many uses',
    )
    reach_px: int = parameter(
        1,
        'Number of columns and rows to each side that count as around an event; 1: the eight '
        'neighbours.',
        unit='px',
        low=1,
        high=4,
        source='Guo and Delbruck 2022',
    )
    same_polarity: bool = parameter(False, 'Count only events of the same polarity as support.')

    def _check_relations(self) -> None:
        around = (2 * self.reach_px + 1) ** 2 - 1
        if self.supporters > around:
            raise ParameterError(
                f'supporters: expected at most {around}, the pixels within reach_px '
                f'{self.reach_px}, got {self.supporters}'
            )


class CorrelationFilter:
    """Lets events with supporters pass; an `EventFilter`."""

    def __init__(self, parameters: CorrelationParameters, width: int, height: int) -> None:
        """Begin without events.

        Args:
            parameters: What it takes to pass.
            width: Columns of the image [px].
            height: Rows of the image [px].
        """
        reach = parameters.reach_px
        self._window_ns = round(parameters.window_s * 1e9)
        self._supporters = parameters.supporters
        self._reach = reach
        # One map for each polarity where only the same counts. A rim around it saves asking
        # whether a neighbour is inside the image.
        maps = 2 if parameters.same_polarity else 1
        self._last_ns = np.empty((maps, height + 2 * reach, width + 2 * reach), np.int64)
        self.reset()

    def reset(self) -> None:
        """Forget all events."""
        self._last_ns[:] = LONG_AGO_NS

    def compiled(self) -> CompiledFilter:
        """Return it for the kernel of a fleet."""
        numbers = self._window_ns, self._supporters, self._reach
        return CompiledFilter(SUPPORT, numbers, self._last_ns)

    def passes(self, events: Events) -> Passes:
        """Return which events have their supporters; see `EventFilter`."""
        found = np.empty(len(events), np.bool_)
        find_supported(
            events, self._last_ns, self._window_ns, self._supporters, self._reach, found
        )
        return found


@numba.njit(cache=True)
def find_supported(
    events: Events,
    last_ns: NDArray[np.int64],
    window_ns: int,
    supporters: int,
    reach: int,
    found: Passes,
) -> None:
    """Write which events have enough supporters, and when each pixel had its last event."""
    begin = 0
    while begin < len(events):
        t_ns = events[begin].t
        end = begin
        while end < len(events) and events[end].t == t_ns:
            event = events[end]
            last_ns[_map_of(last_ns, event.polarity), event.y + reach, event.x + reach] = t_ns
            end += 1
        for number in range(begin, end):
            event = events[number]
            times_ns = last_ns[_map_of(last_ns, event.polarity)]
            # The pixel itself has one event by now, which does not count.
            count = -1
            for row in range(event.y, event.y + 2 * reach + 1):
                for column in range(event.x, event.x + 2 * reach + 1):
                    count += t_ns - times_ns[row, column] <= window_ns
            found[number] = count >= supporters
        begin = end


@inner
def _map_of(last_ns: NDArray[np.int64], polarity: int) -> int:
    return 1 if len(last_ns) == 2 and polarity > 0 else 0


def _nearest_neighbour(
    parameters: NearestNeighbourParameters, width: int, height: int
) -> CorrelationFilter:
    one = CorrelationParameters(window_s=parameters.window_s, supporters=1)
    return CorrelationFilter(one, width, height)


CORRELATION = FilterKind(CorrelationFilter, CorrelationParameters, is_compiled=True)
NEAREST_NEIGHBOUR = FilterKind(_nearest_neighbour, NearestNeighbourParameters, is_compiled=True)
