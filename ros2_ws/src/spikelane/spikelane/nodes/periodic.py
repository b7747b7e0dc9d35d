"""Jobs of a loop that are done about every so often."""

from __future__ import annotations

from collections.abc import Callable
import time


class Periodic:
    """Something to be done about every so often."""

    def __init__(self, period_s: float, action: Callable[[], object]) -> None:
        """Be due at once, and then after each period [s]."""
        self._period_s = period_s
        self._action = action
        self._due_s = time.monotonic()

    def run_if_due(self) -> None:
        """Do it if it is due."""
        now_s = time.monotonic()
        if now_s >= self._due_s:
            self._due_s = now_s + self._period_s
            self._action()
