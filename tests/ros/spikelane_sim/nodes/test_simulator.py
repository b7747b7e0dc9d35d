"""Node `simulator`: what it publishes, when it steps, and what it makes of its parameters."""

import math
from pathlib import Path
import random
import signal
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import Twist, TwistStamped, Vector3
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter as ClientParameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from simulation_interfaces.msg import Result, SimulationState
from simulation_interfaces.srv import GetSimulationState, ResetSimulation, SetSimulationState
from spikelane_msgs.msg import LaneState, WheelVelocities
from spikelane_msgs.srv import Reset
from std_msgs.msg import Float64, Float64MultiArray, String
from tf2_msgs.msg import TFMessage
import yaml

from spikelane_sim.contract import Observation
from spikelane_sim.contract import WheelVelocities as Wheels
from spikelane_sim.frame_names import WHEEL_JOINTS
from spikelane_sim.messages import to_stamp_ns
from spikelane_sim.nodes.conversions import events_from_packet
from spikelane_sim.nodes.simulator import SimulatorNodeParameters
from spikelane_sim.robots.differential_drive import read_geometry
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

pytestmark = pytest.mark.ros

STEP_NS = 50_000_000
CONFIG = Path(__file__).parents[4] / 'sim_bridge' / 'config'
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SEED = 7

#: What is published after every step; the packets last, as they complete it.
STEP_TOPICS = {
    '/clock': Clock,
    '/tf': TFMessage,
    'ground_truth/odom': Odometry,
    'joint_states': JointState,
    'lane/distance': Float64,
    'event_camera/camera_info': CameraInfo,
    'event_camera/image_raw': Image,
    'lane/state': LaneState,
    'event_camera/events': EventPacket,
}
LATCHED_TOPICS = {'/tf_static': TFMessage, 'robot_description': String}


class Driver:
    """Sees what a simulator publishes, and answers in the place of a controller."""

    def __init__(self, graph: Any, process: Any, namespace: str = '') -> None:
        self.process = process
        self.graph = graph
        self._namespace = namespace
        self.seen: dict[str, list[Any]] = {}
        self.status: dict[str, str] = {}
        self.levels: list[bytes] = []
        self.handled = 0
        node = graph.node
        topics_of_steps = {k: v for k, v in STEP_TOPICS.items() if k != 'event_camera/events'}
        for topics, qos in ((LATCHED_TOPICS, LATCHED), (topics_of_steps, 100)):
            for name, kind in topics.items():
                self.seen[name] = []
                node.create_subscription(kind, self.name(name), self.seen[name].append, qos)
        self.seen['event_camera/events'] = []
        packets = self.name('event_camera/events')
        node.create_subscription(EventPacket, packets, self._on_packet, 100)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self.wheels = node.create_publisher(WheelVelocities, self.name('wheel_velocities'), 10)

    def name(self, topic: str) -> str:
        """Return a topic's or service's name in the simulator's namespace."""
        return topic if topic.startswith('/') else f'{self._namespace}/{topic}'

    def _on_packet(self, message: EventPacket) -> None:
        # One that waits is sent again to whoever joins.
        if not self.packets or self.packets[-1].seq != message.seq:
            self.packets.append(message)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.diagnostics = message.status[0]
        self.levels.append(self.diagnostics.level)
        self.status = {pair.key: pair.value for pair in self.diagnostics.values}

    def begin(self, lane: str = '', seed: int = SEED) -> EventPacket:
        """Begin an episode; return its first packet."""
        answer = self.reset(lane, seed)
        assert answer.success, answer.message
        stamp_ns = to_stamp_ns(answer.stamp)
        self.graph.until(lambda: self.packets_at(stamp_ns), 'the first packet')
        self.handled = len(self.packets)
        return self.packets[-1]

    def reset(self, lane: str = '', seed: int = SEED) -> Reset.Response:
        """Ask for an episode."""
        return self.graph.call(Reset, self.name('simulator/reset'), lane=lane, seed=seed)

    @property
    def packets(self) -> list[EventPacket]:
        """All packets so far."""
        return self.seen['event_camera/events']

    def packets_at(self, stamp_ns: int) -> list[EventPacket]:
        """Return the packets with a stamp."""
        return [packet for packet in self.packets if stamp_of(packet) == stamp_ns]

    def next_packet(self) -> EventPacket:
        """Wait for the next packet."""
        self.graph.until(lambda: len(self.packets) > self.handled, 'a packet')
        self.handled += 1
        return self.packets[self.handled - 1]

    def say(self, stamp_ns: int, left: float, right: float) -> None:
        """Publish wheel velocities."""
        message = WheelVelocities(left=left, right=right)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        self.wheels.publish(message)

    def answer(self, packet: EventPacket, left: float, right: float) -> EventPacket:
        """Answer an observation and return the next one."""
        self.say(stamp_of(packet), left, right)
        return self.next_packet()

    def last(self, topic: str, stamp_ns: int) -> Any:
        """Wait for a topic's message of a step."""
        messages = self.seen[topic]
        self.graph.until(lambda: messages and stamp_of(messages[-1]) == stamp_ns, topic)
        return messages[-1]

    def wait_for_status(self, **expected: str) -> None:
        """Wait until the diagnostics say so."""
        self.graph.until(lambda: expected.items() <= self.status.items(), f'{expected}')


