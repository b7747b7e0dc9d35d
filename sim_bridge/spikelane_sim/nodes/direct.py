"""Subscriptions that are waited for directly, past the executor.

An rclpy executor rebuilds its wait set from all entities of a node for every message; with a
simulator's services that costs more than the simulation step. The few subscriptions on the
lockstep path therefore have a wait set and a thread of their own (in the way of
`rclpy.wait_for_message`), while the executor serves everything else of the same node.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import threading
import time
import traceback
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from spikelane_sim.errors import MessageError, SpikelaneError
from spikelane_sim.nodes.local_topics import CARRIED_TOPICS, LocalSubscription, LocalTopics
from spikelane_sim.nodes.rclpy_internals import (
    call_event_handlers,
    DirectWait,
    NotForExecutors,
    take_with_time,
)

#: From one look for events of direct subscriptions to the next [s].
EVENTS_PERIOD_S = 1.0


class SubscriptionEvents:
    """The events of direct subscriptions, which are looked for once in a while.

    The warning that a publisher's quality of service does not match is one of them. An executor
    must not wait for them: in Fast DDS the condition of an event is that of its reader, so that
    every message would wake the executor, again and again until the message is taken.
    """

    def __init__(self) -> None:
        """Begin with no subscription."""
        self._subscriptions: list[Subscription] = []

    def add(self, subscription: Subscription) -> None:
        """Look for the events of another subscription, too; from any thread."""
        self._subscriptions.append(subscription)

    def look(self) -> None:
        """Call the callbacks of all events that have happened since the last look."""
        for subscription in list(self._subscriptions):
            if not call_event_handlers(subscription):  # it was replaced by another one
                self._subscriptions.remove(subscription)

    def look_regularly(self, node: Node) -> None:
        """Let a node's executor look, by one timer however many subscriptions there are.

        The timer runs by steady time: that of a simulator may stand still.
        """
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(EVENTS_PERIOD_S, self.look, clock=steady)


class DirectSubscriptions:
    """Some subscriptions of a node, with one thread that waits for and handles their messages.

    Messages of one topic are handled in order; of several topics that have messages waiting, the
    one subscribed to first comes first. An exception in a handler is logged and ends the node,
    since a lockstep graph would wait for it for ever: a SpikelaneError in a line, with its exit
    status; any other is a bug, logged whole, with exit status 1. A MessageError is about one
    message alone: the message is refused, which is logged once a second at most.

    Where the node shares its process with its peer, the topics between them are not subscribed to
    in the middleware (`local_topics`), and all messages are handled in the thread that both share.

    Attributes:
        refused: Messages that were refused.
    """

    def __init__(
        self,
        node: Node,
        needs_all: Callable[[], bool] = lambda: False,
        local: LocalTopics | None = None,
    ) -> None:
        """Prepare; nothing is received before `start`.

        Args:
            node: The node that subscribes.
            needs_all: Whether to wait for the companions, too, see `subscribe`.
            local: Carries the topics between the nodes of this process; None: there are none.
        """
        self._node = node
        self._local = local
        self._local_subscriptions: list[LocalSubscription] = []
        self._needs_all = needs_all
        self._group = NotForExecutors()
        self._events = SubscriptionEvents()
        self._events.look_regularly(node)
        self._subscriptions: list[tuple[Subscription, Callable[[Any], None]]] = []
        self._companions: set[Subscription] = set()
        self._renewals: list[tuple[str, QoSProfile]] = []
        self._is_wanted: dict[Subscription, Callable[[], bool]] = {}
        self._wait = DirectWait(node.context, self._group)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._stopping = False
        self.refused = self._received_ns = 0

    @property
    def waited_s(self) -> float:
        """Time since the middleware received the message at hand [s]; 0 within a process."""
        return 0.0 if self._local is not None else (time.time_ns() - self._received_ns) / 1e9

    def subscribe(
        self,
        kind: type,
        topic: str,
        handle: Callable[[Any], None],
        qos: QoSProfile,
        *,
        is_companion: bool = False,
        is_wanted: Callable[[], bool] | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
    ) -> None:
        """Subscribe to a topic; before `start` only.

        Args:
            kind: Type of the messages.
            topic: Name of the topic.
            handle: Receives each message.
            qos: Quality of service.
            is_companion: Its messages come just before those of another topic and are of use
                only with them: they are taken then, and wake nobody. A wake-up costs about as
                much as a step of the simulator.
            event_callbacks: As of rclpy; served by the executor.
            is_wanted: Whether its messages are of use now; they wait otherwise. None: always.
        """
        if self._local is not None and topic in CARRIED_TOPICS:
            self._subscribe_locally(self._local, kind, topic, handle, qos)
            return
        subscription = self._node.create_subscription(
            kind,
            topic,
            handle,
            qos,
            callback_group=self._group,
            event_callbacks=event_callbacks,
        )
        self._events.add(subscription)
        self._subscriptions.append((subscription, handle))
        if is_companion:
            self._companions.add(subscription)
        if is_wanted is not None:
            self._is_wanted[subscription] = is_wanted

    def _subscribe_locally(
        self,
        local: LocalTopics,
        kind: type,
        topic: str,
        handle: Callable[[Any], None],
        qos: QoSProfile,
    ) -> None:
        name = self._node.resolve_topic_name(topic)
        guarded = partial(self._handle_alone, handle, name)
        node_name = self._node.get_fully_qualified_name()
        subscription = LocalSubscription(node_name, kind, guarded, qos.depth)
        self._local_subscriptions.append(subscription)
        local.subscribe(name, subscription)

    def renew(self, topic: str, qos: QoSProfile) -> None:
        """Subscribe to a topic again, with another quality of service; from any thread."""
        self._renewals.append((topic, qos))
        if self._thread.is_alive():
            self._wait.wake()
        else:
            self._renew()

    def start(self) -> None:
        """Begin to handle messages."""
        self._thread.start()
        if self._local is not None:
            for subscription in self._local_subscriptions:
                self._local.start(subscription)

    def wake(self) -> None:
        """Ask again whether to wait for the companions, too; from any thread."""
        self._wait.wake()

    def stop(self) -> None:
        """Stop handling messages; returns when the handler at work has ended."""
        self._stopping = True
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._wait.wake()
            self._thread.join()
        if self._local is not None:
            self._local.stop()

    def _run(self) -> None:
        # A signal wakes the executor alone, whose thread then calls `stop`. A guard condition for
        # signals of our own would have to be given up here, while rclpy may still be going
        # through its list of them: the executor's, next in it, would be forgotten.
        context = self._node.context
        try:
            self._wait.begin(len(self._subscriptions))
            while not self._stopping and context.ok():
                needs_all = self._needs_all()
                self._wait.wait(
                    subscription
                    for subscription, _ in self._subscriptions
                    if needs_all or subscription not in self._companions
                )
                if context.ok():
                    self._handle()
                    self._renew()
        except Exception as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        """End the node, in an exception's handler."""
        context = self._node.context
        if not context.ok():
            return  # a signal came in the middle of a message: nothing can be published
        reason, status = traceback.format_exc(), 1
        if isinstance(error, SpikelaneError):
            reason, status = str(error), error.exit_status
        self._node.get_logger().fatal(reason)
        self._node.exit_status = status
        context.try_shutdown()

    def _renew(self) -> None:
        """Replace subscriptions, in the thread that waits for them once it runs."""
        while self._renewals:
            topic, qos = self._renewals.pop(0)
            for place, (old, handle) in enumerate(self._subscriptions):
                if old.topic == topic:
                    new = self._node.create_subscription(
                        old.msg_type, topic, handle, qos, callback_group=self._group
                    )
                    self._events.add(new)
                    self._subscriptions[place] = (new, handle)
                    self._node.destroy_subscription(old)

    def _handle(self) -> None:
        for subscription, handle in self._subscriptions:
            is_wanted = self._is_wanted.get(subscription)
            if is_wanted is not None and not is_wanted():
                continue
            while (taken := take_with_time(subscription)) is not None:
                message, self._received_ns = taken
                name = subscription.topic_name
                if self._local is None:
                    self._handle_message(handle, name, message)
                else:  # in one thread with the messages of the other node
                    self._local.call(partial(self._handle_alone, handle, name, message))

    def _handle_message(self, handle: Callable[[Any], None], topic: str, message: Any) -> None:
        try:
            handle(message)
        except MessageError as error:
            self.refused += 1
            self._node.get_logger().error(f'{topic}: {error}; refused', throttle_duration_sec=1.0)

    def _handle_alone(self, handle: Callable[[Any], None], topic: str, message: Any) -> None:
        """Handle a message in the thread that the nodes of this process share."""
        if self._stopping or not self._node.context.ok():
            return
        try:
            self._handle_message(handle, topic, message)
        except Exception as error:
            self._fail(error)
