"""Topics of a drive that one node alone may publish, and who publishes on them all the same.

Two graphs that meet in one ROS domain and one namespace answer each other's observations, and both
drives are worthless. Every node that publishes or takes one of these topics looks once a second,
names all publishers where there are several, and ends where it takes part in a drive whose nodes
wait for each other. It ends after every other node has looked: the first one to end may be one of
the publishers, and the others would then find nothing and wait for it for ever.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, cast

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from spikelane_sim import topic_names
from spikelane_sim.nodes.kept_publisher import full_name

#: Topics with one publisher.
SOLE_TOPICS = (topic_names.LANE_STATE, topic_names.EVENTS, topic_names.WHEELS)
#: Is given what was found, in words.
OnFound = Callable[[str], None]

_LOOK_PERIOD_S = 1.0
_END_AFTER_S = 2.5  # a node on a busy machine may look late


class SolePublishers:
    """Finds second publishers of some topics."""

    def __init__(self, node: Node, topics: Sequence[str], fail: OnFound | None = None) -> None:
        """Prepare.

        Args:
            node: A node that is concerned.
            topics: The topics, which may be relative.
            fail: Called with the reason some time after the warning; None: never.
        """
        self._node, self._fail = node, fail
        self._topics = [node.resolve_topic_name(topic) for topic in topics]
        self._found = ''

    def look_regularly(self) -> None:
        """Let the node's executor look, by steady time: that of a simulator may stand still."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._node.create_timer(_LOOK_PERIOD_S, self.look, clock=steady)

    def look(self) -> bool:
        """Name the publishers if there are several, once for as long as they are the same.

        Returns:
            Whether a topic has several publishers.
        """
        found = '; '.join(filter(None, map(self._describe, self._topics)))
        is_new = bool(found) and found != self._found
        self._found = found
        if is_new:
            self._node.get_logger().warning(found)
            self._end_later(found)
        return bool(found)

    def _end_later(self, reason: str) -> None:
        """Call `fail` once, when the other nodes must have found what this one has.

        The node's `exit_status` is 1 from now on.
        """
        fail, self._fail = self._fail, None
        if fail is None:
            return
        # The drive may end by itself before; it is nobody's all the same.
        cast(Any, self._node).exit_status = 1

        def end() -> None:
            timer.cancel()
            fail(reason)

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        timer = self._node.create_timer(_END_AFTER_S, end, clock=steady)

    def _describe(self, topic: str) -> str:
        if self._node.count_publishers(topic) < 2:
            return ''
        names = Counter(map(full_name, self._node.get_publishers_info_by_topic(topic)))
        if names.total() < 2:
            return ''
        told = ', '.join(
            name if count == 1 else f'{name} ({count} publishers)'
            for name, count in sorted(names.items())
        )
        return f'{topic}: expected one publisher, got {names.total()}: {told}'


def is_sole(name: str) -> bool:
    """Return whether a topic, by its full name, is to have one publisher."""
    return name.endswith(tuple(f'/{each}' for each in SOLE_TOPICS))
