"""What the physics needs to know of the robot, read out of its URDF.

The rest of the URDF is for viewers: frames that pybullet would give a mass of 1 kg each, and the
shape of a body that has nothing to run into.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from spikelane_sim.errors import ParameterError

Vector = tuple[float, float, float]


class Part(NamedTuple):
    """A rigid part that stands on the floor with a sphere."""

    origin_m: Vector  # of its frame, in base_link
    mass_kg: float
    mass_centre_m: Vector  # in its frame
    inertia_kg_m2: Vector  # about the axes of its frame, at the centre of mass
    contact_m: Vector  # centre of the sphere, in its frame
    contact_radius_m: float


class Description(NamedTuple):
    """A differential drive on two wheels and a caster."""

    base: Part
    left: Part
    right: Part


def read_description(urdf: Path) -> Description:
    """Read a robot's URDF.

    Raises:
        ParameterError: It lacks what the physics needs.
    """
    robot = ElementTree.parse(urdf).getroot()
    return Description(
        base=_read_part(robot, 'base_link', (0.0, 0.0, 0.0)),
        left=_read_part(robot, 'left_wheel', _joint_origin(robot, 'left_wheel_joint')),
        right=_read_part(robot, 'right_wheel', _joint_origin(robot, 'right_wheel_joint')),
    )


def _read_part(robot: ElementTree.Element, name: str, origin_m: Vector) -> Part:
    link = _find(robot, f"link[@name='{name}']")
    inertia = _find(link, 'inertial/inertia').attrib
    contact = _find(link, 'collision/geometry/sphere/../..')
    return Part(
        origin_m=origin_m,
        mass_kg=float(_find(link, 'inertial/mass').attrib['value']),
        mass_centre_m=_origin(_find(link, 'inertial')),
        inertia_kg_m2=(float(inertia['ixx']), float(inertia['iyy']), float(inertia['izz'])),
        contact_m=_origin(contact),
        contact_radius_m=float(_find(contact, 'geometry/sphere').attrib['radius']),
    )


def _joint_origin(robot: ElementTree.Element, name: str) -> Vector:
    return _origin(_find(robot, f"joint[@name='{name}']"))


def _origin(element: ElementTree.Element) -> Vector:
    origin = element.find('origin')
    if origin is None:
        return (0.0, 0.0, 0.0)
    x, y, z = (float(number) for number in origin.attrib['xyz'].split())
    return (x, y, z)


def _find(element: ElementTree.Element, path: str) -> ElementTree.Element:
    found = element.find(path)
    if found is None:
        raise ParameterError(f'URDF of the robot: expected {path}, got none')
    return found