def stamp_of(message: Any) -> int:
    """Return the stamp of any of the simulator's messages [ns]."""
    if isinstance(message, Clock):
        return to_stamp_ns(message.clock)
    if isinstance(message, TFMessage):
        return to_stamp_ns(message.transforms[0].header.stamp)
    return to_stamp_ns(message.header.stamp)


@pytest.fixture(scope='module')
def driver(graph) -> Driver:
    """Drive a simulator of scenario 3 in lockstep, its first observation waiting already."""
    file = str(CONFIG / 'scenario_3.yaml')
    parameters = {'robot.model': 'kinematic', 'seed': SEED}
    process = graph.start('simulator', parameters, '--params-file', file)
    driver = Driver(graph, process)
    graph.until(lambda: all(driver.seen.values()), 'all topics')
    graph.until(driver.wheels.get_subscription_count)
    driver.first = driver.packets[0]
    return driver


def test_who_joins_late_is_given_the_observation_that_waits(driver: Driver) -> None:
    """The first one has the stamp of one step, since 0 means that there is no time yet."""
    assert stamp_of(driver.first) == STEP_NS
    assert driver.first.seq == 0
    assert stamp_of(driver.seen['/clock'][0]) == STEP_NS
    assert driver.seen['lane/state'][0].step == 0
    assert driver.seen['lane/state'][0].episode == 1


def test_the_parameter_file_says_what_is_simulated(driver: Driver) -> None:
    """The command line says the seed."""
    assert 'lockstep, course scenario_3, seed 7' in driver.process.log


def test_while_nobody_answers_it_says_what_it_waits_for(driver: Driver) -> None:
    """In the log after 5 s, and in the diagnostics."""
    expected = 'waiting for wheel_velocities with stamp 50000000 ns; 1 publishers are there'
    driver.graph.until(lambda: expected in driver.process.log, 'the warning')
    driver.graph.until(lambda: driver.status)
    assert driver.diagnostics.level == b'\x01'
    assert driver.diagnostics.message == 'playing'


def test_a_drive_that_goes_on_is_nothing_to_warn_of(driver: Driver) -> None:
    """Most of the time an answer is awaited; only one that was already awaited before is told."""
    packet = driver.begin()
    driver.levels.clear()
    while len(driver.levels) < 3:
        packet = driver.answer(packet, 0.0, 0.0)
    assert driver.levels == [b'\x00'] * 3
    driver.graph.until(lambda: len(driver.levels) >= 5)
    assert driver.levels[4] == b'\x01'


def test_only_the_topic_that_a_late_subscriber_misses_is_sent_again(driver: Driver) -> None:
    """The other topics of the observation that waits are not sent again."""
    packet = driver.begin()
    stamp_ns = stamp_of(packet)
    counts = {name: len(driver.seen[name]) for name in ('/tf', 'event_camera/camera_info')}
    late: list[LaneState] = []
    node = driver.graph.node
    subscription = node.create_subscription(LaneState, 'lane/state', late.append, 10)
    driver.graph.until(lambda: late, 'the lane state of the observation that waits')
    node.destroy_subscription(subscription)
    driver.answer(packet, 0.0, 0.0)  # what was sent before it has come by then
    assert stamp_of(late[0]) == stamp_ns
    for name, count in counts.items():
        stamps_ns = [stamp_of(each) for each in driver.seen[name][count:]]
        assert set(stamps_ns) <= {stamp_ns + STEP_NS}


def test_all_messages_of_a_step_have_its_stamp(driver: Driver) -> None:
    """One each, nothing missing, numbered on."""
    packet = driver.begin()
    for messages in driver.seen.values():
        messages.clear()
    driver.handled = 0
    first = packet.seq
    stamps_ns = [stamp_of(packet) + n * STEP_NS for n in range(1, 6)]
    for _ in stamps_ns:
        packet = driver.answer(packet, 1.5, 1.0)
    stamped = {name: driver.seen[name] for name in STEP_TOPICS}
    driver.graph.until(lambda: all(len(messages) >= 5 for messages in stamped.values()))
    distances = stamped.pop('lane/distance')
    for messages in stamped.values():
        assert [stamp_of(each) for each in messages] == stamps_ns
    assert [each.data for each in distances] == [each.distance for each in stamped['lane/state']]
    assert [each.seq for each in driver.packets] == [first + n for n in range(1, 6)]
    assert [each.step for each in stamped['lane/state']] == [1, 2, 3, 4, 5]
    assert not any(driver.seen[name] for name in LATCHED_TOPICS)


