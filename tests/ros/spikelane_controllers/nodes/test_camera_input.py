"""Controller nodes and cameras' drivers: what is received, and what a node says that waits."""

import json
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from event_camera_msgs.msg import EventPacket
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from spikelane_msgs.msg import WheelVelocities

from spikelane.bag.drive import RecordedDrive
from spikelane_sim.nodes import conversions

pytestmark = pytest.mark.ros

DATA = Path(__file__).parents[3] / 'data' / 'cameras'
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


def play(graph: Any, publisher: Any, name: str) -> None:
    """Publish a camera's recorded packets, 2 ms apart."""
    message = EventPacket()
    for recorded in RecordedDrive(DATA / f'{name}.mcap').packets():
        conversions.fill_received_packet(message, recorded.packet)
        publisher.publish(message)
        time.sleep(0.002)


def test_a_best_effort_camera_is_received_with_default_settings(graph: Any) -> None:
    """As the drivers of ros-event-camera publish; what is odd in the packets is said."""
    got: list[WheelVelocities] = []
    node = graph.node
    node.create_subscription(WheelVelocities, '/cam/wheel_velocities', got.append, 1000)
    publisher = node.create_publisher(EventPacket, '/cam/event_camera/events', BEST_EFFORT)
    process = graph.start('braitenberg', {'use_lane_state': 'false'}, '-r', '__ns:=/cam')
    graph.until(publisher.get_subscription_count, 'the subscription')
    graph.until(lambda: node.count_publishers('/cam/wheel_velocities'))
    play(graph, publisher, 'reserved_words')
    graph.until(lambda: len({each.header.stamp.nanosec for each in got}) == 19, '19 answers')
    graph.until(lambda: 'reserved words in event packets were skipped' in process.log)
    assert 'incompatible' not in process.log
    node.destroy_publisher(publisher)


def test_a_node_says_where_qos_do_not_match_and_what_it_lacks(graph: Any) -> None:
    """A reliable subscription to a best-effort camera gives the usual warning of rclpy."""
    publisher = graph.node.create_publisher(EventPacket, '/no/event_camera/events', BEST_EFFORT)
    parameters = {'use_lane_state': 'false', 'reliability': 'reliable'}
    process = graph.start('braitenberg', parameters, '-r', '__ns:=/no')
    graph.until(lambda: 'offering incompatible QoS' in process.log, 'the warning')
    graph.until(lambda: 'waiting for observations: no event packet that completes' in process.log)
    assert 'received 0 event packets, answered 0 steps' in process.log
    graph.node.destroy_publisher(publisher)


def test_diagnostics_tell_what_was_received_and_what_is_awaited(graph: Any) -> None:
    """Once a second; WARN in the second of a fault, and once nothing has come for 4 s."""
    got: list[DiagnosticStatus] = []
    node = graph.node
    node.create_subscription(
        DiagnosticArray, '/diagnostics', lambda message: got.extend(message.status), 10
    )
    publisher = node.create_publisher(EventPacket, '/seen/event_camera/events', BEST_EFFORT)
    process = graph.start('rstdp', {'use_lane_state': 'false'}, '-r', '__ns:=/seen')
    graph.until(publisher.get_subscription_count, 'the subscription')

    def told() -> list[tuple[bytes, dict[str, str]]]:
        """Return level and values of each message of this node."""
        return [
            (each.level, {pair.key: pair.value for pair in each.values})
            for each in got
            if each.name == 'rstdp'
        ]

    graph.until(told, 'the first diagnostics')
    play(graph, publisher, 'reserved_words')
    graph.until(lambda: told()[-1][1]['steps'] == '19', 'diagnostics of 19 steps')
    values = told()[-1][1]
    rates = [float(values.pop(f'events_{which}_per_s')) for which in ('in', 'out')]
    assert rates[0] == rates[1] >= 0
    assert values == {
        'event_packets': '200',
        'events_in': '4000',
        'events_out': '4000',
        'lane_states': '0',
        'steps': '19',
        'waiting_s': '0.0',
        'source': 'camera',
        'faulty_packets': '0',
        'lost_packets': '0',
        'reserved_words': '800',
        'events_outside': '0',
        'events_mistimed': '0',
        'restarts': '0',
    }
    assert DiagnosticStatus.WARN in [level for level, _ in told()]
    graph.until(lambda: told()[-1][0] == DiagnosticStatus.OK, 'a second without a fault')
    graph.until(lambda: float(told()[-1][1]['waiting_s']) >= 4.0, '4 s without a packet')
    assert told()[-1][0] == DiagnosticStatus.WARN
    assert got[-1].message.startswith('waiting for observations: no event packet that completes')
    assert process.status is None
    node.destroy_publisher(publisher)


def test_a_camera_of_another_name_is_counted(graph: Any) -> None:
    """A remapped topic has a publisher: only what it publishes is missing."""
    publisher = graph.node.create_publisher(EventPacket, '/named/camera/events', 10)
    remapped = ('-r', '__ns:=/renamed', '-r', 'event_camera/events:=/named/camera/events')
    process = graph.start('braitenberg', {'use_lane_state': 'false'}, *remapped)
    graph.until(lambda: 'waiting for observations: ' in process.log)
    assert 'no event packet that completes a step arrives from 1 publishers' in process.log
    graph.node.destroy_publisher(publisher)


def test_a_node_without_a_camera_says_so_within_5_s(graph: Any) -> None:
    """In one line."""
    process = graph.start('braitenberg', {}, '-r', '__ns:=/none')
    said = 'waiting for observations: event_camera/events has no publisher; received 0 event '
    graph.until(lambda: said + 'packets and 0 lane states, answered 0 steps' in process.log)


def test_a_camera_without_lane_states_is_told_how_to_be_used(graph: Any) -> None:
    """The node waits for lane/state unless it is told not to."""
    publisher = graph.node.create_publisher(EventPacket, '/lane/event_camera/events', 10)
    process = graph.start('braitenberg', {}, '-r', '__ns:=/lane')
    graph.until(publisher.get_subscription_count, 'the subscription')
    play(graph, publisher, 'plain')
    graph.until(lambda: 'a camera publishes no lane states: use_lane_state:=false' in process.log)
    graph.node.destroy_publisher(publisher)


def test_a_replay_counts_what_the_controller_answered(graph: Any) -> None:
    """All 19 steps, though the bag has no answers to compare them with."""
    remapped = ('-r', '__ns:=/count')
    graph.start('braitenberg', {'use_lane_state': 'false'}, *remapped)
    process = graph.start('replay', {'bag': DATA / 'plain.mcap'}, *remapped)
    graph.until(lambda: process.status is not None, 'the end of the replay')
    result = json.loads(process.log.splitlines()[-1])
    assert (result['observations'], result['answered'], result['answers']) == (19, 19, 0)
