"""What the physics needs to know of the robot, read out of its URDF.

The rest of the URDF is for viewers: frames that pybullet would give a mass of 1 kg each, and the
shape of a body that has nothing to run into.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple, TYPE_CHECKING
from xml.etree import ElementTree

from spikelane_sim.errors import ParameterError

if TYPE_CHECKING:
    from spikelane_sim.robots import RobotParameters

# base_link may be this far off the height at which the wheels just touch the floor: as it is by
# default, they stand 0.01 mm deep in it, the depth that Bullet leaves alone.
_HEIGHT_TOLERANCE_M = 1e-4

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


def check_geometry(parameters: RobotParameters, description: Description, urdf: str) -> None:
    """Refuse a geometry that the description does not have.

    Args:
        parameters: What is given.
        description: What the URDF says.
        urdf: The URDF's name, for the message.

    Raises:
        ParameterError: They differ.
    """
    left, right = description.left, description.right
    described = {
        'wheel_radius_m': (left.contact_radius_m, 1e-9),
        'track_m': (left.origin_m[1] - right.origin_m[1], 1e-9),
        'axle_x_m': (left.origin_m[0], 1e-9),
        'height_m': (left.contact_radius_m - left.origin_m[2], _HEIGHT_TOLERANCE_M),
    }
    for name, (expected, tolerance) in described.items():
        value = getattr(parameters, name)
        if abs(value - expected) > tolerance:
            raise ParameterError(
                f'{name}: expected {expected:g} as in {urdf}, got {value:g}; '
                f'only the engine kinematic can have another'
            )


def check_symmetry(description: Description, urdf: str) -> None:
    """Refuse a robot whose left half is not the mirror image of the right one.

    Args:
        description: What the URDF says.
        urdf: The URDF's name, for the message.

    Raises:
        ParameterError: It is not symmetric, or a wheel's mass centre is not on its axis.
    """
    base, left, right = description
    mirrored = right._replace(
        origin_m=_mirrored(right.origin_m),
        mass_centre_m=_mirrored(right.mass_centre_m),
        contact_m=_mirrored(right.contact_m),
    )
    is_balanced = left.mass_centre_m[0] == left.mass_centre_m[2] == 0.0
    if left != mirrored or base.mass_centre_m[1] or base.contact_m[1] or not is_balanced:
        raise ParameterError(
            f'{urdf}: expected equal and balanced wheels, and the mass centre and the caster in '
            f'the middle, as the engine rigid needs it; got {description}'
        )


def _mirrored(vector: Vector) -> Vector:
    return (vector[0], -vector[1], vector[2])


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
