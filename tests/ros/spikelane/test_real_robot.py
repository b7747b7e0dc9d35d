"""A dry run of docs/real_robot.md: recordings of real cameras, and the simulator as the base.

The controllers have the parameters that the launch files give them, the joystick is the test's.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import functools
from pathlib import Path
import threading
import time
from typing import Any, NamedTuple

from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import Twist, TwistStamped
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Joy
from spikelane_msgs.msg import LaneState

from spikelane.bag.drive import RecordedDrive
from spikelane_sim.nodes import conversions

pytestmark = pytest.mark.ros

ROOT = Path(__file__).parents[3]
CONFIG = ROOT / 'ros2_ws/src/spikelane/config'
SMALL = ROOT / 'tests/data/cameras/plain.mcap'
CAMERAS = ROOT.parent / 'shared/data/real_cameras'
if not CAMERAS.is_dir():
    CAMERAS = Path('/work/shared/data/real_cameras')
BEST_EFFORT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


class Robot(NamedTuple):
    """A robot of the launch files: its file, what its base hears, and its limits."""

    file: str
    kind: type
    button: int
    max_linear_m_s: float


ROBOTS = {
    'turtlebot4': Robot('turtlebot4', TwistStamped, 7, 0.15),
    'p3dx': Robot('p3dx', Twist, 5, 0.3),
}


class Hand:
    """Holds a button of a joystick, 20 times a second."""

    def __init__(self, graph: Any, topic: str, button: int) -> None:
        self.is_holding = True
        self._button = button
        self._publisher = graph.node.create_publisher(Joy, topic, 10)
        self._is_gone = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._is_gone.wait(0.05):
            buttons = [0] * 12
            buttons[self._button] = int(self.is_holding)
            self._publisher.publish(Joy(buttons=buttons))

    def leave(self) -> None:
        """Let go of the joystick."""
        self._is_gone.set()
        self._thread.join()


@contextlib.contextmanager
def hand(graph: Any, topic: str, button: int) -> Iterator[Hand]:
    """Give a hand at the joystick."""
    hand = Hand(graph, topic, button)
    try:
        yield hand
    finally:
        hand.leave()


def twist_of(message: Any) -> Twist:
    """Return the twist of a Twist or a TwistStamped."""
    return getattr(message, 'twist', message)


def start_controller(graph: Any, robot: Robot, *names: str) -> Any:
    """Start R-STDP with the shipped weights and the robot's file."""
    file = ('--params-file', str(CONFIG / f'{robot.file}.yaml'))
    node = graph.start('rstdp', {'checkpoint': 'scenario_1'}, *file, *names)
    graph.until(lambda: 'ready: ' in node.log, 'the controller')
    return node


def play(publisher: Any, bag: Path) -> float:
    """Publish a recording at the pace of its stamps; return when the last packet was."""
    first_ns, since_s, last_s = None, time.monotonic(), 0.0
    message = EventPacket()
    for recorded in RecordedDrive(bag).packets():
        first_ns = recorded.packet.stamp_ns if first_ns is None else first_ns
        due_s = since_s + (recorded.packet.stamp_ns - first_ns) / 1e9
        time.sleep(max(0.0, due_s - time.monotonic()))
        conversions.fill_received_packet(message, recorded.packet)
        publisher.publish(message)
        last_s = time.monotonic()
    return last_s


