"""Messages made from the core's records, against literals."""

from array import array
import math
from types import SimpleNamespace

from builtin_interfaces.msg import Time
from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import Pose, Quaternion, TransformStamped, Twist, Vector3
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from sensor_msgs.msg import Image, JointState
from spikelane_msgs.msg import LaneState as LaneStateMessage
from spikelane_msgs.msg import WheelVelocities as WheelVelocitiesMessage

from spikelane_sim import messages
from spikelane_sim.camera import Camera, CameraParameters
from spikelane_sim.contract import LaneState, RobotState, WheelVelocities
from spikelane_sim.course import load_course
from spikelane_sim.errors import PacketError
from spikelane_sim.events import make_events, no_events
from spikelane_sim.frame_names import WHEEL_JOINTS
from spikelane_sim.nodes import conversions
from spikelane_sim.nodes.pairing import KEPT, StampGroups

pytestmark = pytest.mark.ros

STAMP_NS = 1_050_000_000
QUARTER_TURN = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
ROBOT = RobotState(
    position=(1.0, 2.0, 0.5),
    orientation=QUARTER_TURN,
    linear=(0.5, 0.25, 0.0),
    angular=(0.0, 0.0, 0.75),
    wheel_angles=(3.0, 4.0),
    wheel_velocities=(5.0, 6.0),
)


@pytest.mark.parametrize(
    ('stamp_ns', 'time'),
    [
        (0, Time(sec=0, nanosec=0)),
        (50_000_000, Time(sec=0, nanosec=50_000_000)),
        (12_999_999_999, Time(sec=12, nanosec=999_999_999)),
    ],
)
def test_stamps_are_seconds_and_nanoseconds(stamp_ns: int, time: Time) -> None:
    """Both ways."""
    assert conversions.to_time(stamp_ns) == time
    assert messages.to_stamp_ns(time) == stamp_ns


@pytest.mark.parametrize('encoding', ['evt3', 'mono'])
def test_a_packet_carries_events_and_where_they_belong(encoding: str) -> None:
    """All fields are set but the header's frame; what is decoded is what was put in."""
    events = make_events([1_000_002_000, 1_050_000_000], [5, 127], [0, 127], [1, -1])
    message = EventPacket(width=128, height=128)
    conversions.fill_event_packet(message, events, STAMP_NS, 7, encoding)
    assert message.header.stamp == Time(sec=1, nanosec=50_000_000)
    assert (message.seq, message.encoding, message.is_bigendian) == (7, encoding, False)
    assert message.time_base == 1_000_000_000
    assert np.array_equal(conversions.events_from_packet(message), events)


def test_a_packet_taken_apart_can_be_put_together() -> None:
    """Field by field; the frame is left to the caller."""
    message = EventPacket(width=8, height=9, seq=3, time_base=5, encoding='mono')
    message.header.stamp = Time(sec=1, nanosec=50_000_000)
    message.is_bigendian = True
    message.events = array('B', [1, 2, 3])
    packet = messages.received_packet(message)
    assert (packet.stamp_ns, packet.sequence, packet.time_base_ns) == (STAMP_NS, 3, 5)
    assert (packet.encoding, packet.width, packet.height) == ('mono', 8, 9)
    assert (bytes(packet.data), packet.is_bigendian) == (b'\1\2\3', True)
    again = EventPacket()
    conversions.fill_received_packet(again, packet)
    assert again == message


def test_a_packet_that_says_big_endian_is_refused() -> None:
    """No encoding is."""
    message = EventPacket(width=8, height=8, encoding='evt3', is_bigendian=True)
    with pytest.raises(PacketError, match='little-endian'):
        conversions.events_from_packet(message)


def test_a_packet_without_events_decodes_to_none() -> None:
    """As in a simulation's first step."""
    message = EventPacket(width=8, height=8)
    conversions.fill_event_packet(message, no_events(), STAMP_NS, 0, 'evt3')
    assert len(message.events) == 30
    assert len(conversions.events_from_packet(message)) == 0