def test_frames_are_those_of_rep_105(driver: Driver) -> None:
    """odom, base_link, and the camera's optical frame; the tree of transforms is connected."""
    driver.answer(driver.begin(), 1.0, 1.0)
    stamp_ns = stamp_of(driver.packets[-1])
    last = {name: driver.last(name, stamp_ns) for name in STEP_TOPICS if name != 'lane/distance'}
    assert last['ground_truth/odom'].header.frame_id == 'odom'
    assert last['ground_truth/odom'].child_frame_id == 'base_link'
    assert last['lane/state'].header.frame_id == 'odom'
    for name in ('event_camera/events', 'event_camera/camera_info', 'event_camera/image_raw'):
        assert last[name].header.frame_id == 'event_camera_optical_frame'
    transform = last['/tf'].transforms[0]
    assert (transform.header.frame_id, transform.child_frame_id) == ('odom', 'base_link')
    assert last['joint_states'].name == ['left_wheel_joint', 'right_wheel_joint']


def test_latched_topics_describe_the_robot(graph, driver: Driver) -> None:
    """Whoever joins later gets them as well: the camera's place, and the URDF with its joints."""
    kept: list[Any] = []
    for name, kind in LATCHED_TOPICS.items():
        graph.node.create_subscription(kind, name, kept.append, LATCHED)
    graph.until(lambda: len(kept) == 2)
    transforms = next(message for message in kept if isinstance(message, TFMessage)).transforms
    description = next(message for message in kept if isinstance(message, String)).data
    frames = [(each.header.frame_id, each.child_frame_id) for each in transforms]
    assert frames == [('base_link', 'event_camera_optical_frame')]
    assert '<robot' in description
    assert 'left_wheel_joint' in description
    assert 'event_camera_optical_frame' in description


def commands(count: int) -> list[Wheels]:
    """Return commands that sway a little."""
    chance = random.Random(3)
    return [Wheels(chance.uniform(1, 4), chance.uniform(1, 4)) for _ in range(count)]


def simulate(parameters: dict[str, Any], lane: str | None, count: int) -> list[Observation]:
    """Return the observations of the same simulation in this process."""
    with Simulator(SimulatorParameters.from_mapping(parameters)) as simulator:
        observations = [simulator.reset(lane, SEED)]
        return observations + [simulator.step(wheels) for wheels in commands(count)]


def drive(driver: Driver, packet: EventPacket, count: int) -> list[EventPacket]:
    """Return the packets of the same simulation over ROS."""
    packets = [packet]
    for wheels in commands(count):
        packets.append(driver.answer(packets[-1], *wheels))
    return packets


def assert_equal_events(packets: list[EventPacket], observations: list[Observation]) -> None:
    """Check that both saw the same, times relative to the beginning."""
    began_ns = stamp_of(packets[0]) - observations[0].stamp_ns
    assert sum(len(observation.events) for observation in observations) > 100
    for packet, observation in zip(packets, observations, strict=True):
        assert stamp_of(packet) == observation.stamp_ns + began_ns
        events = events_from_packet(packet)
        events['t'] -= began_ns
        assert np.array_equal(events, observation.events)


def test_the_same_seed_and_commands_give_the_same_events_as_in_process(driver: Driver) -> None:
    """Bit for bit, decoded from evt3; so are pose and lane."""
    packets = drive(driver, driver.begin('inner'), 40)
    observations = simulate({'robot.model': 'kinematic', 'course': 'scenario_3'}, 'inner', 40)
    assert packets[0].encoding == 'evt3'
    assert_equal_events(packets, observations)
    lane = driver.last('lane/state', stamp_of(packets[-1]))
    assert (lane.lane, lane.step) == ('inner', 40)
    assert lane.distance == observations[-1].lane.distance_m
    assert lane.progress == observations[-1].lane.progress_m


