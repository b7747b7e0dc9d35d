"""Tells publishers that wait for the recorder what it has written."""

from __future__ import annotations

import array
from collections.abc import Mapping
import time

from rclpy.node import Node
from spikelane_msgs.msg import RecorderState

from spikelane.bag.recording import Recording
from spikelane_sim.nodes.recorder_window import NEWS_STEPS
from spikelane_sim.nodes.topics import LATCHED

_REPEAT_S = 1.0


class Announcer:
    """Publishes `RecorderState` where somebody listens: as rarely as those who wait allow."""

    def __init__(self, node: Node, topic: str) -> None:
        """Create the publisher."""
        self._node = node
        self._publisher = node.create_publisher(RecorderState, topic, LATCHED)
        self._state = RecorderState()
        self._announced: dict[str, int] = {}
        self._repeat_s = 0.0

    @property
    def is_waited_for(self) -> bool:
        """Whether somebody goes no further than what is written."""
        return bool(self._publisher.get_subscription_count())

    def announce(
        self, recording: Recording, topics: Mapping[str, int], *, has_caught_up: bool
    ) -> None:
        """Publish what is written if it is news, and once in a while in any case.

        Args:
            recording: What writes.
            topics: Ids of the topics recorded, by name.
            has_caught_up: Whether nothing more has arrived: somebody may be waiting then.
        """
        if not self.is_waited_for:
            return
        numbers = recording.last_numbers
        known = {name: numbers[of] for name, of in topics.items() if of in numbers}
        news = max((known[name] - self._announced.get(name, 0) for name in known), default=0)
        now_s = time.monotonic()
        if news >= NEWS_STEPS or (has_caught_up and news) or now_s >= self._repeat_s:
            self._publish(known, recording)
            self._announced, self._repeat_s = known, now_s + _REPEAT_S

    def _publish(self, known: Mapping[str, int], recording: Recording) -> None:
        state = self._state
        if state.topics != list(known):
            state.topics = list(known)
        state.sequence_numbers = array.array('Q', known.values())
        state.header.stamp = self._node.get_clock().now().to_msg()
        state.written, state.lost = recording.written_count, recording.lost_count
        self._publisher.publish(state)
