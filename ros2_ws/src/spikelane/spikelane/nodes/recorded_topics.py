"""The topics that a recorder has subscribed to, and the messages that arrive on them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import ReliabilityPolicy
from rclpy.subscription import Subscription

from spikelane.bag.recording import Arrival, NOT_RECORDED, Recording
from spikelane.bag.schema import collect_schema
from spikelane.bag.writer import BagWriter
from spikelane.nodes.offers import adapted_qos, message_type_of, offered_qos, problems
from spikelane_sim.nodes.direct import SubscriptionEvents
from spikelane_sim.nodes.rclpy_internals import NotForExecutors, take_raw

_CLOCK_TYPE = 'rosgraph_msgs/msg/Clock'


class RecordedTopics:
    """Subscribes raw to topics; messages are taken, not handed over by an executor.

    Attributes:
        ids: Id of each topic in the bag, by name; NOT_RECORDED for one that cannot be recorded.
    """

    def __init__(
        self,
        node: Node,
        writer: BagWriter,
        recording: Recording,
        group: NotForExecutors,
        depth: int,
    ) -> None:
        """Begin without a topic.

        Args:
            node: The recorder.
            writer: Where topics are declared.
            recording: What is told of losses and of the clock.
            group: Keeps the subscriptions from the executor.
            depth: Messages of a topic that may wait to be taken.
        """
        self.ids: dict[str, int] = {}
        self._node = node
        self._writer = writer
        self._recording = recording
        self._group = group
        self._depth = depth
        self._events = SubscriptionEvents()
        self._subscriptions: dict[str, Subscription] = {}
        self._profiles: dict[str, Any] = {}
        self._warned: set[tuple[str, str]] = set()

    def __len__(self) -> int:
        """Return how many topics are subscribed to."""
        return len(self._subscriptions)

    @property
    def recorded_count(self) -> int:
        """How many topics are in the bag."""
        return sum(topic_id != NOT_RECORDED for topic_id in self.ids.values())

    @property
    def met(self) -> list[str]:
        """The topics that have a publisher now."""
        return [name for name, each in self._subscriptions.items() if each.get_publisher_count()]

    def subscribe(
        self,
        name: str,
        type_names: Sequence[str],
        publishers: Sequence[Any],
        *,
        is_wanted: bool,
        is_clock: bool,
    ) -> bool:
        """Subscribe to a topic as its publishers offer it.

        Args:
            name: Full name of the topic.
            type_names: Its types in the graph.
            publishers: What rclpy tells of its publishers, at least one.
            is_wanted: Whether it is recorded; otherwise it is only followed.
            is_clock: Whether the recorder follows it as the clock.

        Returns:
            Whether it is subscribed to; if not, a warning says why.
        """
        type_name = publishers[0].topic_type
        message_type = message_type_of(type_name)
        if len(type_names) > 1 or message_type is None:
            self.ids[name] = NOT_RECORDED
            reason = f'its type {type_name} is not installed'
            if len(type_names) > 1:
                reason = f'it has several types: {", ".join(type_names)}'
            self._warn_once(name, f'is not recorded: {reason}')
            return False
        offers = [offered_qos(publisher.qos_profile) for publisher in publishers]
        topic_id = NOT_RECORDED
        if is_wanted:
            topic_id = self._add_topic(name, type_name, publishers[0], offers)
        if is_clock and type_name == _CLOCK_TYPE:
            self._recording.follow_clock(topic_id)
        profile = adapted_qos(offers, self._depth)
        subscription = self._node.create_subscription(
            message_type,
            name,
            _ignore,
            profile,
            callback_group=self._group,
            event_callbacks=SubscriptionEventCallbacks(
                message_lost=lambda lost: self._recording.report_lost(topic_id, lost.total_count)
            ),
            raw=True,
        )
        self._events.add(subscription)
        self._subscriptions[name] = subscription
        self._profiles[name] = profile
        self.ids[name] = topic_id
        return True

    def take(self) -> list[Arrival]:
        """Return every message that has arrived, topic by topic."""
        arrivals: list[Arrival] = []
        for name, subscription in self._subscriptions.items():
            topic_id = self.ids[name]
            # Asked at each taking: a second publisher may be gone again a moment later.
            if subscription.get_publisher_count() > 1:
                self._recording.watch_losses(topic_id, has_one_publisher=False)
            # A publisher that outruns us must not keep us from the others.
            for _ in range(self._depth):
                taken = take_raw(subscription)
                if taken is None:
                    break
                data, info = taken
                arrivals.append(
                    (
                        info['received_timestamp'],
                        topic_id,
                        info['source_timestamp'],
                        info['publication_sequence_number'],
                        data,
                    )
                )
        return arrivals

    def look_at_events(self) -> None:
        """Learn what the middleware reports of lost messages."""
        self._events.look()

    def check_publishers(self) -> None:
        """Warn of publishers that a subscription does not suit."""
        for name, topic_id in self.ids.items():
            if topic_id == NOT_RECORDED:
                continue
            publishers = self._node.get_publishers_info_by_topic(name)
            for problem in problems(self._profiles[name], publishers):
                self._warn_once(name, problem)

    def is_best_effort(self, name: str) -> bool:
        """Return whether a topic is subscribed to as one that may lose messages."""
        profile = self._profiles.get(name)
        return profile is not None and profile.reliability != ReliabilityPolicy.RELIABLE

    def _add_topic(self, name: str, type_name: str, publisher: Any, offers: Sequence[Any]) -> int:
        schema = collect_schema(type_name, _share_folder)
        if not schema.text:
            self._warn_once(name, f'is recorded without the definition of {type_name}')
        type_hash = str(publisher.topic_type_hash)
        if not type_hash.startswith('RIHS01_'):
            type_hash = ''
        topic_id = self._writer.add_topic(name, type_name, schema, type_hash, offers)
        self._recording.watch_losses(topic_id, has_one_publisher=len(offers) == 1)
        return topic_id

    def _warn_once(self, name: str, problem: str) -> None:
        if (name, problem) not in self._warned:
            self._warned.add((name, problem))
            self._node.get_logger().warning(f'{name} {problem}')


def _ignore(_: bytes) -> None:
    """Stand in for a callback; messages are taken, not called back."""


def _share_folder(package: str) -> Path:
    return Path(get_package_share_directory(package))