def test_a_lane_state_comes_back_as_it_was() -> None:
    """Every field is carried."""
    lane = LaneState('inner', -0.125, 0.5, 3.25, 'C', 31.5, 2, 3, 4, True, 'lane_lost')
    message = LaneStateMessage()
    conversions.fill_lane_state(message, lane, STAMP_NS)
    assert (message.distance, message.progress, message.laps) == (-0.125, 31.5, 2)
    assert message.header.stamp.nanosec == 50_000_000
    assert messages.lane_state_from_message(message) == lane


def test_wheels_keep_their_sides() -> None:
    """Left is left."""
    message = WheelVelocitiesMessage(left=1.0, right=2.0)
    assert messages.wheels_from_message(message) == WheelVelocities(left=1.0, right=2.0)


@pytest.mark.parametrize(
    ('forward', 'turn', 'expected'),
    [(0.2, 0.0, (2.0, 2.0)), (0.0, 1.0, (-1.5, 1.5)), (0.2, -1.0, (3.5, 0.5))],
)
def test_a_twist_becomes_wheel_velocities(
    forward: float, turn: float, expected: tuple[float, float]
) -> None:
    """Wheels of 0.1 m, 0.3 m apart; a turn to the left makes the right wheel faster."""
    twist = Twist(linear=Vector3(x=forward), angular=Vector3(z=turn))
    assert conversions.wheels_from_twist(twist, 0.1, 0.3) == pytest.approx(expected)


def test_odometry_has_the_pose_in_the_world_and_the_twist_in_the_body() -> None:
    """REP-105, and the message's own definition."""
    message = Odometry()
    conversions.fill_odometry(message, ROBOT, STAMP_NS)
    assert (message.pose.pose.position.x, message.pose.pose.position.y) == (1.0, 2.0)
    assert message.pose.pose.orientation.w == QUARTER_TURN[3]
    assert (message.twist.twist.linear.x, message.twist.twist.linear.y) == (0.5, 0.25)
    assert message.twist.twist.angular.z == 0.75


def test_a_twist_in_the_world_is_turned_with_the_body() -> None:
    """A robot that faces +y and drives forward moves along +y."""
    twist = Twist()
    conversions.fill_world_twist(twist, ROBOT)
    assert (twist.linear.x, twist.linear.y) == pytest.approx((-0.25, 0.5))
    assert twist.angular.z == pytest.approx(0.75)


def test_the_body_transform_is_the_pose() -> None:
    """With the stamp of the step."""
    message = TransformStamped()
    conversions.fill_body_transform(message, ROBOT, STAMP_NS)
    assert message.transform.translation == Vector3(x=1.0, y=2.0, z=0.5)
    assert message.transform.rotation.z == QUARTER_TURN[2]
    assert message.header.stamp.sec == 1


def test_joints_are_left_then_right() -> None:
    """In the order of the names."""
    message = JointState()
    conversions.fill_joint_state(message, ROBOT, STAMP_NS)
    assert list(message.position) == [3.0, 4.0]
    assert list(message.velocity) == [5.0, 6.0]
    assert WHEEL_JOINTS == ('left_wheel_joint', 'right_wheel_joint')


def test_the_camera_is_described_as_ros_does() -> None:
    """100 degrees over 128 pixels: a focal length of 64 / tan(50 degrees) px."""
    camera = Camera(CameraParameters(), load_course('scenario_1'))
    info = conversions.camera_info(camera)
    focal_px = 64 / math.tan(math.radians(50))
    assert (info.width, info.height, info.distortion_model) == (128, 128, 'plumb_bob')
    assert list(info.k) == pytest.approx([focal_px, 0, 63.5, 0, focal_px, 63.5, 0, 0, 1])
    assert list(info.p) == pytest.approx([focal_px, 0, 63.5, 0, 0, focal_px, 63.5, 0, 0, 0, 1, 0])
    assert info.header.frame_id == 'event_camera_optical_frame'


def test_the_optical_frame_looks_forward_and_down() -> None:
    """Its z axis points along the body's x axis, 30 degrees down; its x axis to the right."""
    camera = Camera(CameraParameters(), load_course('scenario_1'))
    transform = conversions.camera_transform(camera)
    assert transform.header.frame_id == 'base_link'
    assert transform.child_frame_id == 'event_camera_optical_frame'
    rotation = transform.transform.rotation
    turned = SimpleNamespace(orientation=(rotation.x, rotation.y, rotation.z, rotation.w))
    axes = []
    for axis in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)):
        twist = Twist()
        turned.linear = turned.angular = axis
        conversions.fill_world_twist(twist, turned)
        axes.append((twist.linear.x, twist.linear.y, twist.linear.z))
    assert axes[0] == pytest.approx((0, -1, 0), abs=1e-12)
    assert axes[1] == pytest.approx((math.sqrt(0.75), 0, -0.5), abs=1e-12)


