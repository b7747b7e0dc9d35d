"""How a differential drive on two wheels moves, with the facts of it that its URDF has.

Frames are those of REP 103: x forward, y to the left, angles counter-clockwise seen from above.
"""

from __future__ import annotations

from collections.abc import Iterator
import math
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import ParameterError

_ORIGIN = '0 0 0'


class BodyVelocity(NamedTuple):
    """Velocity of the point midway between the wheels, in the robot's frame."""

    forward_m_s: float
    turn_rad_s: float  # counter-clockwise is positive

    def limited(self, forward_m_s: float, turn_rad_s: float) -> BodyVelocity:
        """Return the velocity within limits, slowed down on the same path.

        Args:
            forward_m_s: Largest velocity, forward or backward.
            turn_rad_s: Largest turning rate, either way.
        """
        pairs = zip(self, (forward_m_s, turn_rad_s), strict=True)
        share = min([1.0, *(most / abs(value) for value, most in pairs if abs(value) > most)])
        return BodyVelocity(self.forward_m_s * share, self.turn_rad_s * share)


class DriveGeometry(NamedTuple):
    """What relates the wheels' velocities to that of the body."""

    wheel_radius_m: float
    track_m: float  # distance between the wheels

    def body_velocity(self, wheels: WheelVelocities) -> BodyVelocity:
        """Return how the body moves while the wheels turn at these velocities [rad/s]."""
        left, right = wheels
        return BodyVelocity(
            (left + right) * self.wheel_radius_m / 2,
            (right - left) * self.wheel_radius_m / self.track_m,
        )


def read_geometry(urdf: str, left_joint: str, right_joint: str) -> DriveGeometry:
    """Read radius and distance of the wheels out of a robot's description.

    The radius is that of the largest cylinder or sphere with which a wheel touches others, or is
    drawn where there is none of these.

    Args:
        urdf: The description.
        left_joint: Name of the left wheel's joint.
        right_joint: Name of the right wheel's joint.

    Raises:
        ParameterError: The description cannot be read, or does not say it.
    """
    try:
        robot = ElementTree.fromstring(urdf)
    except ElementTree.ParseError as error:
        raise ParameterError(f'URDF: expected XML, got {urdf[:40]!r}: {error}') from None
    joints = {joint.get('name', ''): joint for joint in robot.iterfind('joint')}
    for name in (left_joint, right_joint):
        if name not in joints:
            raise ParameterError(
                f'URDF: expected a joint {name}, got {", ".join(joints) or "none"}'
            )
    left, right = joints[left_joint], joints[right_joint]
    apart_m = _position_m(robot, left) - _position_m(robot, right)
    if apart_m[1] <= 0:
        raise ParameterError(
            f'URDF: expected {left_joint} to the left of {right_joint}, got it '
            f'{-apart_m[1]:g} m to the right'
        )
    radii_m = [_radius_m(robot, joint) for joint in (left, right)]
    if not math.isclose(*radii_m, rel_tol=1e-3):
        raise ParameterError(f'URDF: expected wheels of one radius, got {radii_m} m')
    return DriveGeometry(radii_m[0], float(np.linalg.norm(apart_m)))


def _position_m(robot: ElementTree.Element, joint: ElementTree.Element) -> NDArray[np.float64]:
    """Return where a joint is in the frame of the robot's root link, all joints at zero."""
    parents = {_link(each, 'child'): each for each in robot.iterfind('joint')}
    position_m, seen = np.zeros(3), set()
    above: ElementTree.Element | None = joint
    while above is not None:
        name = above.get('name')
        if name in seen:
            raise ParameterError(f'URDF: expected a tree, got joint {name} above itself')
        seen.add(name)
        turned = rotation(*_numbers(above, 'rpy'))
        position_m = turned @ position_m + np.array(_numbers(above, 'xyz'))
        above = parents.get(_link(above, 'parent'))
    return position_m


def rotation(roll: float, pitch: float, yaw: float) -> NDArray[np.float64]:
    """Return the rotation about the fixed axes x, y and z, in this order [rad]."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    turned: NDArray[np.float64] = about_z @ about_y @ about_x
    return turned


def _radius_m(robot: ElementTree.Element, joint: ElementTree.Element) -> float:
    name = _link(joint, 'child')
    for kind in ('collision', 'visual'):
        radii_m = list(_radii_m(robot, name, kind))
        if radii_m:
            return max(radii_m)
    raise ParameterError(f'URDF: expected link {name} to be a cylinder or a sphere, got neither')


def _radii_m(robot: ElementTree.Element, link: str, kind: str) -> Iterator[float]:
    links = (each for each in robot.iterfind('link') if each.get('name') == link)
    for shape in (shape for each in links for shape in each.iterfind(f'{kind}/geometry/*')):
        if shape.tag in ('cylinder', 'sphere'):
            (radius_m,) = _parse(shape.get('radius', ''), 1, f'link {link}: radius')
            if radius_m <= 0:
                raise ParameterError(f'URDF: link {link}: expected a radius, got {radius_m:g} m')
            yield radius_m


def _link(joint: ElementTree.Element, role: str) -> str:
    found = joint.find(role)
    return '' if found is None else found.get('link', '')


def _numbers(joint: ElementTree.Element, name: str) -> tuple[float, ...]:
    origin = joint.find('origin')
    text = _ORIGIN if origin is None else origin.get(name, _ORIGIN)
    return _parse(text, 3, f'joint {joint.get("name")}: {name}')


def _parse(text: str, count: int, what: str) -> tuple[float, ...]:
    """Return numbers of an attribute.

    Raises:
        ParameterError: They are not so many finite numbers.
    """
    try:
        numbers = tuple(float(word) for word in text.split())
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ParameterError(f'URDF: {what}: expected {count} numbers, got {text!r:.80}')
    return numbers
