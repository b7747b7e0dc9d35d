"""Which robot: all that is known of a differential drive but what moves it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple


class RobotModel(NamedTuple):
    """A robot, registered under a name as an entry point of the group `spikelane.robots`.

    Attributes:
        title: Its name for people.
        entity: Its name in the services of simulation_interfaces.
        urdf: Its description, which ROS publishes as `robot_description`, and out of which
            engines take masses, inertias and contacts (`description.read_description`). Joints
            and frames have the names that `pioneer.urdf` has: `left_wheel_joint`,
            `right_wheel_joint`, `base_link`, `event_camera_optical_frame`. See docs/robots.md.
        drive: Values of parameters `robot.<name>`, where they are not the defaults.
        camera: Values of parameters `camera.<name>`, where they are not the defaults: above all
            where the camera is mounted.
    """

    title: str
    entity: str
    urdf: Path
    drive: Mapping[str, Any] = {}
    camera: Mapping[str, Any] = {}
