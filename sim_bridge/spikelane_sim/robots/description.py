"""What the physics needs to know of the robot, read out of its URDF.

The rest of the URDF is for viewers: frames that pybullet would give a mass of 1 kg each, and the
shape of a body that has nothing to run into.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.errors import ParameterError
from spikelane_sim.frame_names import WHEEL_JOINTS
from spikelane_sim.robots.urdf import Inertial, joined, read_tree, RoundShape, UrdfTree

# A caster may be this far off the floor that the wheels stand on.
_HEIGHT_TOLERANCE_M = 1e-4
# A wheel's axis may be 0.8 degrees off: rotations in URDFs are often rounded, as 1.57.
_ALONG = 0.9999
_DECIMALS = 12

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


def read_description(urdf: Path | UrdfTree) -> Description:
    """Read a robot's URDF, a file or one that was read.

    All joints but those of the wheels are taken for fixed, at zero: what hangs on them belongs to
    the base. A wheel stands on the sphere of its radius, whether it is a sphere or a cylinder.

    Raises:
        ParameterError: It lacks what the physics needs.
    """
    tree = urdf if isinstance(urdf, UrdfTree) else read_tree(urdf)
    left, right = (_read_wheel(tree, joint) for joint in WHEEL_JOINTS)
    height_m = left.contact_radius_m - left.origin_m[2] - left.contact_m[2]
    return Description(_read_base(tree, height_m), left, right)


def check_symmetry(description: Description, urdf: str) -> None:
    """Refuse a robot whose left half is not the mirror image of the right one.

    Args:
        description: What the URDF says.
        urdf: The robot's name, for the message.

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


def _read_wheel(tree: UrdfTree, joint: str) -> Part:
    link = tree.child_of(joint)
    pose = tree.pose(link)
    axis = pose.rotation @ tree.axis(joint)
    if abs(axis[1]) < _ALONG:
        tree.refuse(f'joint {joint}: expected an axis along y of {tree.root}', axis.tolist())
    own = pose._replace(origin_m=np.zeros(3))  # its frame's place, the axes of the base
    inertial = tree.inertial(link, own)
    shapes = list(tree.round_shapes(link, own))
    if inertial is None or not shapes:
        tree.refuse(
            f'link {link}: expected a mass with inertia, and a sphere or cylinder as collision',
            'neither' if inertial is None and not shapes else 'one of them',
        )
    shape = max(shapes, key=lambda each: each.radius_m)
    return _part(pose.origin_m, inertial, shape)


def _read_base(tree: UrdfTree, height_m: float) -> Part:
    """Return all that is no wheel as one part.

    Args:
        tree: The robot.
        height_m: Height of base_link above the floor.
    """
    links = tree.links_without(WHEEL_JOINTS)
    found = [each for link in links if (each := tree.inertial(link, tree.pose(link)))]
    spheres = [
        shape
        for link in links
        for shape in tree.round_shapes(link, tree.pose(link))
        if shape.kind == 'sphere'
        and abs(shape.centre_m[2] - shape.radius_m + height_m) < _HEIGHT_TOLERANCE_M
    ]
    if not found:
        tree.refuse(f'link {tree.root}: expected a mass with inertia', 'none')
    if len(spheres) != 1:
        tree.refuse(
            'one caster: a sphere as collision of a link that is no wheel, which touches the '
            f'floor as the wheels do, at z = {-height_m:g} m in {tree.root}: expected',
            len(spheres),
        )
    return _part(np.zeros(3), found[0] if len(found) == 1 else joined(found), spheres[0])


def _part(origin_m: NDArray[np.float64], inertial: Inertial, shape: RoundShape) -> Part:
    return Part(
        origin_m=_vector(origin_m),
        mass_kg=inertial.mass_kg,
        mass_centre_m=_vector(inertial.centre_m),
        inertia_kg_m2=_vector(np.diagonal(inertial.inertia_kg_m2)),
        contact_m=_vector(shape.centre_m),
        contact_radius_m=shape.radius_m,
    )


def _vector(values: NDArray[np.float64]) -> Vector:
    """Return three numbers, without what rotations leave of zeros."""
    x, y, z = (round(value, _DECIMALS) + 0.0 for value in values.tolist())
    return (x, y, z)
