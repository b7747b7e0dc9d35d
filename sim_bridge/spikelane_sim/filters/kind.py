"""Filters of events by name. A package registers one as an entry point.

The group is `spikelane.filters`; the entry point's name is what `filter.chain` calls it, and it
names a `FilterKind`. The filter's own parameters are `filter.<name>.<parameter>`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.entry_points import known, loaded
from spikelane_sim.events import Events
from spikelane_sim.parameters import Parameters

FILTER_GROUP = 'spikelane.filters'

#: The time of an event that there never was [ns]: long ago for every time there is.
LONG_AGO_NS = -(1 << 62)

Passes = NDArray[np.bool_]

#: What compiled filters do, by the numbers that the kernel of a fleet knows (`filters.compiled`).
SUPPORT, REST, MASK = range(3)


class CompiledFilter(NamedTuple):
    """A filter for the kernel of a fleet.

    Attributes:
        does: SUPPORT, REST or MASK.
        numbers: Window [ns], supporters and reach [px]; period [ns]; or none.
        memory: What the filter keeps in mind where an episode begins, (maps, rows, columns).
    """

    does: int
    numbers: tuple[int, int, int]
    memory: NDArray[np.int64]


class EventFilter(Protocol):
    """Lets some of a camera's events pass, event by event and causally."""

    def reset(self) -> None:
        """Forget all events, as at the start of an episode."""

    def passes(self, events: Events) -> Passes:
        """Return which of the next events pass, (N,).

        Args:
            events: In the order of time, none earlier than those before, inside the image, (N,).
                Whether an event passes depends on it, on earlier events and on those of the same
                time; not on how events are divided into calls, as long as those of one time come
                together.
        """


@runtime_checkable
class EventMap(Protocol):
    """Moves events to another image, event by event and causally."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px] of the image to which events are moved."""

    def reset(self) -> None:
        """Forget all events, as at the start of an episode."""

    def moved(self, events: Events) -> Events:
        """Return the next events in the other image, in the order of `events.py`, (M,).

        Args:
            events: As in `EventFilter.passes`, (N,).
        """


class FilterKind(NamedTuple):
    """A kind of filter.

    Attributes:
        make: Makes a filter from its parameters, and width and height of the image [px]. It may
            raise a SpikelaneError. What it makes may be an `EventMap` instead: the filters that
            follow it in the chain, and the controller, receive events of the other image.
        parameters_class: The filter's own parameters.
        is_compiled: Whether its filters have a method `compiled` that returns a `CompiledFilter`;
            a fleet refuses the others.
        moves_events: Whether what it makes is an `EventMap`.
    """

    make: Callable[[Any, int, int], EventFilter | EventMap]
    parameters_class: type[Parameters]
    is_compiled: bool = False
    moves_events: bool = False


def filter_kinds() -> Mapping[str, FilterKind | str]:
    """Return all kinds of filters by name; for one that cannot be had, the reason."""
    return loaded(FILTER_GROUP, FilterKind, 'spikelane_sim')


def filter_kind(name: str) -> FilterKind:
    """Return a kind of filter.

    Raises:
        ParameterError: None has this name, or it cannot be had.
    """
    return known('filter.chain', filter_kinds(), name)
