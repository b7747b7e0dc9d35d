"""Node `lane_from_pose`: the simulator's robot, located by its odometry and by transforms."""

import time
from typing import Any

import pytest
from spikelane_msgs.msg import LaneState
from std_srvs.srv import Trigger

pytestmark = pytest.mark.ros


def test_it_says_where_the_simulators_robot_is(graph: Any) -> None:
    """As the simulator does itself; odometry counts from where the robot was placed."""
    given = {'mode': 'realtime', 'robot.engine': 'kinematic', 'episode.max_distance_m': 0.0}
    graph.start('simulator', given)
    truth: dict[int, float] = {}
    found: dict[str, dict[int, float]] = {'odometry': {}, 'transforms': {}}

    def note(values: dict[int, float], message: LaneState) -> None:
        values[message.header.stamp.sec * 10**9 + message.header.stamp.nanosec] = message.distance

    node = graph.node
    node.create_subscription(LaneState, '/lane/state', lambda each: note(truth, each), 1000)
    for name, values in found.items():
        node.create_subscription(
            LaneState, f'/{name}/lane/state', lambda each, values=values: note(values, each), 1000
        )
    odometry = graph.start(
        'lane_from_pose', {}, '-r', '__ns:=/odometry', '-r', 'odometry:=/ground_truth/odom'
    )
    graph.start(
        'lane_from_pose',
        {'source': 'transforms', 'world_frame': 'odom'},
        *('-r', '__ns:=/transforms'),
    )
    graph.until(lambda: truth and found['transforms'], 'a robot')
    graph.until(lambda: 'put it at the start of its lane and call' in odometry.log, 'a wish')
    assert found['odometry'] == {}
    assert graph.call(Trigger, '/odometry/lane_from_pose/place').success
    graph.start('rstdp', {'checkpoint': 'scenario_1'})
    graph.until(lambda: truth and max(map(abs, truth.values())) > 0.003, 'a robot that drives')
    since_s = time.monotonic()
    graph.until(lambda: time.monotonic() - since_s > 2.0)
    for values in found.values():
        common = truth.keys() & values.keys()
        assert len(common) > 20
        assert max(abs(truth[stamp] - values[stamp]) for stamp in common) < 1e-6


def test_a_course_that_is_not_there_ends_it(graph: Any) -> None:
    """With status 2 and one line."""
    process = graph.start('lane_from_pose', {'course': 'nowhere'})
    assert process.wait() == 2
    assert process.log.startswith('error: ')
    assert process.log.count('\n') == 1
