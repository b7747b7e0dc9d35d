"""What a URDF says of a robot's links, in the frame of `base_link`.

Joints are at zero. Only what our physics and camera need is read: no meshes, no transmissions.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
import math
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.errors import ParameterError
from spikelane_sim.robots.differential_drive import rotation

Array = NDArray[np.float64]

_DECIMALS = 12
_TENSOR = ('ixx', 'ixy', 'ixz', 'ixy', 'iyy', 'iyz', 'ixz', 'iyz', 'izz')


class Pose(NamedTuple):
    """Place of a frame in another one, where a vector v of the frame is rotation @ v + origin."""

    rotation: Array  # (3, 3)
    origin_m: Array  # (3,)

    def then(self, other: Pose) -> Pose:
        """Return the pose of a frame that has the pose `other` in this one."""
        return Pose(self.rotation @ other.rotation, self.rotation @ other.origin_m + self.origin_m)

    def inverse(self) -> Pose:
        """Return the pose of the other frame in this one."""
        return Pose(self.rotation.T, -(self.rotation.T @ self.origin_m))


class Inertial(NamedTuple):
    """The mass of a link."""

    mass_kg: float
    centre_m: Array  # of mass, (3,)
    inertia_kg_m2: Array  # about it, (3, 3)


class RoundShape(NamedTuple):
    """A sphere or a cylinder with which a link touches others."""

    kind: str
    radius_m: float
    centre_m: Array  # (3,)


class UrdfTree:
    """A robot's links and joints.

    Attributes:
        name: The robot's.
        root: The link in whose frame everything is, `base_link`.
    """

    root = 'base_link'

    def __init__(self, robot: ElementTree.Element, file: str) -> None:
        """Find out where every link is.

        Args:
            robot: The root of the URDF.
            file: Its name, for messages.

        Raises:
            ParameterError: There is no such link, or a number cannot be read.
        """
        self._robot = robot
        self._file = file
        self.name = robot.get('name', '')
        self._links = {each.get('name', ''): each for each in robot.iterfind('link')}
        self._joints = {each.get('name', ''): each for each in robot.iterfind('joint')}
        if self.root not in self._links:
            self.refuse(f'expected a link {self.root}', ', '.join(self._links) or 'none')
        self._poses = {self.root: Pose(np.eye(3), np.zeros(3))}
        waiting = [self.root]
        while waiting:
            link = waiting.pop()
            for neighbour, pose in self._neighbours(link):
                if neighbour not in self._poses:
                    self._poses[neighbour] = self._poses[link].then(pose)
                    waiting.append(neighbour)

    def refuse(self, expected: str, got: object) -> NoReturn:
        """Say what the file lacks.

        Raises:
            ParameterError: Always.
        """
        raise ParameterError(f'{self._file}: {expected}, got {got}')

    def text(self) -> str:
        """Return the robot as the text of a URDF."""
        return '<?xml version="1.0"?>\n' + ElementTree.tostring(self._robot, encoding='unicode')

    def read_again(self) -> UrdfTree:
        """Return the tree of the robot as it is after changes."""
        return UrdfTree(self._robot, self._file)

    def place_joint(self, joint: str, place_m: Array) -> None:
        """Change where a joint has its child, (3,) in the frame of `base_link`."""
        element = self._joints[joint]
        parent = self._poses[_end(element, 'parent')].inverse()
        _set_place(element, parent.rotation @ place_m + parent.origin_m)

    def move(self, link: str, element: ElementTree.Element, by_m: Array) -> None:
        """Move a shape of a link, (3,) along the axes of `base_link`."""
        place = self._origin(element).origin_m
        _set_place(element, place + self._poses[link].rotation.T @ by_m)

    def link(self, link: str) -> ElementTree.Element:
        """Return the element of a link."""
        return self._links[link]

    def has_link(self, link: str) -> bool:
        """Whether a link is joined to `base_link`."""
        return link in self._poses

    def pose(self, link: str) -> Pose:
        """Return where a link's frame is in `base_link`."""
        return self._poses[link]

    def child_of(self, joint: str) -> str:
        """Return the link that a joint moves.

        Raises:
            ParameterError: There is no such joint, or its link is missing.
        """
        if joint not in self._joints:
            self.refuse(f'expected a joint {joint}', ', '.join(self._joints) or 'none')
        link = _end(self._joints[joint], 'child')
        if link not in self._poses:
            self.refuse(f'joint {joint}: expected a child that is a link', repr(link))
        return link

    def axis(self, joint: str) -> Array:
        """Return a joint's axis in the frame of its child, of length 1."""
        element = self._joints[joint].find('axis')
        axis = np.array([1.0, 0.0, 0.0] if element is None else self._numbers(element, 'xyz'))
        return axis / (float(np.linalg.norm(axis)) or 1.0)

    def limit(self, joint: str, name: str) -> float:
        """Return a limit of a joint, `effort` or `velocity`.

        Raises:
            ParameterError: It is not said.
        """
        element = self._joints[joint].find('limit')
        if element is None or name not in element.attrib:
            self.refuse(f'joint {joint}: expected a limit with effort and velocity', 'none')
        return self._numbers(element, name, count=1)[0]

    def links_without(self, joints: Collection[str]) -> list[str]:
        """Return the links that are joined to `base_link` without certain joints."""
        found = [self.root]
        for link in found:  # grows
            found += [other for other, _ in self._neighbours(link, joints) if other not in found]
        return found

    def inertial(self, link: str, pose: Pose) -> Inertial | None:
        """Return the mass of a link, None where it has none.

        Args:
            link: Name of the link.
            pose: Pose of its frame in that of the result.

        Raises:
            ParameterError: A number is missing.
        """
        element = self._links[link].find('inertial')
        if element is None:
            return None
        mass, inertia = element.find('mass'), element.find('inertia')
        if mass is None or inertia is None:
            self.refuse(f'link {link}: expected inertial to have mass and inertia', 'not both')
        own = pose.then(self._origin(element))
        tensor = [self._numbers(inertia, name, count=1, default='0')[0] for name in _TENSOR]
        return Inertial(
            self._numbers(mass, 'value', count=1)[0],
            own.origin_m,
            own.rotation @ np.array(tensor).reshape(3, 3) @ own.rotation.T,
        )

    def round_shapes(self, link: str, pose: Pose) -> Iterator[RoundShape]:
        """Yield the spheres and cylinders with which a link touches others.

        Args:
            link: Name of the link.
            pose: Pose of its frame in that of the result.
        """
        for collision in self._links[link].iterfind('collision'):
            yield from self.shapes_of(collision, pose)

    def shapes_of(self, collision: ElementTree.Element, pose: Pose) -> Iterator[RoundShape]:
        """Yield the spheres and cylinders of one collision.

        Args:
            collision: The element.
            pose: Pose of its link's frame in that of the result.
        """
        for shape in collision.iterfind('geometry/*'):
            if shape.tag in ('sphere', 'cylinder'):
                radius_m = self._numbers(shape, 'radius', count=1)[0]
                centre_m = pose.then(self._origin(collision)).origin_m
                yield RoundShape(shape.tag, radius_m, centre_m)

    def _neighbours(self, link: str, without: Collection[str] = ()) -> Iterator[tuple[str, Pose]]:
        """Yield the links that joints join to one, with their poses in its frame."""
        for name, joint in self._joints.items():
            parent, child = _end(joint, 'parent'), _end(joint, 'child')
            if name in without or not {parent, child} <= set(self._links):
                continue
            if link == parent:
                yield child, self._origin(joint)
            elif link == child:
                yield parent, self._origin(joint).inverse()

    def _origin(self, element: ElementTree.Element) -> Pose:
        origin = element.find('origin')
        if origin is None:
            return Pose(np.eye(3), np.zeros(3))
        roll, pitch, yaw = self._numbers(origin, 'rpy', default='0 0 0')
        place = self._numbers(origin, 'xyz', default='0 0 0')
        return Pose(rotation(roll, pitch, yaw), np.array(place))

    def _numbers(
        self, element: ElementTree.Element, name: str, count: int = 3, default: str = ''
    ) -> Sequence[float]:
        text = element.get(name, default)
        try:
            numbers = [float(word) for word in text.split()]
        except ValueError:
            numbers = []
        if len(numbers) != count or not all(map(math.isfinite, numbers)):
            what = 'a number' if count == 1 else f'{count} numbers'
            self.refuse(f'{element.tag}: expected {what} as {name}', repr(text[:80]))
        return numbers


