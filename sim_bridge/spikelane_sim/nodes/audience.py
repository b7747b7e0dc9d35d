"""Who has been sent a publisher's last message, so that it is sent again only to who missed it."""

from __future__ import annotations


class Audience:
    """Tells subscribers that have joined from those that the last message has reached.

    rclpy reports that a subscriber was met only some time after messages reach it.
    """

    def __init__(self) -> None:
        self._reached = 0

    def reach(self, count: int) -> None:
        """Note how many subscribers there are just before a message is sent."""
        self._reached = count

    def has_grown(self, count: int) -> bool:
        """Return whether there are subscribers, now `count`, that it has not reached."""
        has_grown = count > self._reached
        self._reached = min(count, self._reached)  # some may have left
        return has_grown
