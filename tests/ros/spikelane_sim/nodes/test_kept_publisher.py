"""A publisher that sends its last message again where a subscriber has missed it."""

from __future__ import annotations

import pytest
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from spikelane_sim.nodes.kept_publisher import KeptPublisher

pytestmark = pytest.mark.ros


def test_the_last_message_is_sent_again_only_where_somebody_missed_it(graph) -> None:
    """Nothing is made for nobody; whoever is met later is counted as having missed it."""
    matches: list[int] = []
    made: list[str] = []

    def make() -> String:
        made.append('once')
        return String(data=f'message {len(made)}')

    publisher = KeptPublisher(
        graph.node, String, 'kept', QoSProfile(depth=10), lambda: matches.append(1)
    )
    assert not publisher.is_missed
    publisher.send(make)
    assert (made, publisher.sent) == ([], 0)

    first: list[str] = []
    graph.node.create_subscription(String, 'kept', lambda each: first.append(each.data), 10)
    graph.until(lambda: matches, 'the first subscriber')
    assert publisher.is_missed
    publisher.send_again(make)
    graph.until(lambda: first == ['message 1'], 'the first message')
    assert not publisher.is_missed
    publisher.send_again(make)
    assert publisher.sent == 1

    second: list[str] = []
    matches.clear()
    late = graph.node.create_subscription(
        String, 'kept', lambda each: second.append(each.data), 10
    )
    graph.until(lambda: matches, 'the second subscriber')
    publisher.send_again(make)
    graph.until(lambda: second == ['message 2'], 'the second message')

    matches.clear()
    graph.node.destroy_subscription(late)
    graph.until(lambda: matches, 'the second subscriber to leave')
    assert not publisher.is_missed
    matches.clear()
    graph.node.create_subscription(String, 'kept', lambda each: second.append(each.data), 10)
    graph.until(lambda: matches, 'the third subscriber')
    assert publisher.is_missed
