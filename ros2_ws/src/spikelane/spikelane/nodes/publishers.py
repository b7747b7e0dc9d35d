"""What the nodes that wait for the recorder say that they have published."""

from __future__ import annotations

from collections.abc import Iterator

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from spikelane_msgs.msg import Published

from spikelane_sim.nodes.rclpy_internals import take

#: As many nodes as may be recorded at once.
_EACH_LAST = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Publishers:
    """Keeps the last that each node has said; see `spikelane_sim.nodes.meeting`.

    Attributes:
        topic: Full name of the topic on which they say it.
    """

    def __init__(self, node: Node, topic: str, group: CallbackGroup) -> None:
        """Subscribe.

        Args:
            node: The recorder.
            topic: Full name of the topic.
            group: Keeps executors away: messages are taken by `take`.
        """
        self.topic = topic
        self._subscription = node.create_subscription(
            Published, topic, lambda message: None, _EACH_LAST, callback_group=group
        )
        self._said: dict[str, Published] = {}

    def take(self) -> None:
        """Take what has come."""
        while (message := take(self._subscription)) is not None:
            self._said[message.node] = message

    @property
    def are_publishing(self) -> bool:
        """Whether one of the nodes has not said that it has ended."""
        return any(each.state == Published.PUBLISHING for each in self._said.values())

    @property
    def names(self) -> list[str]:
        """Full names of the nodes that have said anything."""
        return list(self._said)

    @property
    def cut_short(self) -> list[str]:
        """Full names of the nodes that have not said that their work is done."""
        return [name for name, each in self._said.items() if each.state != Published.COMPLETE]

    def published(self) -> Iterator[tuple[str, int, int]]:
        """Yield each topic, and the numbers of the first and the last message to be recorded."""
        for each in self._said.values():
            yield from zip(each.topics, each.first, each.last, strict=False)
