"""Tells publishers that wait for the recorder what it has written."""

from __future__ import annotations

import array
from collections.abc import Mapping, Sequence
import time

from rclpy.node import Node
from spikelane_msgs.msg import RecorderState

from spikelane.bag.recording import Recording
from spikelane_sim.nodes.meeting import LATCHED
from spikelane_sim.nodes.recorder_window import NEWS_STEPS

_REPEAT_S = 1.0


class Announcer:
    """Publishes `RecorderState` where somebody listens: as rarely as those who wait allow."""

    def __init__(
        self, node: Node, topic: str, wanted: Sequence[str], excluded: Sequence[str]
    ) -> None:
        """Create the publisher.

        Args:
            node: The recorder.
            topic: Full name of the topic to publish on.
            wanted: Full names of the topics to be recorded; none: all that are not hidden.
            excluded: Full names of the topics not to be recorded.
        """
        self._node = node
        self._publisher = node.create_publisher(RecorderState, topic, LATCHED)
        self._state = RecorderState(wanted=list(wanted), excluded=list(excluded))
        self._announced: dict[str, int] = {}
        self._repeat_s = 0.0

    @property
    def is_waited_for(self) -> bool:
        """Whether somebody goes no further than what is written."""
        return bool(self._publisher.get_subscription_count())

    def announce(
        self,
        recording: Recording,
        topics: Mapping[str, int],
        met: Sequence[str],
        *,
        has_caught_up: bool,
    ) -> None:
        """Publish what is written if it is news, and once in a while in any case.

        Args:
            recording: What writes.
            topics: Ids of the topics recorded, by name.
            met: Topics on which a publisher was met.
            has_caught_up: Whether nothing more has arrived: somebody may be waiting then.
        """
        if not self.is_waited_for:
            return
        numbers = recording.last_numbers
        known = {name: numbers[of] for name, of in topics.items() if of in numbers}
        news = max((known[name] - self._announced.get(name, 0) for name in known), default=0)
        now_s = time.monotonic()
        is_new = list(met) != self._state.met
        if is_new or news >= NEWS_STEPS or (has_caught_up and news) or now_s >= self._repeat_s:
            self._state.met = list(met)
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
