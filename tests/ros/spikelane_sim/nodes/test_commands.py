"""Who commands the robot: several publishers are named, and invalid commands are refused."""

from collections.abc import Callable, Iterator
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import Twist, TwistStamped
import pytest
from rclpy.node import Node
from spikelane_msgs.msg import LaneState, WheelVelocities
from std_msgs.msg import Float64MultiArray

from spikelane_sim.messages import to_stamp_ns

pytestmark = pytest.mark.ros

#: A drive that goes on for long enough.
ENDLESS = {'robot.model': 'kinematic', 'episode.max_laps': 0, 'episode.max_distance_m': 0.0}


class Watched:
    """A simulator in a namespace of its own, and its diagnostics."""

    def __init__(self, graph: Any, namespace: str, **parameters: Any) -> None:
        self.graph = graph
        self.namespace = namespace
        self.process = graph.start(
            'simulator',
            ENDLESS | parameters,
            *('-r', f'__ns:={namespace}', '-r', f'/diagnostics:={namespace}/diagnostics'),
        )
        self.diagnostics: list[DiagnosticStatus] = []
        graph.node.create_subscription(
            DiagnosticArray,
            f'{namespace}/diagnostics',
            lambda message: self.diagnostics.append(message.status[0]),
            10,
        )

    def start(self, name: str) -> Any:
        """Start a Braitenberg controller under a name."""
        names = ('-r', f'__ns:={self.namespace}', '-r', f'__node:={name}')
        return self.graph.start('braitenberg', {}, *names)

    @property
    def values(self) -> dict[str, str]:
        """Return the values of the last diagnostics."""
        if not self.diagnostics:
            return {}
        return {pair.key: pair.value for pair in self.diagnostics[-1].values}

    @property
    def warnings(self) -> list[str]:
        """The lines of the log that name several publishers."""
        named = 'commands: expected one publisher'
        return [line for line in self.process.log.splitlines() if named in line]


def test_two_controllers_in_lockstep_are_named(graph) -> None:
    """In the log, once a second at most, and in the diagnostics, until one of them leaves."""
    simulator = Watched(graph, '/both')
    first = simulator.start('first')
    second = simulator.start('second')
    publishers = '/both/first on /both/wheel_velocities, /both/second on /both/wheel_velocities'
    graph.until(lambda: simulator.values.get('commands_mixed_from') == publishers, 'both names')
    assert simulator.diagnostics[-1].level == DiagnosticStatus.WARN
    warning = graph.until(lambda: simulator.warnings, 'the warning')[-1]
    assert f'commands: expected one publisher, got 2: {publishers};' in warning
    assert warning.endswith(' commands were ignored')
    ignored = int(simulator.values['commands_ignored'])
    before, since_s = len(simulator.warnings), time.monotonic()
    graph.until(lambda: time.monotonic() - since_s > 3.0)
    assert 1 <= len(simulator.warnings) - before <= 4
    assert int(simulator.values['commands_ignored']) > ignored
    assert second.stop() == 130  # in the middle of a drive
    graph.until(lambda: simulator.values['commands_mixed_from'] == '', 'a single publisher')
    graph.until(lambda: simulator.diagnostics[-1].level == DiagnosticStatus.OK)
    assert first.stop() == 130
    assert simulator.process.stop() in (0, 130)  # after the drive, or not


def test_two_controllers_of_one_name_are_told_apart(graph) -> None:
    """They are counted."""
    simulator = Watched(graph, '/same')
    nodes = [simulator.start('braitenberg') for _ in range(2)]
    graph.until(lambda: simulator.warnings, 'the warning')
    named = 'got 2: /same/braitenberg on /same/wheel_velocities (2 publishers); '
    assert named in simulator.warnings[0]
    assert [node.stop() for node in nodes] == [130, 130]
    assert simulator.process.stop() in (0, 130)


@pytest.fixture(scope='module')
def realtime(graph) -> Iterator[Watched]:
    """Give a simulator in real time."""
    simulator = Watched(graph, '/clocked', mode='realtime', use_stamped_vel='true')
    yield simulator
    assert simulator.process.stop() == 0


def publish_both(realtime: Watched, commands: dict[str, Any], until: Callable[[], Any]) -> None:
    """Let nodes publish a command each on a topic, again and again until something is so."""
    graph = realtime.graph
    nodes = [
        Node(name, context=graph.node.context, namespace='/clocked') for name in ('left', 'right')
    ]
    publishers = [
        (node.create_publisher(type(message), topic, 10), message)
        for node, (topic, message) in zip(nodes, commands.items(), strict=True)
    ]

    def is_over() -> bool:
        for publisher, message in publishers:
            publisher.publish(message)
        return bool(until())

    graph.until(is_over, 'what commands are published for')
    for node in nodes:
        node.destroy_node()


