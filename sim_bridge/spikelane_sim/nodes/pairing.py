"""Groups the messages of several topics by their stamps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from spikelane_sim.messages import to_stamp_ns

KEPT = 16  # of each topic, for a message of another one that is late


class StampGroups:
    """Hands on a message of each of several topics once all with the same stamp are there."""

    def __init__(self, on_group: Callable[..., None], topics: int) -> None:
        """Group messages with a header.

        Args:
            on_group: Called with a message of each topic, in their order.
            topics: How many there are.
        """
        self._on_group = on_group
        self._waiting: tuple[dict[int, Any], ...] = tuple({} for _ in range(topics))

    @property
    def lacks_others(self) -> bool:
        """Whether a message of the last topic waits for those of the others."""
        return bool(self._waiting[-1])

    def add(self, topic: int, message: Any) -> None:
        """Take a message of a topic, numbered from 0.

        Raises:
            MessageError: Its stamp is not normalised.
        """
        stamp = to_stamp_ns(message.header.stamp)
        others = [each for number, each in enumerate(self._waiting) if number != topic]
        if all(stamp in each for each in others):
            group = [each.pop(stamp) for each in others]
            self._on_group(*group[:topic], message, *group[topic:])
            return
        waiting = self._waiting[topic]
        waiting[stamp] = message
        if len(waiting) > KEPT:
            del waiting[next(iter(waiting))]
