"""All that Spikelane uses of rclpy's internals: what no public call offers.

A new version of rclpy may change any of it. Nothing outside this module touches a name of rclpy
that begins with an underscore, its compiled part, or the handle of an entity.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.subscription import Subscription


class NotForExecutors(CallbackGroup):
    """Keeps executors away from the subscriptions in it: somebody else takes their messages."""

    def can_execute(self, entity: object) -> bool:
        """Refuse."""
        del entity
        return False

    def beginning_execution(self, entity: object) -> bool:
        """Refuse."""
        del entity
        return False

    def ending_execution(self, entity: object) -> None:
        """Do nothing: nothing is ever begun."""
        del entity


class DirectWait:
    """Waits for messages of subscriptions in the calling thread, without an executor."""

    def __init__(self, context: Context, group: CallbackGroup) -> None:
        """Prepare.

        Args:
            context: That of the subscriptions.
            group: That of the subscriptions; executors must not be in it.
        """
        self._context = context
        self._wake = GuardCondition(None, group, context=context)

    def begin(self, most: int) -> None:
        """Prepare to wait for up to so many subscriptions, in the thread that will wait."""
        self._set = _rclpy.WaitSet(most, 1, 0, 0, 0, 0, self._context.handle)

    def wait(self, subscriptions: Iterable[Subscription]) -> None:
        """Wait until one of the subscriptions has a message, or until `wake` is called."""
        self._set.clear_entities()
        for subscription in subscriptions:
            self._set.add_subscription(subscription.handle)
        self._set.add_guard_condition(self._wake.handle)
        self._set.wait(-1)

    def wake(self) -> None:
        """End the present wait, or the next one; from any thread."""
        self._wake.trigger()


def take(subscription: Subscription) -> Any:
    """Take the next message of a subscription that no executor serves; None if there is none."""
    taken = take_with_time(subscription)
    return None if taken is None else taken[0]


def take_with_time(subscription: Subscription) -> tuple[Any, int] | None:
    """As `take`, with the system's time at which the middleware received the message [ns]."""
    taken = subscription.handle.take_message(subscription.msg_type, False)
    return (taken[0], taken[1]['received_timestamp']) if taken else None


def take_raw(subscription: Subscription) -> tuple[bytes, dict[str, int]] | None:
    """Take the next message as it was sent, with its times and numbers; None if there is none."""
    taken: tuple[bytes, dict[str, int]] | None
    taken = subscription.handle.take_message(subscription.msg_type, True)
    return taken


def call_event_handlers(subscription: Subscription) -> bool:
    """Call the callbacks of what has happened to a subscription that no executor serves.

    Returns:
        Whether the subscription still exists.
    """
    try:
        for handler in subscription.event_handlers:
            handler._ready_to_take_data = True
            found = handler.take_data()
            if found is not None and getattr(found, 'total_count_change', True):
                handler.callback(found)
    except _rclpy.InvalidHandle:
        return False
    return True


def given_parameters(node: Node) -> tuple[str, ...]:
    """Return the names of all parameters that a node was given, whether or not it has them."""
    return tuple(node._parameter_overrides)