def read_tree(urdf: Path) -> UrdfTree:
    """Read a URDF.

    Raises:
        ParameterError: It cannot be read, or has no link `base_link`.
    """
    try:
        robot: Any = ElementTree.parse(urdf).getroot()
    except OSError as error:
        raise ParameterError(f'{urdf}: expected a URDF, got {error.strerror}') from None
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise ParameterError(f'{urdf}: expected a URDF, got no XML: {error}') from None
    return UrdfTree(robot, str(urdf.name))


def joined(parts: Sequence[Inertial]) -> Inertial:
    """Return several masses as one."""
    mass_kg = sum(part.mass_kg for part in parts)
    if mass_kg <= 0:
        return parts[0]
    centre_m = np.sum([part.mass_kg * part.centre_m for part in parts], axis=0) / mass_kg
    inertia = np.zeros((3, 3))
    for part in parts:
        away_m = part.centre_m - centre_m
        lever = float(away_m @ away_m) * np.eye(3) - np.outer(away_m, away_m)
        inertia += part.inertia_kg_m2 + part.mass_kg * lever
    return Inertial(mass_kg, centre_m, inertia)


def _end(joint: ElementTree.Element, role: str) -> str:
    found = joint.find(role)
    return '' if found is None else found.get('link', '')


def _set_place(element: ElementTree.Element, place_m: Array) -> None:
    """Change the place of an element's origin, whose rotation stays."""
    origin = element.find('origin')
    if origin is None:
        origin = ElementTree.SubElement(element, 'origin')
    origin.set('xyz', ' '.join(repr(round(value, _DECIMALS) + 0.0) for value in place_m.tolist()))
