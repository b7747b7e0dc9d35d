"""Pairs the messages of two topics by their stamps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from spikelane_sim.messages import to_stamp_ns

KEPT = 16  # of either topic, for a partner that is late


class StampPairs:
    """Hands on a message of each of two topics once both with the same stamp are there."""

    def __init__(self, on_pair: Callable[[Any, Any], None]) -> None:
        """Pair messages with a header; on_pair is called with one of either topic."""
        self._on_pair = on_pair
        self._waiting: tuple[dict[int, Any], ...] = ({}, {})

    @property
    def lacks_first(self) -> bool:
        """Whether a message of the second topic waits for its partner."""
        return bool(self._waiting[1])

    def add_first(self, message: Any) -> None:
        """Take a message of the first topic.

        Raises:
            MessageError: Its stamp is not normalised; `add_second` too.
        """
        self._add(0, message)

    def add_second(self, message: Any) -> None:
        """Take a message of the second topic."""
        self._add(1, message)

    def _add(self, topic: int, message: Any) -> None:
        stamp = to_stamp_ns(message.header.stamp)
        partner = self._waiting[1 - topic].pop(stamp, None)
        if partner is None:
            waiting = self._waiting[topic]
            waiting[stamp] = message
            if len(waiting) > KEPT:
                del waiting[next(iter(waiting))]
        else:
            first, second = (message, partner) if topic == 0 else (partner, message)
            self._on_pair(first, second)
