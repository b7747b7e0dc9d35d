"""A recorder that is not ours, as `ros2 bag record`: a drive can wait for it and keep all."""

import time
from typing import Any

from event_camera_msgs.msg import EventPacket
import pytest
from rclpy.qos import QoSProfile
from spikelane_msgs.msg import LaneState, WheelVelocities
from spikelane_msgs.srv import Reset

from spikelane_sim.messages import to_stamp_ns

pytestmark = pytest.mark.ros

STEPS = 150
SPACE = '/foreign'
STAMPS_NS = [50_000_000 * number for number in range(1, STEPS + 2)]


def test_all_of_a_drive_is_kept_for_whoever_is_slow(graph: Any) -> None:
    """With `autostart` false, `wait_for_subscribers` and a deep history: each message once."""
    names = ('-r', f'__ns:={SPACE}')
    drive = {'robot.model': 'kinematic', 'episode.max_steps': STEPS, 'autostart': 'false'}
    both = {'history_depth': 1000, 'wait_for_subscribers': 2}
    simulator = graph.start('simulator', drive | both, *names)
    graph.start('braitenberg', both, *names)
    stamps: dict[str, set[int]] = {}
    # Whoever is matched to the last is matched to all of a node.
    for kind, topic in (
        (WheelVelocities, 'wheel_velocities'),
        (LaneState, 'lane/state'),
        (EventPacket, 'event_camera/events'),
    ):
        found = stamps.setdefault(topic, set())
        graph.node.create_subscription(
            kind,
            f'{SPACE}/{topic}',
            lambda message, found=found: found.add(to_stamp_ns(message.header.stamp)),
            QoSProfile(depth=1000),
        )
    assert not any(stamps.values())
    reset = graph.call(Reset, f'{SPACE}/simulator/reset', lane='outer', seed=1)
    assert reset.success
    # Nothing is taken meanwhile.
    while f'ended after {STEPS} steps' not in simulator.log:
        assert simulator.status is None
        time.sleep(0.1)
    graph.until(lambda: all(len(each) > STEPS for each in stamps.values()), 'all messages')
    assert {topic: sorted(each) for topic, each in stamps.items()} == dict.fromkeys(
        stamps, STAMPS_NS
    )