@pytest.mark.parametrize(
    ('name', 'recording'),
    [
        ('turtlebot4', SMALL),
        ('turtlebot4', CAMERAS / 'test_data_evt3_trigger'),
        ('p3dx', CAMERAS / 'test_data_libcaer_rollover'),
    ],
    ids=['small', 'Prophesee', 'iniVation'],
)
def test_recordings_of_real_cameras_drive_the_base_within_its_limits(
    graph: Any, name: str, recording: Path
) -> None:
    """Published best-effort, as the drivers do; the base stands before and after.

    How soon it stands is measured in test_base.py: here a busy machine may lag behind the camera.
    """
    if not recording.exists():
        pytest.skip(f'no recordings of cameras at {CAMERAS}')
    robot, space = ROBOTS[name], f'/{name}_{recording.stem}'
    heard: list[tuple[float, Twist]] = []
    graph.node.create_subscription(
        robot.kind,
        f'{space}/cmd_vel',
        lambda each: heard.append((time.monotonic(), twist_of(each))),
        100,
    )
    publisher = graph.node.create_publisher(
        EventPacket, f'{space}/event_camera/events', BEST_EFFORT
    )
    show = functools.partial(play, publisher, recording)
    node = start_controller(graph, robot, '-r', f'__ns:={space}')
    graph.until(publisher.get_subscription_count, 'the subscription')
    with hand(graph, f'{space}/joy', robot.button):
        since_s = time.monotonic()
        graph.until(lambda: time.monotonic() - since_s > 1.5)
        assert heard == []
        # The first packets may find kernels uncompiled: the robot stands meanwhile.
        for _ in range(3):
            ends_s: list[float] = []
            player = threading.Thread(target=lambda ends_s=ends_s: ends_s.append(show()))
            player.start()
            graph.until(lambda ends_s=ends_s: ends_s, 'the end of the recording')
            player.join()
            since_s = time.monotonic()
            graph.until(lambda since_s=since_s: time.monotonic() - since_s > 2.0)
            if heard and heard[-1][0] > ends_s[0] - 1.0:
                break
        graph.until(lambda: heard and heard[-1][1].linear.x == 0.0, 'a stop')
    forward = [twist.linear.x for _, twist in heard]
    assert max(forward) > 0.03
    assert min(forward) >= 0.0
    assert max(forward) <= robot.max_linear_m_s
    assert max(abs(twist.angular.z) for _, twist in heard) <= 1.0
    stopped_s = next(at_s for at_s, twist in heard if at_s > ends_s[0] and not twist.linear.x)
    print(f'{recording.stem}: {len(heard)} commands, stopped {stopped_s - ends_s[0]:.3f} s after')
    assert 'Traceback' not in node.log
    node.kill()


@pytest.mark.parametrize('name', ROBOTS)
def test_the_simulator_stands_in_for_the_base(graph: Any, name: str) -> None:
    """Its camera and its cmd_vel have other names; it stands when the button is released."""
    robot, space = ROBOTS[name], f'/base_{name}'
    lanes: list[LaneState] = []
    graph.node.create_subscription(LaneState, f'{space}/lane/state', lanes.append, 1000)
    simulation = {
        'mode': 'realtime',
        'real_time_factor': 2.0,
        'robot.model': name,
        'use_stamped_vel': robot.kind is TwistStamped,
    }
    events = f'event_camera/events:={space}/my_camera/events'
    velocity = f'cmd_vel:={space}/my_base/cmd_vel'
    graph.start('simulator', simulation, '-r', f'__ns:={space}', '-r', events, '-r', velocity)
    controller = f'{space}/controller'
    start_controller(graph, robot, '-r', f'__ns:={controller}', '-r', events, '-r', velocity)
    graph.until(lambda: lanes, 'the robot')
    with hand(graph, f'{controller}/joy', robot.button) as joystick:
        graph.until(lambda: lanes[-1].progress > 0.5, 'half a metre')
        joystick.is_holding = False
        since_s = time.monotonic()
        graph.until(lambda: time.monotonic() - since_s > 1.5)
        before = lanes[-1].progress
        graph.until(lambda: time.monotonic() - since_s > 2.5)
        assert abs(lanes[-1].progress - before) < 1e-3
        joystick.is_holding = True
        graph.until(lambda: lanes[-1].progress > before + 0.1, 'a robot that drives again')
    assert max(abs(each.distance) for each in lanes) < 0.1
    assert {each.episode for each in lanes} == {1}
