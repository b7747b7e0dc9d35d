"""The state of a node, on /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from spikelane_sim import topic_names

#: Messages, about one a second: a drive waits for a recorder for up to 10 minutes.
_DEPTH = 1000


class StatusPublisher:
    """Publishes the state of one node as a DiagnosticArray."""

    def __init__(self, node: Node, name: str, hardware_id: str = '') -> None:
        """Create the publisher.

        Args:
            node: The node.
            name: Name of the status.
            hardware_id: What the node works with.
        """
        self._node = node
        self._name, self._hardware_id = name, hardware_id
        self._publisher = node.create_publisher(DiagnosticArray, topic_names.DIAGNOSTICS, _DEPTH)

    def publish(self, message: str, values: Mapping[str, object], *, is_worrying: bool) -> None:
        """Publish the state.

        Args:
            message: The state in words.
            values: Counts and the like, by name.
            is_worrying: Whether the level is WARN; otherwise it is OK.
        """
        status = DiagnosticStatus(
            name=self._name,
            hardware_id=self._hardware_id,
            level=DiagnosticStatus.WARN if is_worrying else DiagnosticStatus.OK,
            message=message,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)
