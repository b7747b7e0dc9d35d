"""Warnings of a node that gets nowhere: what it has received, and what it lacks."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

_LOOK_PERIOD_S = 1.0
_FIRST_AFTER = 4  # looks without progress
_AGAIN_AFTER = 20  # further looks


def publishers_of(node: Node, topic: str) -> int:
    """Return how many publishers a topic has, under the name that the node remaps it to."""
    return int(node.count_publishers(node.resolve_topic_name(topic)))


class WaitingWarnings:
    """Warns after 4 s without progress, and every 20 s from then on until there is some."""

    def __init__(
        self, node: Node, progress: Callable[[], object], lacks: Callable[[], str]
    ) -> None:
        """Begin to look once a second, by steady time: that of a simulator may stand still.

        Args:
            node: The node that waits.
            progress: Returns something that changes when the node gets on.
            lacks: Returns what was received and what is lacking; '' where nothing is.
        """
        self._node, self._progress, self._lacks = node, progress, lacks
        self._before = progress()
        self._idle = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_LOOK_PERIOD_S, self._look, clock=steady)

    @property
    def idle_s(self) -> float:
        """How long there was no progress [s]."""
        return self._idle * _LOOK_PERIOD_S

    @property
    def is_due(self) -> bool:
        """Whether there was no progress for so long that a warning was due."""
        return self._idle >= _FIRST_AFTER

    def _look(self) -> None:
        before, self._before = self._before, self._progress()
        if self._before != before:
            self._idle = 0
            return
        self._idle += 1
        if self._idle % _AGAIN_AFTER == _FIRST_AFTER and (text := self._lacks()):
            self._node.get_logger().warning(text)
