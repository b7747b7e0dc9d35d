"""Publishers that send their last message again where a subscriber has missed it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from rclpy.qos import QoSProfile


class KeptPublisher:
    """A publisher that can tell whether a subscriber has missed its last message.

    A subscriber may be met at any moment, also between two topics of one step, and rclpy reports
    that only some time after messages reach it. Each publisher therefore counts its subscribers
    itself, just before it would send.

    Attributes:
        sent: Messages sent.
    """

    def __init__(
        self,
        node: Node,
        kind: type,
        topic: str,
        qos: QoSProfile,
        on_match: Callable[[], None],
    ) -> None:
        """Create the publisher.

        Args:
            node: The node that publishes.
            kind: Type of the messages.
            topic: Name of the topic.
            qos: Quality of service.
            on_match: Called by the node's executor when a subscriber was met or lost.
        """
        self.sent = 0
        self._reached = 0
        self._publisher = node.create_publisher(
            kind,
            topic,
            qos,
            event_callbacks=PublisherEventCallbacks(matched=self._on_match),
        )
        self._tell = on_match

    @property
    def topic(self) -> str:
        """Full name of the topic."""
        return str(self._publisher.topic_name)

    @property
    def subscribers(self) -> int:
        """Subscribers that messages reach now."""
        return int(self._publisher.get_subscription_count())

    @property
    def is_missed(self) -> bool:
        """Whether a subscriber has joined that the last message has not reached."""
        return self.subscribers > self._reached

    def send(self, make: Callable[[], Any]) -> None:
        """Send a message, which is made only where somebody subscribes."""
        self._reached = self.subscribers
        if self._reached:
            self.sent += 1
            self._publisher.publish(make())

    def send_again(self, make: Callable[[], Any]) -> None:
        """Send the last message again, to all subscribers, if one of them has missed it."""
        if self.is_missed:
            self.send(make)

    def _on_match(self, status: QoSPublisherMatchedInfo) -> None:
        joined = status.total_count_change
        left = joined - status.current_count_change
        if joined and left:  # reported together: the count alone does not show it
            self._reached -= left
        self._reached = max(0, min(self._reached, self.subscribers))
        self._tell()
