"""Futures that handlers of an executor await and any thread may complete."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.task import Future


class Awaitable:
    """A result to come; completing it wakes the executor of a node, from whatever thread."""

    def __init__(self, node: Node) -> None:
        """Make a result that is yet to come."""
        self._node = node
        self._future = Future()

    def complete(self, result: Any = None) -> None:
        """Set the result, once; further calls do nothing."""
        if not self._future.done():
            self._future.set_result(result)
            if self._node.executor is not None:
                self._node.executor.wake()

    async def result(self) -> Any:
        """Wait for the result."""
        return await self._future
