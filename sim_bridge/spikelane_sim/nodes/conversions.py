"""From the core's records to ROS messages; the way back needs no ROS: `spikelane_sim.messages`."""

from __future__ import annotations

from array import array
import math

from builtin_interfaces.msg import Time
from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import Pose, Quaternion, TransformStamped, Twist
from nav_msgs.msg import Odometry
import numpy as np
from sensor_msgs.msg import CameraInfo, Image, JointState
from simulation_interfaces.msg import EntityState
from spikelane_msgs.msg import LaneState as LaneStateMessage

from spikelane_sim.camera import CameraModel
from spikelane_sim.codecs import decode, encode
from spikelane_sim.contract import LaneState, RobotState, WheelEncoders, WheelVelocities
from spikelane_sim.errors import MessageError, PacketError
from spikelane_sim.events import Events
from spikelane_sim.frame_names import CAMERA_FRAME
from spikelane_sim.messages import to_stamp_ns
from spikelane_sim.period import PERIOD_NS
from spikelane_sim.sensor import ReceivedPacket

WORLD_FRAME = 'odom'
BODY_FRAME = 'base_link'

# What a robot on the ground is given as its state; it stands upright whatever was asked for.
_MAX_HEIGHT_M = 1.0
_MAX_TILT_RAD = 0.1
_MIN_SQUARED_NORM = 1e-6

_ON_BGR, _OFF_BGR = (255, 64, 0), (0, 64, 255)


def to_time(stamp_ns: int) -> Time:
    """Return a stamp [ns] as a message."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return Time(sec=seconds, nanosec=nanoseconds)


def fill_event_packet(
    message: EventPacket,
    events: Events,
    stamp_ns: int,
    sequence: int,
    encoding: str,
    period_ns: int = PERIOD_NS,
) -> None:
    """Put the events of one step into a packet whose width and height are set."""
    packet = encode(encoding, events, stamp_ns, message.width, message.height, period_ns)
    message.header.stamp = to_time(stamp_ns)
    message.seq = sequence
    message.time_base = packet.time_base_ns
    message.encoding = encoding
    # rclpy takes an array('B') as it is, but looks at every element of anything else.
    message.events = array('B', packet.data)


def fill_received_packet(message: EventPacket, packet: ReceivedPacket) -> None:
    """Put back what `messages.received_packet` took out."""
    message.header.stamp = to_time(packet.stamp_ns)
    message.seq = packet.sequence
    message.encoding = packet.encoding
    # rclpy takes an array('B') as it is, but looks at every element of anything else.
    message.events = array('B', bytes(packet.data))
    message.time_base = packet.time_base_ns
    message.width = packet.width
    message.height = packet.height
    message.is_bigendian = packet.is_bigendian


def events_from_packet(message: EventPacket) -> Events:
    """Decode a packet whose event times are related to its stamp.

    Raises:
        PacketError: The packet is malformed.
    """
    if message.is_bigendian:
        raise PacketError('event packet: expected little-endian data, got is_bigendian true')
    return decode(
        message.encoding,
        memoryview(message.events),
        to_stamp_ns(message.header.stamp),
        message.time_base,
        message.width,
        message.height,
    )


def fill_lane_state(message: LaneStateMessage, lane: LaneState, stamp_ns: int) -> None:
    """Put a lane state into a message."""
    message.header.stamp = to_time(stamp_ns)
    message.lane = lane.lane
    message.distance = lane.distance_m
    message.heading_error = lane.heading_error_rad
    message.position = lane.position_m
    message.section = lane.section
    message.progress = lane.progress_m
    message.laps = lane.laps
    message.episode = lane.episode
    message.step = lane.step
    message.terminated = lane.terminated
    message.reason = lane.reason


def wheels_from_twist(twist: Twist, wheel_radius_m: float, track_m: float) -> WheelVelocities:
    """Return the wheel velocities that give a twist's forward [m/s] and turning [rad/s] rates."""
    turn = twist.angular.z * track_m / 2
    return WheelVelocities(
        (twist.linear.x - turn) / wheel_radius_m, (twist.linear.x + turn) / wheel_radius_m
    )


def fill_odometry(message: Odometry, robot: RobotState, stamp_ns: int) -> None:
    """Put pose (world frame) and twist (body frame) into a message."""
    message.header.stamp = to_time(stamp_ns)
    fill_pose(message.pose.pose, robot)
    fill_twist(message.twist.twist, robot)


def fill_pose(message: Pose, robot: RobotState) -> None:
    """Put the robot's pose in the world into a message."""
    position, orientation = message.position, message.orientation
    position.x, position.y, position.z = robot.position
    orientation.x, orientation.y, orientation.z, orientation.w = robot.orientation


def fill_twist(message: Twist, robot: RobotState) -> None:
    """Put the robot's velocities in its own frame into a message."""
    linear, angular = message.linear, message.angular
    linear.x, linear.y, linear.z = robot.linear
    angular.x, angular.y, angular.z = robot.angular


def fill_world_twist(message: Twist, robot: RobotState) -> None:
    """Put the robot's velocities in the world frame into a message."""
    linear, angular = message.linear, message.angular
    linear.x, linear.y, linear.z = _rotate(robot.orientation, robot.linear)
    angular.x, angular.y, angular.z = _rotate(robot.orientation, robot.angular)


