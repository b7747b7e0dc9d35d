"""Filters of events: a stage between the camera and what a controller is given.

`filter.chain` names the filters in their order, each of which sees what the one before lets pass.
By default there are none, and all events pass. A map of events to another image is an element of
the chain as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from spikelane_sim.contract import LaneState, Observation
from spikelane_sim.episodes import EpisodeWatch
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import Events, make_events
from spikelane_sim.filters.kind import EventFilter, EventMap, filter_kind, filter_kinds, FilterKind
from spikelane_sim.parameters import check_size, parameter, Parameters, with_groups

__all__ = ['FilterParameters', 'FilterStage']

_GROUPS = {
    name: each.parameters_class
    for name, each in filter_kinds().items()
    if isinstance(each, FilterKind)
}
_MOST_PIXELS = 2**24  # of an image that is filtered: more would take a gigabyte


@dataclass(frozen=True, kw_only=True)
@with_groups(_GROUPS)
class FilterParameters(Parameters):
    """Which filters there are, and the parameters of each, a field with its name."""

    chain: str = parameter(
        '',
        'Filters that events pass through in this order, separated by commas: '
        f'{", ".join(filter_kinds())}; empty: no filter.',
    )

    @property
    def names(self) -> tuple[str, ...]:
        """The filters in their order."""
        return tuple(name.strip() for name in self.chain.split(',')) if self.chain else ()

    def chosen(self) -> dict[str, Any] | None:
        """Return what determines the filters, under dotted names; None where there are none."""
        return self.to_dict() if self.names else None

    @property
    def move_events(self) -> bool:
        """Whether events that pass belong to another image than the camera's."""
        return any(filter_kind(name).moves_events for name in self.names)

    def node_parameters(self) -> dict[str, Any]:
        """Return them as parameters of a node, none where there are no filters."""
        return {f'filter.{name}': value for name, value in (self.chosen() or {}).items()}

    def _check_relations(self) -> None:
        for name in self.names:
            filter_kind(name)
        if len(set(self.names)) < len(self.names):
            raise ParameterError(f'chain: expected each filter once, got {self.chain!r}')


class FilterStage:
    """The filters of one controller's events.

    They forget what they have seen where an episode begins, where time goes back, and where the
    stage is told to.

    Attributes:
        size: Width and height [px] of the image to which the events that pass belong.
        events_in: Events that came, since the stage was made.
        events_out: Events that passed.
    """

    def __init__(self, parameters: FilterParameters, width: int, height: int) -> None:
        """Make the filters.

        Args:
            parameters: Which.
            width: Columns of the image [px].
            height: Rows of the image [px].

        Raises:
            SpikelaneError: A filter cannot be made.
        """
        self.events_in = self.events_out = 0
        if parameters.names:
            size = {'columns of the image': width, 'rows': height}
            check_size('pixels whose events are filtered', size, _MOST_PIXELS)
        self.size = (width, height)
        self._filters: list[EventFilter | EventMap] = []
        self._apply: list[Callable[[Events], Events]] = []  # the same, as functions
        for name in parameters.names:
            made = filter_kind(name).make(getattr(parameters, name), *self.size)
            self._filters.append(made)
            if isinstance(made, EventMap):
                self._apply.append(made.moved)
                self.size = made.size
            else:
                self._apply.append(partial(_passing, made))
        for each, apply in zip(self._filters, self._apply, strict=True):
            apply(make_events([0], 0, 0, 1))  # compiled kernels are loaded before time matters
            each.reset()
        self._episodes = EpisodeWatch()
        self._latest_ns: int | None = None

    def compiled(self) -> list[Any]:
        """Return the filters, fresh from a reset, for the kernel of a fleet.

        Each is a `kind.CompiledFilter`; all kinds must be compiled.
        """
        self.reset()
        return [each.compiled() for each in self._filters]  # type: ignore[union-attr]

    def reset(self) -> None:
        """Forget all events."""
        self._latest_ns = None
        for each in self._filters:
            each.reset()

    def observe(self, observation: Observation) -> Observation:
        """Return a simulator's observation with the events that pass.

        Without filters that is the observation itself, and nothing is counted.
        """
        if not self._filters:  # the usual case, in every step of a simulator
            return observation
        self.begin_if_new(observation.lane)
        return observation._replace(events=self.filter(observation.events))

    def begin_if_new(self, lane: LaneState | None) -> None:
        """Forget all events if an episode begins with this lane state; None tells nothing."""
        if lane is not None and self._episodes.begins(lane):
            self.reset()

    def filter(self, events: Events) -> Events:
        """Return those of the next events that pass.

        Args:
            events: Events of one packet or step, in the order of time, inside the image, (N,).
        """
        self.events_in += len(events)
        if self._filters and len(events):
            if self._latest_ns is not None and events['t'][0] < self._latest_ns:
                self.reset()
            self._latest_ns = int(events['t'][-1])
            for apply in self._apply:
                events = apply(events)
        self.events_out += len(events)
        return events


def _passing(each: EventFilter, events: Events) -> Events:
    """Return the events that a filter lets pass."""
    passed: Events = events[each.passes(events)]
    return passed
