"""A robot of another size than its URDF's: the URDF with the size that the parameters have.

Masses stay. Wheels of another radius have the inertia of wheels of the same mass and shape, so it
is scaled by the square of the radius. The caster goes down or up with the height of `base_link`
so that it touches the floor, and keeps its radius. What is drawn of other links stays.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from spikelane_sim.errors import ParameterError
from spikelane_sim.frame_names import WHEEL_JOINTS
from spikelane_sim.robots.description import Description, read_description
from spikelane_sim.robots.registry import robot_model
from spikelane_sim.robots.urdf import read_tree, UrdfTree

if TYPE_CHECKING:
    from spikelane_sim.robots import RobotParameters

# Closer values are the same size: radius, track and axle, and the height of base_link, which may
# be off the height at which the wheels just touch the floor. As the height of the P3-DX is by
# default, its wheels stand 0.01 mm deep in the floor, the depth that Bullet leaves alone.
_TOLERANCE_M = 1e-9
_HEIGHT_TOLERANCE_M = 1e-4
_REST_DEPTH_M = 1e-5
_DECIMALS = 12
#: Elements of a wheel whose radius is scaled.
_ROUND = ('sphere', 'cylinder')
_SIZE = ('wheel_radius_m', 'track_m', 'axle_x_m', 'height_m')


class _Size(NamedTuple):
    """Where the wheels are in base_link, and how large they are."""

    radius_m: float
    track_m: float
    axle_x_m: float
    floor_m: float  # depth of the floor below base_link


def describe(parameters: RobotParameters) -> Description:
    """Return the parts of the robot, of the size that the parameters have.

    Raises:
        ParameterError: The URDF lacks what the physics needs, or the robot would tip over.
    """
    return _sized(parameters)[1]


def sized_urdf(parameters: RobotParameters) -> str:
    """Return the robot's URDF, with the size that the parameters have.

    Raises:
        ParameterError: As in `describe`, where the size is not the robot's own.
    """
    model = type(parameters).from_mapping({'model': parameters.model})
    if all(getattr(parameters, name) == getattr(model, name) for name in _SIZE):
        return robot_model(parameters.model).urdf.read_text(encoding='utf-8')
    return _sized(parameters)[0].text()


def _sized(parameters: RobotParameters) -> tuple[UrdfTree, Description]:
    urdf = robot_model(parameters.model).urdf
    tree = read_tree(urdf)
    description = read_description(tree)
    old, new = _described(description), _wanted(parameters)
    if abs(parameters.height_m - old.floor_m) <= _HEIGHT_TOLERANCE_M:
        new = new._replace(floor_m=old.floor_m)
    pairs = list(zip(old, new, strict=True))
    if all(abs(before - after) <= _TOLERANCE_M for before, after in pairs):
        return tree, description
    _resize(tree, description, new)
    tree = tree.read_again()
    description = read_description(tree)
    _check_stance(new, description, urdf.name)
    return tree, description


def _described(description: Description) -> _Size:
    _, left, right = description
    return _Size(
        left.contact_radius_m,
        left.origin_m[1] - right.origin_m[1],
        left.origin_m[0],
        left.contact_radius_m - left.origin_m[2],
    )


def _wanted(parameters: RobotParameters) -> _Size:
    return _Size(
        parameters.wheel_radius_m,
        parameters.track_m,
        parameters.axle_x_m,
        parameters.height_m + _REST_DEPTH_M,
    )


def _resize(tree: UrdfTree, description: Description, new: _Size) -> None:
    """Move the wheels' joints and the caster, and scale the wheels."""
    old = _described(description)
    for joint, side in zip(WHEEL_JOINTS, (0.5, -0.5), strict=True):
        place = (new.axle_x_m, side * new.track_m, new.radius_m - new.floor_m)
        tree.place_joint(joint, np.round(place, _DECIMALS))
        _scale(tree.link(tree.child_of(joint)), new.radius_m / old.radius_m)
    down_m = np.array([0.0, 0.0, old.floor_m - new.floor_m])
    for link, collision in _casters(tree, description):
        tree.move(link, collision, down_m)


def _scale(wheel: ElementTree.Element, ratio: float) -> None:
    for shape in wheel.iter():
        if shape.tag in _ROUND and 'radius' in shape.attrib:
            shape.set('radius', repr(round(float(shape.attrib['radius']) * ratio, _DECIMALS)))
        elif shape.tag == 'inertia':
            for name, value in shape.items():
                shape.set(name, repr(float(value) * ratio**2))


def _casters(
    tree: UrdfTree, description: Description
) -> Iterator[tuple[str, ElementTree.Element]]:
    """Yield the links and collisions that are the caster's sphere."""
    caster = np.array(description.base.contact_m)
    for link in tree.links_without(WHEEL_JOINTS):
        for collision in tree.link(link).iterfind('collision'):
            shapes = tree.shapes_of(collision, tree.pose(link))
            if any(np.allclose(each.centre_m, caster, atol=1e-9) for each in shapes):
                yield link, collision


def _check_stance(size: _Size, description: Description, urdf: str) -> None:
    """Refuse a robot whose mass centre is not above the ground between axle and caster.

    Raises:
        ParameterError: It would tip over.
    """
    moment = sum(part.mass_kg * (part.origin_m[0] + part.mass_centre_m[0]) for part in description)
    centre_m = moment / sum(part.mass_kg for part in description)
    caster_m = description.base.contact_m[0]
    low, high = sorted((size.axle_x_m, caster_m))
    if not low < centre_m < high:
        raise ParameterError(
            f'axle_x_m: expected the mass centre of {urdf}, at x = {centre_m:.4g} m, between the '
            f'axle and the caster at x = {caster_m:.4g} m, got the axle at x = {size.axle_x_m:g} m'
        )
