"""Node `viewer`: shows a graph that runs, and keeps out of its way."""

from pathlib import Path
import re
from typing import Any

import pytest
from spikelane_msgs.msg import LaneState

from spikelane.nodes.viewer import ViewerParameters
from spikelane_sim.messages import to_stamp_ns

pytestmark = pytest.mark.ros

PORTS = {'web_port': 0, 'grpc_port': 0}
STEPS = 100
ATTEMPTS = 5
#: What a client must have been sent.
WANTED = {'/lane/distance', '/camera/events', '/course/markings', '/course/robot'}


def test_it_shows_a_graph_that_runs_and_ends_quietly(
    graph: Any, tmp_path: Path, shown_at: Any
) -> None:
    """It asks the simulator for the course; the distances it shows are those of their steps."""
    node, published = graph.node, {}

    def keep(message: LaneState) -> None:
        published[to_stamp_ns(message.header.stamp)] = message.distance

    node.create_subscription(LaneState, 'lane/state', keep, 10_000)
    course = 'scenario_2'
    # Lap after lap, however long a client takes to come.
    endless = {'robot.model': 'kinematic', 'course': course, 'episode.max_laps': 0}
    graph.start('simulator', endless)
    driver = graph.start('rstdp', {'checkpoint': course})
    viewer = graph.start('viewer', PORTS)
    graph.until(lambda: 'open http://127.0.0.1:' in viewer.log, 'the address')
    topics = ('/lane/state', '/event_camera/events', '/controller/state')

    def subscriptions(topic: str) -> list[Any]:
        infos = node.get_subscriptions_info_by_topic(topic)
        return [info.qos_profile for info in infos if info.node_name == 'viewer']

    graph.until(lambda: all(map(subscriptions, topics)), 'its subscriptions')
    for topic in topics:
        [profile] = subscriptions(topic)
        assert profile.reliability.name == 'BEST_EFFORT'
    port = re.findall(r'127\.0\.0\.1%3A(\d+)', viewer.log)[0]
    address = f'rerun+http://127.0.0.1:{port}/proxy'
    shown: dict[str, Any] = {}
    for attempt in range(ATTEMPTS):
        # While it drives; what was published before it was looked for may be lost. Steps of the
        # driver before it may still be on their way: the new one must be there first, as a
        # signal that comes while Python starts ends it with another status.
        graph.until(lambda: node.count_publishers('wheel_velocities') == 1, 'the driver')
        already = len(published)
        graph.until(lambda already=already: len(published) > already + STEPS, 'steps')
        assert driver.stop() == 130  # so that nothing more comes and the client is done
        shown = shown_at(address, tmp_path / f'{attempt}.rrd')
        if shown.keys() >= WANTED:
            break
        graph.until(lambda: not node.count_publishers('wheel_velocities'), "the driver's end")
        driver = graph.start('rstdp', {'checkpoint': course})  # the machine is busy
    assert shown.keys() >= WANTED
    distances = shown['/lane/distance']['Scalars:scalars']
    # What was published before we were found is not known here.
    known = distances.keys() & published.keys()
    assert known
    assert {at: distances[at] for at in known} == {at: [published[at]] for at in known}
    assert viewer.stop() == 0
    assert 'Traceback' not in viewer.log
    assert 'not shown' not in viewer.log


def test_two_do_not_share_a_port(graph: Any) -> None:
    """The second says which is in use, with exit status 2."""
    first = graph.start('viewer', PORTS)
    graph.until(lambda: 'open http' in first.log, 'the address')
    port = re.findall(r'127\.0\.0\.1:(\d+)', first.log)[0]
    second = graph.start('viewer', {'web_port': port, 'grpc_port': 0})
    assert second.wait() == 2
    assert f'web_port: expected a free port, got {port}' in second.log
    assert first.stop() == 0


def test_parameters_are_checked(graph: Any) -> None:
    """One line names the parameter and what is allowed."""
    viewer = graph.start('viewer', {'rate_hz': 0.0})
    assert viewer.wait() == 2
    assert 'rate_hz' in viewer.log
    assert ViewerParameters().rate_hz == 20.0
