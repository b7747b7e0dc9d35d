"""Filters of events in the kernel of a fleet: the same functions, a memory for each robot.

A robot's memory is one row of numbers, in which the maps of its filters lie one after the other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.compiled import inner
from spikelane_sim.errors import ParameterError
from spikelane_sim.filters import FilterParameters, FilterStage
from spikelane_sim.filters.correlation import find_supported
from spikelane_sim.filters.hot_pixels import find_kept
from spikelane_sim.filters.kind import filter_kind, REST, SUPPORT
from spikelane_sim.filters.refractory import find_late


class Chain(NamedTuple):
    """The filters in their order.

    Attributes:
        does: What each does: `kind.SUPPORT`, `REST` or `MASK`, (n_filters,).
        numbers: Numbers of each, see `kind.CompiledFilter`, (n_filters, 3).
        shapes: Maps, rows and columns of the memory of each, (n_filters, 3).
        memory: What a robot's memory is where an episode begins, (n_numbers,).
    """

    does: NDArray[np.int64]
    numbers: NDArray[np.int64]
    shapes: NDArray[np.int64]
    memory: NDArray[np.int64]


def make_chain(parameters: FilterParameters, width: int, height: int) -> Chain:
    """Return the filters of events of an image of this size [px].

    Raises:
        SpikelaneError: A fleet does not have a filter, or it cannot be made.
    """
    check_chain(parameters)
    filters = FilterStage(parameters, width, height).compiled()
    memories = [each.memory.ravel() for each in filters]
    return Chain(
        does=np.array([each.does for each in filters], np.int64),
        numbers=np.array([each.numbers for each in filters], np.int64).reshape(-1, 3),
        shapes=np.array([each.memory.shape for each in filters], np.int64).reshape(-1, 3),
        memory=np.concatenate([np.empty(0, np.int64), *memories]),
    )


def check_chain(parameters: FilterParameters) -> None:
    """Check that a fleet has all filters.

    Raises:
        ParameterError: It has not; the message names the filter.
    """
    for name in parameters.names:
        if not filter_kind(name).is_compiled:
            raise ParameterError(
                f'filter.chain: expected filters that are compiled in a fleet, got {name}'
            )


@inner
def filter_events(chain, memory, events):  # type: ignore[no-untyped-def]
    """Move the events that pass all filters to the front; return how many.

    Args:
        chain: The `Chain`.
        memory: The robot's, (n_numbers,); changed in place.
        events: Events of one step, as in `EventFilter.passes`; changed in place.
    """
    number = len(events)
    found = np.empty(number, np.bool_)
    start = 0
    for k in range(len(chain.does)):
        maps, rows, columns = chain.shapes[k, 0], chain.shapes[k, 1], chain.shapes[k, 2]
        end = start + maps * rows * columns
        known = memory[start:end].reshape((maps, rows, columns))
        start = end
        seen, passes, numbers = events[:number], found[:number], chain.numbers[k]
        if chain.does[k] == SUPPORT:
            window_ns, supporters, reach = numbers[0], numbers[1], numbers[2]
            find_supported(seen, known, window_ns, supporters, reach, passes)
        elif chain.does[k] == REST:
            find_late(seen, known[0], numbers[0], passes)
        else:
            find_kept(seen, known[0], passes)
        number = _keep(seen, passes)
    return number


@inner
def _keep(events, passes):  # type: ignore[no-untyped-def]
    """Move the events that pass to the front; return how many."""
    kept = 0
    for k in range(len(events)):
        if passes[k]:
            events[kept] = events[k]
            kept += 1
    return kept