def _rotate(
    quaternion: tuple[float, float, float, float], vector: tuple[float, float, float]
) -> list[float]:
    """Rotate a vector by a unit quaternion x, y, z, w."""
    axis, w = np.array(quaternion[:3]), quaternion[3]
    across = 2 * np.cross(axis, vector)
    return list((np.array(vector) + w * across + np.cross(axis, across)).tolist())


def fill_body_transform(message: TransformStamped, robot: RobotState, stamp_ns: int) -> None:
    """Put the transform from the world to the body into a message."""
    message.header.stamp = to_time(stamp_ns)
    translation, rotation = message.transform.translation, message.transform.rotation
    translation.x, translation.y, translation.z = robot.position
    rotation.x, rotation.y, rotation.z, rotation.w = robot.orientation


def camera_transform(camera: CameraModel) -> TransformStamped:
    """Return the fixed transform from the body to the camera's optical frame."""
    message = TransformStamped()
    message.header.frame_id = BODY_FRAME
    message.child_frame_id = CAMERA_FRAME
    place = camera.optical_frame
    translation, rotation = message.transform.translation, message.transform.rotation
    translation.x, translation.y, translation.z = place.translation
    rotation.x, rotation.y, rotation.z, rotation.w = place.orientation
    return message


def camera_info(camera: CameraModel) -> CameraInfo:
    """Return the pinhole camera's calibration; the stamp is left to the caller."""
    fx, fy, cx, cy = camera.intrinsics
    message = CameraInfo()
    message.header.frame_id = CAMERA_FRAME
    message.width = camera.parameters.width
    message.height = camera.parameters.height
    message.distortion_model = 'plumb_bob'
    message.d = [0.0] * 5
    # ROS counts pixel centres as whole numbers, the renderer's image plane begins at 0.
    cx, cy = cx - 0.5, cy - 0.5
    message.k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    message.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    message.p = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    return message


def fill_event_image(message: Image, events: Events, stamp_ns: int) -> None:
    """Draw the events of one step, ON blue and OFF red on black, into a message of bgr8."""
    image = np.zeros((message.height, message.width, 3), np.uint8)
    on = events['polarity'] > 0
    image[events['y'][on], events['x'][on]] = _ON_BGR
    image[events['y'][~on], events['x'][~on]] = _OFF_BGR
    message.header.stamp = to_time(stamp_ns)
    message.data = array('B', image.tobytes())


def fill_joint_state(message: JointState, robot: RobotState, stamp_ns: int) -> None:
    """Put the wheels' angles and velocities into a message."""
    encoders = WheelEncoders(robot.wheel_angles, robot.wheel_velocities)
    fill_encoders(message, encoders, stamp_ns)


def fill_encoders(message: JointState, encoders: WheelEncoders, stamp_ns: int) -> None:
    """Put what the wheels' encoders measure into a message."""
    message.header.stamp = to_time(stamp_ns)
    message.position = list(encoders.angles)
    message.velocity = list(encoders.velocities)


def check_entity_state(state: EntityState) -> None:
    """Check the state that a robot on the ground is to be given.

    The pose must be finite, upright and on the ground, its orientation a rotation, which need not
    be normalised. The twist is not used, since the robot is placed at rest, but must be finite.

    Raises:
        MessageError: The state is not so; the message names the field.
    """
    to_stamp_ns(state.header.stamp)
    vectors = {
        'pose.position': state.pose.position,
        'twist.linear': state.twist.linear,
        'twist.angular': state.twist.angular,
    }
    for name, vector in vectors.items():
        if not all(map(math.isfinite, (vector.x, vector.y, vector.z))):
            raise MessageError(
                f'{name}: expected finite numbers, got {vector.x}, {vector.y}, {vector.z}'
            )
    if abs(state.pose.position.z) > _MAX_HEIGHT_M:
        raise MessageError(
            f'pose.position.z: expected at most {_MAX_HEIGHT_M:g} m from the ground, '
            f'got {state.pose.position.z:g} m'
        )
    _check_upright(state.pose.orientation)


def _check_upright(orientation: Quaternion) -> None:
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    squared = x * x + y * y + z * z + w * w
    if not (_MIN_SQUARED_NORM < squared < math.inf):
        raise MessageError(
            f'pose.orientation: expected a quaternion that is finite and not zero, '
            f'got {x}, {y}, {z}, {w}'
        )
    # The vertical component of the body's z axis.
    up = 1.0 - 2.0 * (x * x + y * y) / squared
    if up < math.cos(_MAX_TILT_RAD):
        raise MessageError(
            f'pose.orientation: expected a tilt of at most {_MAX_TILT_RAD:g} rad, '
            f'got {math.acos(max(up, -1.0)):.3f} rad'
        )


def heading_of(orientation: Quaternion) -> float:
    """Return the heading of an orientation [rad], or NaN where it is not a rotation."""
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    norm = x * x + y * y + z * z + w * w
    if not (math.isfinite(norm) and norm > _MIN_SQUARED_NORM):
        return math.nan
    return math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
