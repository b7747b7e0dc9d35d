"""A recorder of many topics answers its services as quickly as one of a few."""

from pathlib import Path
import statistics
import time

import pytest
from rcl_interfaces.srv import GetParameters
from std_msgs.msg import Float64

pytestmark = pytest.mark.ros

TOPICS = 12


def test_a_recorder_of_many_topics_tells_its_parameters_at_once(graph, tmp_path: Path) -> None:
    """It looks for requests 5 times a second, whatever the number of its subscriptions."""
    publishers = [graph.node.create_publisher(Float64, f'x{n}', 1) for n in range(TOPICS)]
    process = graph.start('recorder', {'output': tmp_path / 'bag'})
    graph.until(lambda: all(each.get_subscription_count() for each in publishers), 'the recorder')
    client = graph.node.create_client(GetParameters, 'recorder/get_parameters')
    graph.until(client.service_is_ready, 'the service')
    seconds = []
    for _ in range(5):
        start_s = time.monotonic()
        answer = client.call_async(GetParameters.Request(names=['depth']))
        graph.until(answer.done, 'the answer')
        assert answer.result().values[0].integer_value == 10000
        seconds.append(time.monotonic() - start_s)
    assert statistics.median(seconds) < 1.0, seconds
    assert process.stop() == 0
