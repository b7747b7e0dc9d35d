"""A robot of one's own: all that a URDF file says of a differential drive with a camera."""

from __future__ import annotations

import math
from pathlib import Path

from spikelane_sim.frame_names import CAMERA_FRAME, WHEEL_JOINTS
from spikelane_sim.robots.description import read_description
from spikelane_sim.robots.model import RobotModel
from spikelane_sim.robots.urdf import read_tree, UrdfTree

#: A value of `robot.model` that ends so is the path of a file.
ENDING = '.urdf'
#: A geared motor is felt at its wheel as so many times the wheel's own inertia: that is about the
#: ratio of both of our robots.
_ROTOR_TO_WHEEL = 4.0
_ALONG = 0.9999
_DECIMALS = 9


def read_model(urdf: Path) -> RobotModel:
    """Return the robot that a URDF describes.

    Its size is that of the wheels, its limits those of the joint of the left wheel, and its
    camera is where the link `event_camera_optical_frame` is.

    Raises:
        ParameterError: The file cannot be read, or lacks something; see docs/robots.md.
    """
    tree = read_tree(urdf)
    _, left, right = read_description(urdf)
    joint = WHEEL_JOINTS[0]
    return RobotModel(
        title=tree.name or urdf.stem,
        entity=tree.name or urdf.stem,
        urdf=urdf,
        drive={
            'wheel_radius_m': left.contact_radius_m,
            'track_m': round(left.origin_m[1] - right.origin_m[1], _DECIMALS),
            'axle_x_m': left.origin_m[0],
            'height_m': round(left.contact_radius_m - left.origin_m[2], _DECIMALS),
            'max_wheel_velocity_rad_s': tree.limit(joint, 'velocity'),
            'wheel_torque_n_m': tree.limit(joint, 'effort'),
            'rotor_inertia_kg_m2': round(_ROTOR_TO_WHEEL * left.inertia_kg_m2[1], 12),
        },
        camera=_mount(tree),
    )


def _mount(tree: UrdfTree) -> dict[str, float]:
    """Return where the camera is, as parameters `camera.<name>`."""
    if not tree.has_link(CAMERA_FRAME):
        tree.refuse(
            f'expected a link {CAMERA_FRAME}, whose z points where the camera looks and whose x '
            'points to the right of the image',
            'none',
        )
    turned, place = tree.pose(CAMERA_FRAME)
    if turned[1, 0] > -_ALONG:
        tree.refuse(
            f'link {CAMERA_FRAME}: expected x to the right of the robot, as the camera may only '
            'be pitched',
            f'x along {turned[:, 0].round(6).tolist()}',
        )
    x, _, z = turned[:, 2].tolist()
    pitch_deg = math.degrees(math.atan2(-z, x))
    x_m, y_m, z_m = (round(value, _DECIMALS) + 0.0 for value in place.tolist())
    return {'x_m': x_m, 'y_m': y_m, 'z_m': z_m, 'pitch_deg': round(pitch_deg, _DECIMALS)}