def test_a_packet_begins_with_both_time_words(driver: Driver) -> None:
    """Also one without events, so that each can be read by itself."""
    first = driver.begin()
    for packet in (first, driver.answer(first, 2.0, 2.0)):
        high, low = np.frombuffer(packet.events, '<u2')[:2].tolist()
        assert (high >> 12, low >> 12) == (0x8, 0x6)
        assert (packet.width, packet.height, packet.is_bigendian) == (128, 128, False)
        assert packet.time_base == stamp_of(packet) - STEP_NS
    # The empty packet has nothing but the time: each TIME_HIGH word, of 4,096 us, from the begin
    # of the step to its stamp, and a TIME_LOW word behind the first and the last.
    words = np.frombuffer(first.events, '<u2')
    start_us, stamp_us = (each // 1000 for each in (first.time_base, stamp_of(first)))
    highs = [word & 0xFFF for word in words.tolist() if word >> 12 == 0x8]
    assert highs == [each & 0xFFF for each in range(start_us >> 12, (stamp_us >> 12) + 1)]
    assert len(words) == len(highs) + 2


def test_only_the_answer_with_the_right_stamp_makes_a_step(driver: Driver) -> None:
    """Others are counted and change nothing; nor does a second answer."""
    packet = driver.begin()
    before = int(driver.status['commands_ignored'])
    stamp_ns = stamp_of(packet)
    for wrong_ns in (0, stamp_ns - STEP_NS, stamp_ns + STEP_NS):
        driver.say(wrong_ns, 9.0, 9.0)
    driver.wait_for_status(commands_ignored=str(before + 3), step='0')
    assert len(driver.packets) == driver.handled
    following = driver.answer(packet, 1.0, 2.0)
    driver.say(stamp_ns, 9.0, 9.0)
    driver.wait_for_status(commands_ignored=str(before + 4), step='1')
    assert stamp_of(following) == stamp_ns + STEP_NS
    assert list(driver.last('joint_states', stamp_of(following)).velocity) == [1.0, 2.0]


@pytest.mark.parametrize('velocity', [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_stops_the_wheels_for_that_step(
    driver: Driver, velocity: float
) -> None:
    """It is counted and reported, and the next command drives on."""
    packet = driver.answer(driver.begin(), 1.0, 1.0)
    before = driver.last('ground_truth/odom', stamp_of(packet)).pose.pose
    driver.wait_for_status(step='1')
    count = int(driver.status['commands_not_finite'])
    packet = driver.answer(packet, velocity, 1.0)
    assert driver.last('ground_truth/odom', stamp_of(packet)).pose.pose == before
    assert list(driver.last('joint_states', stamp_of(packet)).velocity) == [0.0, 0.0]
    driver.wait_for_status(commands_not_finite=str(count + 1))
    assert 'expected finite rad/s; the wheels stop for this step' in driver.process.log
    packet = driver.answer(packet, 1.0, 1.0)
    assert list(driver.last('joint_states', stamp_of(packet)).velocity) == [1.0, 1.0]


def test_a_command_beyond_the_robots_limit_is_clipped(driver: Driver) -> None:
    """Each wheel by itself; counted and reported."""
    packet = driver.begin()
    driver.wait_for_status(step='0')
    count = int(driver.status['commands_clipped'])
    packet = driver.answer(packet, 1.0, -100.0)
    assert list(driver.last('joint_states', stamp_of(packet)).velocity) == [1.0, -12.3]
    driver.wait_for_status(commands_clipped=str(count + 1))
    assert 'expected at most 12.3 rad/s; clipped' in driver.process.log


def test_reset_begins_the_lane_and_seed_asked_for(driver: Driver) -> None:
    """Episodes count within a seed; an empty lane takes the next in turn; time goes on."""
    first = driver.reset('inner', 11)
    assert (first.success, first.message) == (True, '')
    assert (first.lane, first.seed, first.episode) == ('inner', 11, 1)
    second = driver.reset('', -1)
    assert (second.lane, second.seed, second.episode) == ('outer', 11, 2)
    assert to_stamp_ns(second.stamp) == to_stamp_ns(first.stamp) + STEP_NS
    stamp_ns = to_stamp_ns(second.stamp)
    lane = driver.last('lane/state', stamp_ns)
    assert (lane.lane, lane.episode, lane.step, lane.progress) == ('outer', 2, 0, 0.0)
    pose = driver.last('ground_truth/odom', stamp_ns).pose.pose.position
    assert (pose.x, pose.y) == pytest.approx((3.0, 0.25))


def test_a_reset_to_an_unknown_lane_is_refused(driver: Driver) -> None:
    """The answer says which there are, and the episode goes on."""
    packet = driver.begin()
    answer = driver.reset('middle')
    assert answer.success is False
    assert 'outer' in answer.message
    assert 'middle' in answer.message
    assert stamp_of(driver.answer(packet, 1.0, 1.0)) == stamp_of(packet) + STEP_NS


def test_a_reset_to_an_episode_without_a_seed_is_refused(driver: Driver) -> None:
    """Episodes are counted from a seed on; the episode that runs goes on."""
    packet = driver.begin()
    answer = driver.graph.call(Reset, driver.name('simulator/reset'), seed=-1, episode=4)
    assert answer.success is False
    assert answer.message == 'episode: expected 0 without a seed, got 4 with seed -1'
    assert stamp_of(driver.answer(packet, 1.0, 1.0)) == stamp_of(packet) + STEP_NS


def test_the_episode_ends_where_the_lane_is_left(driver: Driver) -> None:
    """Reported at once; then nothing steps until the reset."""
    packet = driver.begin()
    while not (lane := driver.last('lane/state', stamp_of(packet))).terminated:
        packet = driver.answer(packet, 12.0, -12.0 if lane.step < 3 else 12.0)
    assert lane.reason == 'lane_lost'
    assert abs(lane.distance) > 0.5
    driver.wait_for_status(terminated='True', reason='lane_lost', step=str(lane.step))
    ignored = driver.status['commands_ignored']
    driver.say(stamp_of(packet), 1.0, 1.0)
    driver.wait_for_status(answered='True')
    assert driver.begin().seq == packet.seq + 1
    driver.wait_for_status(terminated='False', commands_ignored=ignored)


def test_every_parameter_is_described(driver: Driver) -> None:
    """Meaning, unit, what is allowed, the range, and whether it is fixed."""
    specs = {
        spec.name: spec
        for parameters in (SimulatorNodeParameters, SimulatorParameters)
        for spec in parameters.specs()
    }
    listed = driver.graph.call(ListParameters, 'simulator/list_parameters').result.names
    assert specs.keys() <= set(listed)
    names = list(specs)
    described = driver.graph.call(
        DescribeParameters, 'simulator/describe_parameters', names=names
    ).descriptors
    for each in described:
        assert specs[each.name].description in each.description
        assert each.additional_constraints == specs[each.name].allowed
    by_name = {each.name: each for each in described}
    changeable = {each.name for each in described if not each.read_only}
    assert changeable == {
        'real_time_factor',
        'link.event_loss',
        'link.latency_ms',
        'pixels.coppelia.noise_rate_hz',
        'pixels.esim.hot_rate_hz',
        'pixels.esim.hot_share',
        'pixels.esim.leak_rate_hz',
        'pixels.esim.shot_bright_factor',
        'pixels.esim.shot_rate_hz',
        'pixels.esim.threshold_spread',
    }
    assert by_name['link.latency_ms'].description == (
        'Latency added between an observation and its command; a multiple of the control period. '
        '[ms] Can be changed while the node runs: from the next step on.'
    )
    factor = by_name['real_time_factor'].floating_point_range[0]
    assert (factor.from_value, factor.to_value) == (0.01, 1000.0)
    width = by_name['camera.width'].integer_range[0]
    assert (width.from_value, width.to_value) == (1, 2048)
    assert '[m]' in by_name['episode.max_distance_m'].description


def set_parameters(driver: Driver, **values: Any) -> list[tuple[bool, str]]:
    """Set parameters one by one; return whether that was done, and the reasons."""
    request = [
        ClientParameter(name, value=each).to_parameter_msg() for name, each in values.items()
    ]
    answer = driver.graph.call(
        SetParameters, driver.name('simulator/set_parameters'), parameters=request
    )
    return [(each.successful, each.reason) for each in answer.results]


@pytest.mark.parametrize(
    ('name', 'value', 'reason'),
    [
        ('seed', 9, 'seed: fixed since the start; only real_time_factor, '),
        ('camera.width', 64, 'camera.width: fixed since the start; only real_time_factor, '),
        ('no_such', 1, 'no_such: expected a parameter of /simulator'),
        ('link.event_loss', 2.0, 'link.event_loss: expected a number from 0 to 1, got 2.0'),
        ('link.event_loss', 'x', "link.event_loss: expected a number from 0 to 1, got 'x'"),
        ('link.latency_ms', 30, 'link.latency_ms: expected a multiple of 50 ms, the control '),
        ('link.latency_ms', None, 'link.latency_ms: expected a whole number from 0 to 60000 ms, '),
    ],
)
def test_a_parameter_that_cannot_be_set_says_why(
    driver: Driver, name: str, value: Any, reason: str
) -> None:
    """As at the start; nothing else is set with it, and the node goes on."""
    ((is_set, said),) = set_parameters(driver, **{name: value})
    assert not is_set
    assert said.startswith(reason), said
    both = {'link.event_loss': 0.5, name: value}
    request = [ClientParameter(key, value=each).to_parameter_msg() for key, each in both.items()]
    answer = driver.graph.call(
        SetParametersAtomically, 'simulator/set_parameters_atomically', parameters=request
    )
    assert not answer.result.successful
    assert answer.result.reason.startswith(reason), answer.result.reason
    got = driver.graph.call(GetParameters, 'simulator/get_parameters', names=['link.event_loss'])
    assert got.values[0].double_value == 0.0


def test_noise_and_loss_change_between_two_steps(driver: Driver) -> None:
    """The events are those of a simulator that changes there; the change is published."""
    published: list[ParameterEvent] = []
    topic = '/simulator/parameter_changes'
    subscription = driver.graph.node.create_subscription(
        ParameterEvent, topic, published.append, 10
    )
    driver.graph.until(lambda: driver.graph.node.count_publishers(topic))
    packets = [driver.begin('outer', seed=4)]
    for _ in range(4):
        packets.append(driver.answer(packets[-1], 3.0, 3.0))
    values = {'pixels.coppelia.noise_rate_hz': 5, 'link.event_loss': 0.25}
    assert set_parameters(driver, **values) == [
        (True, 'pixels.coppelia.noise_rate_hz from the next step on'),
        (True, 'link.event_loss from the next step on'),
    ]
    for _ in range(4):
        packets.append(driver.answer(packets[-1], 3.0, 3.0))
    parameters = {'course': 'scenario_3', 'robot.model': 'kinematic'}
    with Simulator(SimulatorParameters.from_mapping(parameters)) as simulator:
        expected = [simulator.reset('outer', 4)]
        for step in range(8):
            simulator.change(values if step == 4 else {})
            expected.append(simulator.step(Wheels(3.0, 3.0)))
    assert_equal_events(packets, expected)
    driver.graph.until(lambda: published)
    (change,) = published
    assert change.node == '/simulator'
    assert to_stamp_ns(change.stamp) == stamp_of(packets[5])
    assert [(each.name, each.value.double_value) for each in change.changed_parameters] == [
        ('pixels.coppelia.noise_rate_hz', 5.0),
        ('link.event_loss', 0.25),
    ]
    driver.graph.node.destroy_subscription(subscription)
    assert all(done for done, _ in set_parameters(driver, **dict.fromkeys(values, 0.0)))


@pytest.fixture(scope='module')
def mono(graph) -> Driver:
    """Drive a simulator with esim pixels and mono packets, in a namespace."""
    parameters = {
        'robot.model': 'kinematic',
        'robot.track_m': 0.4,
        'pixels.model': 'esim',
        'event_encoding': 'mono',
        'lane': 'inner',
        'seed': SEED,
    }
    driver = Driver(graph, graph.start('simulator', parameters, '-r', '__ns:=/mono'), '/mono')
    graph.until(lambda: driver.packets and driver.wheels.get_subscription_count())
    driver.next_packet()
    return driver


def test_mono_packets_carry_the_same_events(mono: Driver) -> None:
    """Those of a pixel model whose events lie within the step; the first lane is a parameter."""
    packets = drive(mono, mono.packets[0], 20)
    assert packets[0].encoding == 'mono'
    parameters = {'robot.model': 'kinematic', 'robot.track_m': 0.4, 'pixels.model': 'esim'}
    assert_equal_events(packets, simulate(parameters, 'inner', 20))


@pytest.mark.parametrize('scenario', [1, 2, 3])
def test_parameter_files_set_what_exists(scenario: int) -> None:
    """Every name in them is declared, every value allowed; all but the course are defaults."""
    file = yaml.safe_load((CONFIG / f'scenario_{scenario}.yaml').read_text())
    values = file['simulator']['ros__parameters']
    own = {spec.name for spec in SimulatorNodeParameters.specs()}
    node = SimulatorNodeParameters.from_mapping({k: v for k, v in values.items() if k in own})
    rest = {name: value for name, value in values.items() if name not in own}
    assert node == SimulatorNodeParameters()
    assert SimulatorParameters.from_mapping(rest) == SimulatorParameters(
        course=f'scenario_{scenario}'
    )


def test_the_description_has_the_size_of_the_robot(mono: Driver) -> None:
    """Its wheels are 0.4 m apart, as the parameters say, and not 0.331 m."""
    mono.graph.until(lambda: mono.seen['robot_description'])
    [description] = mono.seen['robot_description']
    assert read_geometry(description.data, *WHEEL_JOINTS) == pytest.approx((0.0975, 0.4))


@pytest.fixture(scope='module')
def realtime(graph) -> Driver:
    """Watch a simulator in real time, at twice the speed; 2 is a whole number on purpose."""
    parameters = {
        'robot.model': 'kinematic',
        'mode': 'realtime',
        'real_time_factor': 2,
        'episode.max_distance_m': 0,
    }
    driver = Driver(graph, graph.start('simulator', parameters, '-r', '__ns:=/rt'), '/rt')
    graph.until(lambda: driver.seen['joint_states'] and driver.wheels.get_subscription_count())
    return driver


def test_an_episode_that_is_over_in_real_time_says_how_to_go_on(graph) -> None:
    """In the log, once; the diagnostics no longer say that it plays."""
    parameters = {'mode': 'realtime', 'robot.model': 'kinematic', 'episode.max_steps': 5}
    driver = Driver(graph, graph.start('simulator', parameters, '-r', '__ns:=/ended'), '/ended')
    said = 'step_limit; the robot stands until /ended/simulator/reset is called'
    graph.until(lambda: said in driver.process.log, 'the end of the episode')
    over = 'the episode is over'
    graph.until(lambda: driver.status and driver.diagnostics.message == over, 'diagnostics')
    driver.process.stop()


def test_real_time_runs_at_its_factor(realtime: Driver) -> None:
    """Never faster; slower only where the machine is too slow."""
    packets = realtime.packets
    start, start_s = len(packets), time.monotonic()
    realtime.graph.until(lambda: len(packets) >= start + 80)
    took_s = time.monotonic() - start_s
    simulated_s = (stamp_of(packets[-1]) - stamp_of(packets[start])) / 1e9
    assert 0.4 < simulated_s / took_s < 2.3


def test_the_pace_changes_at_once(graph) -> None:
    """At first a step takes 5 s; faster, 60 steps follow each other well before the second."""
    parameters = {'mode': 'realtime', 'robot.model': 'kinematic', 'real_time_factor': 0.01}
    driver = Driver(graph, graph.start('simulator', parameters, '-r', '__ns:=/pace'), '/pace')
    graph.until(lambda: driver.packets)
    before = len(driver.packets)
    assert before <= 4
    ((is_set, reason),) = set_parameters(driver, real_time_factor=20.0)
    assert (is_set, reason) == (True, 'real_time_factor from the next step on')
    start_s = time.monotonic()
    graph.until(lambda: len(driver.packets) >= before + 60)
    assert time.monotonic() - start_s < 60 * 5 / 10
    driver.process.stop()


def velocities_after(driver: Driver, publisher: Any, message: Any) -> list[tuple[float, float]]:
    """Publish a command; return the wheels' velocities from its step to the standstill."""
    joints = driver.seen['joint_states']
    driver.graph.until(publisher.get_subscription_count)
    driver.graph.until(lambda: list(joints[-1].velocity) == [0.0, 0.0])
    start = len(joints)
    publisher.publish(message)
    moving = driver.graph.until(lambda: [each for each in joints[start:] if any(each.velocity)])
    driver.graph.until(lambda: not any(joints[-1].velocity))
    moving = [each for each in joints[start:] if any(each.velocity)]
    return [tuple(each.velocity) for each in moving]


def test_the_wheels_stop_half_a_second_after_the_last_command(realtime: Driver) -> None:
    """Ten steps of simulation time, exactly."""
    publisher = realtime.graph.node.create_publisher(
        Float64MultiArray, '/rt/wheel_velocity_controller/commands', 10
    )
    message = Float64MultiArray(data=[1.0, 2.0])
    assert velocities_after(realtime, publisher, message) == [(1.0, 2.0)] * 10


def test_stamps_do_not_matter_in_real_time(realtime: Driver) -> None:
    """So the lockstep controllers drive there too."""
    message = WheelVelocities(left=2.0, right=1.0)
    assert velocities_after(realtime, realtime.wheels, message) == [(2.0, 1.0)] * 10


def test_an_array_of_another_length_is_reported(realtime: Driver) -> None:
    """And ignored; time goes on."""
    publisher = realtime.graph.node.create_publisher(
        Float64MultiArray, '/rt/wheel_velocity_controller/commands', 10
    )
    realtime.graph.until(publisher.get_subscription_count)
    publisher.publish(Float64MultiArray(data=[1.0, 2.0, 3.0]))
    expected = 'expected [left, right] in rad/s, got 3 values'
    realtime.graph.until(lambda: expected in realtime.process.log, 'the error')
    start = len(realtime.packets)
    realtime.graph.until(lambda: len(realtime.packets) > start + 5)
    assert not any(realtime.seen['joint_states'][-1].velocity)


def test_a_twist_drives_in_real_time(realtime: Driver) -> None:
    """Forward at a wheel's radius a second: 1 rad/s either side."""
    publisher = realtime.graph.node.create_publisher(Twist, '/rt/cmd_vel', 10)
    velocities = velocities_after(realtime, publisher, Twist(linear=Vector3(x=0.0975)))
    assert velocities == [pytest.approx((1.0, 1.0))] * 10


def test_a_stamped_twist_drives_where_it_is_asked_for(graph) -> None:
    """A turn to the left on the spot."""
    parameters = {
        'robot.model': 'kinematic',
        'mode': 'realtime',
        'use_stamped_vel': 'true',
        'real_time_factor': 4.0,
    }
    driver = Driver(graph, graph.start('simulator', parameters, '-r', '__ns:=/st'), '/st')
    graph.until(lambda: driver.seen['joint_states'])
    publisher = graph.node.create_publisher(TwistStamped, '/st/cmd_vel', 10)
    message = TwistStamped(twist=Twist(angular=Vector3(z=0.5)))
    left, right = velocities_after(driver, publisher, message)[0]
    assert (left, right) == pytest.approx((-0.5 * 0.1655 / 0.0975, 0.5 * 0.1655 / 0.0975))
    assert driver.process.stop() == 0


def test_a_simulator_in_real_time_ends_after_its_episodes(graph) -> None:
    """Nobody answers there."""
    parameters = {
        'robot.model': 'kinematic',
        'mode': 'realtime',
        'episode.max_steps': 3,
        'end_after_episodes': 1,
    }
    assert graph.start('simulator', parameters, '-r', '__ns:=/ending').wait() == 0


def test_wrong_parameters_are_refused_with_one_line(graph) -> None:
    """Exit status 2; the line says what is allowed."""
    cases = [
        ({'seed': -1}, 'seed: expected a whole number from 0 to 9223372036854775807'),
        (
            {'seed': 'seven'},
            "seed: expected a whole number from 0 to 9223372036854775807, got 'seven'",
        ),
        ({'mode': 'fast'}, "mode: expected one of lockstep, realtime, got 'fast'"),
        ({'camera.width': 1.5}, 'camera.width: expected a whole number from 1 to 2048'),
        ({'course': 'nowhere'}, "or the path of a course file, got 'nowhere'"),
        ({'lane': 'middle', 'autostart': 'false'}, 'middle'),
        ({'seed': '['}, ''),
    ]
    processes = [
        graph.start('simulator', {'robot.model': 'kinematic', **parameters})
        for parameters, _ in cases
    ]
    for process, (parameters, expected) in zip(processes, cases, strict=True):
        assert process.wait() == 2, parameters
        errors = [line for line in process.log.splitlines() if line.startswith('error: ')]
        assert len(errors) == 1, process.log
        assert expected in errors[0]
        assert 'Traceback' not in process.log


def test_unknown_parameters_are_named(graph) -> None:
    """They may be meant for another node, so that this one starts all the same."""
    process = graph.start('simulator', {'robot.modle': 'kinematic', 'seed': 3})
    expected = 'robot.modle: expected parameters of simulator; ignored'
    graph.until(lambda: expected in process.log, 'the warning')
    graph.until(lambda: 'seed 3' in process.log)
    assert 'seed: ' not in process.log
    assert process.stop() == 0


def test_an_observation_waits_for_all_who_must_hear_it(graph) -> None:
    """It is said for whom; the reset is answered when the observation is out, not before."""
    parameters = {'robot.model': 'kinematic', 'autostart': 'false', 'wait_for_subscribers': 1}
    process = graph.start('simulator', parameters, '-r', '__ns:=/late')
    client = graph.node.create_client(Reset, '/late/simulator/reset')
    graph.until(client.service_is_ready)
    answer = client.call_async(Reset.Request(seed=1))
    expected = 'waiting for 1 subscribers of event_camera/events; 0 are there'
    graph.until(lambda: expected in process.log, 'the warning')
    assert not answer.done()
    packets: list[EventPacket] = []
    graph.node.create_subscription(EventPacket, '/late/event_camera/events', packets.append, 10)
    assert graph.result(answer).success
    graph.until(lambda: packets)
    assert stamp_of(packets[0]) == STEP_NS
    assert process.stop() == 0


def test_a_reset_that_takes_no_effect_is_answered(graph) -> None:
    """It says so, where another one or a stop comes before anybody hears of it."""
    parameters = {'robot.model': 'kinematic', 'autostart': 'false', 'wait_for_subscribers': 1}
    process = graph.start('simulator', parameters, '-r', '__ns:=/over')
    kinds = {'reset': Reset, 'reset_simulation': ResetSimulation}
    clients = {
        name: graph.node.create_client(kind, f'/over/simulator/{name}')
        for name, kind in kinds.items()
    }
    graph.until(lambda: all(client.service_is_ready() for client in clients.values()))
    first = clients['reset'].call_async(Reset.Request(lane='inner', seed=1))
    # One client, as a service may drop its first answer to one that it has not met.
    name = '/over/simulator/get_simulation_state'
    asking = graph.node.create_client(GetSimulationState, name)
    graph.until(asking.service_is_ready)
    state = SimulationState(state=SimulationState.STATE_STOPPED)
    while state.state == SimulationState.STATE_STOPPED:
        state = graph.result(asking.call_async(GetSimulationState.Request())).state
    second = clients['reset_simulation'].call_async(ResetSimulation.Request())
    answer = graph.result(first)
    assert answer.success is False
    assert 'another reset or a stop' in answer.message
    assert not second.done()
    state.state = SimulationState.STATE_STOPPED
    graph.call(SetSimulationState, '/over/simulator/set_simulation_state', state=state)
    assert graph.result(second).result.result == Result.RESULT_OPERATION_FAILED
    assert process.stop() == 0


def test_a_simulator_that_ends_before_an_episode_asked_for_begins_says_so(graph) -> None:
    """Who asked is answered, and the exit status names the signal."""
    parameters = {'robot.model': 'kinematic', 'autostart': 'false', 'wait_for_subscribers': 1}
    process = graph.start('simulator', parameters, '-r', '__ns:=/ending')
    client = graph.node.create_client(Reset, '/ending/simulator/reset')
    graph.until(client.service_is_ready)
    answer = client.call_async(Reset.Request(seed=1))
    graph.until(lambda: '0 are there' in process.log, 'the warning')
    process.send(signal.SIGTERM)
    assert graph.result(answer).success is False
    assert process.wait() == 143
    assert 'ended by SIGTERM in episode 1, after 0 steps' in process.log
