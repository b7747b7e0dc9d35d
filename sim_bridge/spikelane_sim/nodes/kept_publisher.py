"""Publishers that know their subscribers, and which of them have missed the last message."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.duration import Infinite
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    LivelinessPolicy,
    qos_check_compatible,
    QoSCompatibility,
    QoSProfile,
)
from rclpy.topic_endpoint_info import TopicEndpointInfo

from spikelane_sim.nodes.local_topics import LocalSubscription, LocalTopics, serialised


class KeptPublisher:
    """A publisher that can tell whether a subscriber has missed its last message.

    A subscriber may be met at any moment, also between two topics of one step, and rclpy reports
    that only some time after messages reach it. Each publisher therefore counts its subscribers
    itself, just before it would send.

    Attributes:
        sent: Messages sent, which is the sequence number of the last one.
    """

    def __init__(
        self,
        node: Node,
        kind: type,
        topic: str,
        qos: QoSProfile,
        on_match: Callable[[], None] = lambda: None,
        local: LocalTopics | None = None,
    ) -> None:
        """Create the publisher.

        Args:
            node: The node that publishes.
            kind: Type of the messages.
            topic: Name of the topic.
            qos: Quality of service.
            on_match: Called by the node's executor when a subscriber was met or lost.
            local: Carries the messages to nodes of this process, too; None: there are none.
        """
        self.sent = 0
        self._reached = 0
        self._node = node
        # What is not given is discovered as infinite, and only compared as such.
        self._offered = QoSProfile(
            depth=qos.depth,
            durability=qos.durability,
            deadline=Infinite,
            liveliness=LivelinessPolicy.AUTOMATIC,
            liveliness_lease_duration=Infinite,
        )
        self._type = f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'
        self._publisher = node.create_publisher(
            kind,
            topic,
            qos,
            event_callbacks=PublisherEventCallbacks(matched=self._on_match),
        )
        self._tell = on_match
        self.topic = str(self._publisher.topic_name)
        self._local = local
        if local is not None:
            local.advertise(self.topic, on_match)

    @property
    def subscribers(self) -> int:
        """Subscribers that messages reach now."""
        return self._remote_subscribers + len(self._local_subscribers)

    @property
    def is_latched(self) -> bool:
        """Whether the last messages are kept for subscribers to come."""
        return bool(self._offered.durability == DurabilityPolicy.TRANSIENT_LOCAL)

    @property
    def is_missed(self) -> bool:
        """Whether a subscriber has joined that the last message has not reached."""
        return self.subscribers > self._reached

    def listeners(self) -> list[str]:
        """Return the full names of the nodes that messages reach now, or are about to reach."""
        remote = [
            full_name(info)
            for info in self._node.get_subscriptions_info_by_topic(self.topic)
            if info.topic_type == self._type and self._reaches(info.qos_profile)
        ]
        return [*remote, *(each.node_name for each in self._local_subscribers)]

    @property
    def _remote_subscribers(self) -> int:
        return int(self._publisher.get_subscription_count())

    @property
    def _local_subscribers(self) -> list[LocalSubscription]:
        return [] if self._local is None else self._local.subscribers(self.topic)

    def _reaches(self, wanted: QoSProfile) -> bool:
        compatibility, _ = qos_check_compatible(self._offered, wanted)
        return bool(compatibility != QoSCompatibility.ERROR)

    def publish(self, message: Any) -> None:
        """Send a message whether or not anybody subscribes, as to latch it."""
        self._reached = self.subscribers
        self.sent += 1
        self._publisher.publish(message)

    def send(self, make: Callable[[], Any]) -> None:
        """Send a message, which is made only where somebody subscribes."""
        self._reached = self.subscribers
        if self._reached:
            self.sent += 1
            self._deliver(make())

    def _deliver(self, message: Any) -> None:
        if self._local is None:
            self._publisher.publish(message)
            return
        data = serialised(message)
        self._local.send(self.topic, data)
        if self._remote_subscribers:
            self._publisher.publish(data)

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


def full_name(endpoint: TopicEndpointInfo) -> str:
    """Return the full name of the node that publishes or subscribes."""
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'
