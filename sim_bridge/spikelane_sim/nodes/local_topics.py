"""Topics between the nodes of one process: messages reach the other node without the middleware.

rclpy has no transport within a process: a message to a node of the same process takes the same way
as one to another process, with two wake-ups a step. Where a simulator and its controller are
composed in one process, what they send each other is therefore put into a queue, and one thread
calls the handlers of both nodes.

Each message is serialised once. The other node is given what deserialisation makes of it, and
subscribers of other processes are sent the same bytes: both get the same message, and no node
sees an object that another one refills. Where there is no subscriber in another process, nothing
is given to the middleware. The publishers exist in any case, so that others discover them.

The subscriptions of these topics do not exist in the middleware. A message that another process
publishes on `wheel_velocities`, for example, does not arrive. That such a publisher exists is
noticed as in separate processes (`sole_publishers`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from queue import SimpleQueue
import threading
from typing import Any

from rclpy.serialization import deserialize_message, serialize_message

from spikelane_sim import topic_names

#: The topics on which a simulator and a controller send each other messages.
CARRIED_TOPICS = (
    topic_names.LANE_STATE,
    topic_names.JOINT_STATES,
    topic_names.EVENTS,
    topic_names.WHEELS,
)


class LocalSubscription:
    """What one node has yet to handle of a topic; the oldest message is dropped beyond a depth.

    Attributes:
        node_name: Full name of the node that subscribes.
    """

    def __init__(
        self, node_name: str, kind: type, handle: Callable[[Any], None], depth: int
    ) -> None:
        """Begin with no message.

        Args:
            node_name: Full name of the node.
            kind: Type of the messages.
            handle: Receives each message, in the thread of `LocalTopics`.
            depth: Messages that are kept.
        """
        self.node_name = node_name
        self._kind, self._handle = kind, handle
        self._waiting: deque[bytes] = deque(maxlen=depth)

    def add(self, data: bytes) -> None:
        """Keep a serialised message."""
        self._waiting.append(data)

    def handle_next(self) -> None:
        """Handle the oldest message, if one is left."""
        if self._waiting:
            self._handle(deserialize_message(self._waiting.popleft(), self._kind))

    def __len__(self) -> int:
        """Return how many messages wait."""
        return len(self._waiting)


class LocalTopics:
    """Carries messages between nodes of one process, and calls the handlers in one thread."""

    def __init__(self) -> None:
        """Begin with no publisher and no subscription."""
        self._subscriptions: dict[str, list[LocalSubscription]] = {}
        self._on_match: dict[str, list[Callable[[], None]]] = {}
        self._started: set[LocalSubscription] = set()
        self._calls: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._is_running = False

    def advertise(self, topic: str, on_match: Callable[[], None]) -> None:
        """Note a publisher.

        Args:
            topic: Full name of the topic.
            on_match: Called when a node of this process subscribes.
        """
        self._on_match.setdefault(topic, []).append(on_match)

    def subscribe(self, topic: str, subscription: LocalSubscription) -> None:
        """Add a subscription to a topic, by its full name; its messages wait until `start`."""
        self._subscriptions.setdefault(topic, []).append(subscription)
        for tell in self._on_match.get(topic, ()):
            tell()

    def start(self, subscription: LocalSubscription) -> None:
        """Begin to handle the messages of a subscription, first those that wait."""
        if not self._is_running:  # not before: signals must find no thread of ours at the start
            self._is_running = True
            self._thread.start()
        self._started.add(subscription)
        for _ in range(len(subscription)):
            self._calls.put(subscription.handle_next)

    def subscribers(self, topic: str) -> list[LocalSubscription]:
        """Return the subscriptions of a topic, by its full name."""
        return self._subscriptions.get(topic, [])

    def send(self, topic: str, data: bytes) -> None:
        """Send a serialised message to all nodes of this process that subscribe; from any thread.

        Their handlers are called later: a handler may send a message itself.
        """
        for subscription in self.subscribers(topic):
            subscription.add(data)
            if subscription in self._started:
                self._calls.put(subscription.handle_next)

    def call(self, function: Callable[[], None]) -> None:
        """Call a function in the thread of the handlers; from any thread."""
        self._calls.put(function)

    def stop(self) -> None:
        """Call nothing more; returns when the handler at work has ended."""
        self._calls.put(None)
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join()

    def _run(self) -> None:
        while (call := self._calls.get()) is not None:
            call()


def serialised(message: Any) -> bytes:
    """Return a message as subscribers of other processes are sent it."""
    return bytes(serialize_message(message))
