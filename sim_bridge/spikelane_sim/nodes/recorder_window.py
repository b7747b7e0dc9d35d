"""Waiting for a recorder: a node publishes no further than the recorder's last message allows.

Publishers keep a limited history. A recorder that is stopped, or that a busy machine keeps away
for longer than the history lasts, would lose messages. The recorder therefore publishes what it
has written (`spikelane_msgs/RecorderState`), and who must not be ahead of it by more than a window
of steps holds back the next message until it has caught up.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from spikelane_msgs.msg import RecorderState

#: Steps after which it is worth telling, and looking, what the recorder has written.
NEWS_STEPS = 100


class RecorderWindow:
    """Counts how many steps may still be published before the recorder must have written more."""

    def __init__(self, steps: int, sent: Callable[[], Mapping[str, int]]) -> None:
        """Begin with a whole window.

        Args:
            steps: Width of the window, safely below the history of every publisher concerned, each
                of which publishes one message a step; 0: never wait.
            sent: Returns how many messages were published on each topic, by its full name.
        """
        self._steps = steps
        self._sent = sent
        self._left = steps
        # By topics of which nothing was recorded yet: messages sent when they were first listed.
        self._unrecorded: dict[str, int] = {}

    @property
    def is_used(self) -> bool:
        """Whether there is a recorder to wait for."""
        return self._steps > 0

    @property
    def is_full(self) -> bool:
        """Whether the next step must wait for the recorder."""
        return self._steps > 0 and self._left <= 0

    @property
    def wants_news(self) -> bool:
        """Whether what the recorder has written is worth looking at."""
        return self._steps > 0 and self._left <= max(self._steps - NEWS_STEPS, 0)

    @property
    def steps_ahead(self) -> int:
        """Steps published that the recorder has not written, as far as it has said."""
        return self._steps - self._left

    def count_step(self) -> None:
        """Note that a step has been published."""
        self._left -= 1

    def update(self, state: RecorderState) -> None:
        """Take what the recorder has written."""
        written = dict(zip(state.topics, state.sequence_numbers, strict=False))
        ahead = [
            count - (written[topic] or self._unrecorded.setdefault(topic, count))
            for topic, count in self._sent().items()
            if topic in written
        ]
        self._left = self._steps - max(ahead, default=0)