def test_the_image_shows_on_blue_and_off_red() -> None:
    """Row 0 on top, three bytes a pixel in the order blue, green, red."""
    message = Image(width=3, height=2, encoding='bgr8', step=9)
    events = make_events([0, 0], [2, 0], [0, 1], [1, -1])
    conversions.fill_event_image(message, events, STAMP_NS)
    pixels = np.frombuffer(message.data, np.uint8).reshape(2, 3, 3)
    assert pixels[0, 2].argmax() == 0
    assert pixels[1, 0].argmax() == 2
    assert np.count_nonzero(pixels.any(axis=2)) == 2
    assert isinstance(message.data, array)


@pytest.mark.parametrize(
    ('orientation', 'heading_rad'),
    [
        (Quaternion(w=1.0), 0.0),
        (Quaternion(z=1.0, w=1.0), math.pi / 2),
        (Quaternion(x=0.0, y=0.0, z=-0.5, w=0.5 * math.sqrt(3)), -math.pi / 3),
    ],
)
def test_the_heading_of_an_orientation(orientation: Quaternion, heading_rad: float) -> None:
    """It need not be normalised."""
    assert conversions.heading_of(orientation) == pytest.approx(heading_rad)


@pytest.mark.parametrize(
    'orientation', [Quaternion(w=0.0), Quaternion(w=math.nan), Quaternion(z=math.inf)]
)
def test_what_is_no_rotation_has_no_heading(orientation: Quaternion) -> None:
    """NaN instead of a guess."""
    assert math.isnan(conversions.heading_of(orientation))


def test_a_pose_keeps_all_seven_numbers() -> None:
    """Position, then quaternion."""
    pose = Pose()
    conversions.fill_pose(pose, ROBOT)
    assert (pose.position.x, pose.position.y, pose.position.z) == (1.0, 2.0, 0.5)
    orientation = pose.orientation
    assert (orientation.x, orientation.y, orientation.z, orientation.w) == QUARTER_TURN


def stamped(step: int, topic: int = 0) -> EventPacket:
    """Return a message with a stamp, of the first or the second topic."""
    message = EventPacket(seq=topic)
    message.header.stamp = conversions.to_time(step)
    return message


def test_messages_are_paired_by_stamp_in_whatever_order_they_come() -> None:
    """The first topic's message is handed on first; each is used once."""
    pairs = []
    pairing = StampGroups(lambda *pair: pairs.append(pair), 2)
    lanes, packets = [stamped(n) for n in range(3)], [stamped(n, 1) for n in range(3)]
    pairing.add(0, lanes[0])
    pairing.add(0, lanes[1])
    pairing.add(1, packets[1])
    pairing.add(1, packets[2])
    pairing.add(1, packets[0])
    pairing.add(0, lanes[2])
    assert pairs == [(lanes[n], packets[n]) for n in (1, 0, 2)]


def test_messages_of_three_topics_are_grouped() -> None:
    """In the topics' order, once all are there."""
    groups = []
    grouping = StampGroups(lambda *group: groups.append(group), 3)
    first, second = ([stamped(n, topic) for topic in range(3)] for n in range(2))
    grouping.add(2, first[2])
    assert grouping.lacks_others
    grouping.add(0, first[0])
    grouping.add(1, second[1])
    grouping.add(2, second[2])
    assert groups == []
    grouping.add(1, first[1])
    grouping.add(0, second[0])
    assert groups == [tuple(first), tuple(second)]
    assert not grouping.lacks_others


def test_a_message_without_partner_is_not_kept_for_ever() -> None:
    """The oldest goes first."""
    pairs = []
    pairing = StampGroups(lambda *pair: pairs.append(pair), 2)
    for n in range(KEPT + 1):
        pairing.add(0, stamped(n))
    pairing.add(1, stamped(0))
    assert pairs == []
    pairing.add(1, stamped(1))
    assert len(pairs) == 1