@pytest.mark.parametrize(
    ('commands', 'publishers'),
    [
        (
            {'wheel_velocities': WheelVelocities(), 'cmd_vel': TwistStamped()},
            '/clocked/left on /clocked/wheel_velocities, /clocked/right on /clocked/cmd_vel',
        ),
        (
            {
                'wheel_velocity_controller/commands': Float64MultiArray(data=[0.0, 0.0]),
                'cmd_vel': TwistStamped(),
            },
            '/clocked/left on /clocked/wheel_velocity_controller/commands, '
            '/clocked/right on /clocked/cmd_vel',
        ),
    ],
)
def test_two_sources_in_real_time_are_named(
    realtime: Watched, commands: dict[str, Any], publishers: str
) -> None:
    """On any two of the three topics."""
    names = publishers.split(', ')

    def warnings() -> list[str]:
        return [line for line in realtime.warnings if all(name in line for name in names)]

    def mixed() -> list[str]:
        status = [{pair.key: pair.value for pair in each.values} for each in realtime.diagnostics]
        return [each['commands_mixed_from'] for each in status]

    publish_both(
        realtime,
        commands,
        lambda: warnings() and any(all(name in each for name in names) for each in mixed()),
    )
    assert 'commands: expected one publisher, got 2: ' in warnings()[0]
    assert warnings()[0].endswith('; each command replaces the one before')


def test_a_twist_with_a_stamp_that_is_not_normalised_is_refused(realtime: Watched) -> None:
    """It is counted and told, and drives nothing."""
    message = TwistStamped(twist=Twist())
    message.twist.linear.x = 0.1
    message.header.stamp.nanosec = 2_000_000_000
    publisher = realtime.graph.node.create_publisher(TwistStamped, '/clocked/cmd_vel', 10)
    realtime.graph.until(publisher.get_subscription_count)
    before = int(realtime.values['commands_refused'])
    publisher.publish(message)
    realtime.graph.until(lambda: int(realtime.values['commands_refused']) == before + 1)
    expected = 'cmd_vel: stamp: expected nanosec below 1000000000, got 2000000000; refused'
    assert expected in realtime.process.log
    assert realtime.values['progress_m'] == '0.0'
    realtime.graph.node.destroy_publisher(publisher)


def test_an_answer_with_a_stamp_that_is_not_normalised_is_refused(graph) -> None:
    """Even where it names the right time: 0 s and 1,050,000,000 ns for 1.05 s."""
    simulator = Watched(graph, '/stamps')
    packets: list[EventPacket] = []
    graph.node.create_subscription(EventPacket, '/stamps/event_camera/events', packets.append, 100)
    publisher = graph.node.create_publisher(WheelVelocities, '/stamps/wheel_velocities', 10)
    graph.until(lambda: packets and publisher.get_subscription_count())

    def answer(seconds: int, nanoseconds: int) -> None:
        message = WheelVelocities(left=1.0, right=1.0)
        message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds
        publisher.publish(message)

    while (stamp_ns := to_stamp_ns(packets[-1].header.stamp)) < 1_050_000_000:
        answer(*divmod(stamp_ns, 10**9))
        graph.until(lambda seen=stamp_ns: to_stamp_ns(packets[-1].header.stamp) > seen)
    answer(0, 1_050_000_000)
    graph.until(lambda: simulator.values.get('commands_refused') == '1')
    assert (
        '/stamps/wheel_velocities: stamp: expected nanosec below 1000000000, got 1050000000'
        in simulator.process.log
    )
    assert to_stamp_ns(packets[-1].header.stamp) == 1_050_000_000
    answer(1, 50_000_000)
    graph.until(lambda: to_stamp_ns(packets[-1].header.stamp) == 1_100_000_000)
    assert simulator.process.stop() == 130


def test_a_controller_refuses_what_is_not_valid(graph) -> None:
    """Stamps that are not normalised, and lane states that are not finite; it answers the next."""
    process = graph.start('braitenberg', {}, '-r', '__ns:=/fussy')
    node = graph.node
    events = node.create_publisher(EventPacket, '/fussy/event_camera/events', 10)
    lanes = node.create_publisher(LaneState, '/fussy/lane/state', 10)
    answers: list[WheelVelocities] = []
    node.create_subscription(WheelVelocities, '/fussy/wheel_velocities', answers.append, 10)
    graph.until(lambda: events.get_subscription_count() and lanes.get_subscription_count())
    packet = EventPacket(width=128, height=128, encoding='mono')

    def show(seconds: int, nanoseconds: int, **fields: float) -> None:
        lane = LaneState(lane='outer', episode=1, **fields)
        for message, publisher in ((lane, lanes), (packet, events)):
            message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds
            publisher.publish(message)

    show(0, 4_000_000_000)
    graph.until(lambda: 'expected nanosec below 1000000000, got 4000000000' in process.log)
    for field in ('distance', 'heading_error', 'position', 'progress'):
        time.sleep(1.1)  # the log names one a second
        show(2, 0, **{field: float('nan')})
        packet.seq += 1
        graph.until(lambda: process.log.count('/fussy/event_camera/events: lane state: ') > 0)
    assert answers == []
    show(3, 0)
    graph.until(lambda: answers, 'an answer')
    assert to_stamp_ns(answers[-1].header.stamp) == 3_000_000_000
    assert process.stop() == 0
