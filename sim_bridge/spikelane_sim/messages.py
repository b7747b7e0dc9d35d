"""From messages to the core's records, whichever library has read them: rclpy, rosbags, another.

Only the names of the fields matter here, so that bags can be read where there is no ROS.
"""

from __future__ import annotations

import math
from typing import Any

from spikelane_sim.contract import LaneState, WheelEncoders, WheelVelocities
from spikelane_sim.errors import MessageError
from spikelane_sim.frame_names import WHEEL_JOINTS
from spikelane_sim.parameter_changes import ParameterChange
from spikelane_sim.sensor import ReceivedPacket

_SECOND_NS = 1_000_000_000

#: Fields of a rcl_interfaces/ParameterValue by its type, of those that parameters have which may
#: be changed.
_VALUE_FIELDS = {1: 'bool_value', 2: 'integer_value', 3: 'double_value', 4: 'string_value'}


def to_stamp_ns(time: Any) -> int:
    """Return the stamp [ns] of a builtin_interfaces/Time.

    Raises:
        MessageError: The stamp is not normalised: a second or more is in its nanoseconds.
    """
    nanoseconds = int(time.nanosec)
    if nanoseconds >= _SECOND_NS:
        raise MessageError(f'stamp: expected nanosec below {_SECOND_NS}, got {nanoseconds}')
    return int(time.sec) * _SECOND_NS + nanoseconds


def lane_state_from_message(message: Any) -> LaneState:
    """Return what a spikelane_msgs/LaneState says.

    Raises:
        MessageError: A number is not finite.
    """
    # A sum is finite only where all its terms are, and one test costs less than four.
    total = message.distance + message.heading_error + message.position + message.progress
    if not math.isfinite(total):
        raise MessageError(
            'lane state: expected finite distance, heading_error, position and progress, got '
            f'{message.distance}, {message.heading_error}, {message.position}, {message.progress}'
        )
    return LaneState(
        lane=message.lane,
        distance_m=message.distance,
        heading_error_rad=message.heading_error,
        position_m=message.position,
        section=message.section,
        progress_m=message.progress,
        laps=message.laps,
        episode=message.episode,
        step=message.step,
        terminated=message.terminated,
        reason=message.reason,
    )


def wheels_from_message(message: Any) -> WheelVelocities:
    """Return the wheel velocities of a spikelane_msgs/WheelVelocities [rad/s]."""
    return WheelVelocities(message.left, message.right)


def encoders_from_message(message: Any) -> WheelEncoders | None:
    """Return what a sensor_msgs/JointState says of the wheels, None if it has none of them.

    Raises:
        MessageError: A wheel has no position or velocity, or one that is not finite.
    """
    names = list(message.name)
    if not set(WHEEL_JOINTS) <= set(names):
        return None
    places = [names.index(joint) for joint in WHEEL_JOINTS]
    counts = len(message.position), len(message.velocity)
    if min(counts) <= max(places):
        raise MessageError(
            f'joint state: expected a position and a velocity of each of {len(names)} joints, '
            f'got {counts[0]} and {counts[1]}'
        )
    angles, velocities = (
        tuple(float(values[place]) for place in places)
        for values in (message.position, message.velocity)
    )
    if not all(map(math.isfinite, (*angles, *velocities))):
        raise MessageError(
            f'joint state: expected finite numbers of the wheels, got {angles}, {velocities}'
        )
    return WheelEncoders((angles[0], angles[1]), (velocities[0], velocities[1]))


def received_packet(message: Any) -> ReceivedPacket:
    """Return the fields of an event_camera_msgs/EventPacket; its bytes stay where they are."""
    return ReceivedPacket(
        to_stamp_ns(message.header.stamp),
        message.seq,
        message.encoding,
        memoryview(message.events),
        message.time_base,
        message.width,
        message.height,
        message.is_bigendian,
    )


def change_from_message(message: Any) -> ParameterChange:
    """Return the change of parameters that a rcl_interfaces/ParameterEvent tells of.

    Raises:
        MessageError: A value is of a type that no such parameter has.
    """
    values = {}
    for each in message.changed_parameters:
        field = _VALUE_FIELDS.get(int(each.value.type))
        if field is None:
            raise MessageError(
                f'{each.name}: expected a value of type 1 to 4, got {each.value.type}'
            )
        values[str(each.name)] = getattr(each.value, field)
    return ParameterChange(to_stamp_ns(message.stamp), values)
