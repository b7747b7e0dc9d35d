"""The robot's URDF: a proper tree, real masses, and no contradiction to the parameters."""

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from spikelane_sim.camera import CameraParameters
from spikelane_sim.robots import RobotParameters
from spikelane_sim.robots.description import read_description
from spikelane_sim.robots.p3dx import P3DX

ROBOT = ElementTree.parse(P3DX.urdf).getroot()


def numbers(path: str, attribute: str = 'xyz') -> list[float]:
    """Return the numbers of an attribute of an element."""
    element = ROBOT.find(path)
    assert element is not None
    return [float(number) for number in element.attrib[attribute].split()]


def test_links_and_joints_make_one_tree_rooted_in_base_link() -> None:
    """Every link but base_link is some joint's child, once."""
    links = [link.attrib['name'] for link in ROBOT.findall('link')]
    children = [child.attrib['link'] for child in ROBOT.findall('joint/child')]
    parents = {parent.attrib['link'] for parent in ROBOT.findall('joint/parent')}
    assert sorted(children + ['base_link']) == sorted(links)
    assert parents <= set(links)


def test_the_frames_that_others_rely_on_are_there() -> None:
    """Names of links and joints on /tf and joint_states."""
    joints = {joint.attrib['name']: joint.attrib['type'] for joint in ROBOT.findall('joint')}
    assert joints['left_wheel_joint'] == joints['right_wheel_joint'] == 'continuous'
    links = {link.attrib['name'] for link in ROBOT.findall('link')}
    assert {'base_link', 'event_camera_link', 'event_camera_optical_frame'} <= links


def test_viewers_need_no_other_file() -> None:
    """Simple shapes only, each of a colour that is defined."""
    assert ROBOT.find('.//mesh') is None
    defined = {material.attrib['name'] for material in ROBOT.findall('material')}
    used = [material.attrib['name'] for material in ROBOT.findall('link/visual/material')]
    assert used
    assert set(used) <= defined


def test_the_camera_is_where_the_camera_s_parameters_have_it() -> None:
    """Place and pitch, which the renderer takes from CameraParameters."""
    camera = CameraParameters()
    place = numbers("joint[@name='event_camera_joint']/origin")
    assert place == [camera.x_m, camera.y_m, camera.z_m]
    rpy = numbers("joint[@name='event_camera_joint']/origin", 'rpy')
    assert rpy == pytest.approx([0, math.radians(camera.pitch_deg), 0])


def test_the_optical_frame_looks_along_the_camera_s_x_axis() -> None:
    """REP 103: z forward, x to the right, y down."""
    roll, pitch, yaw = numbers("joint[@name='event_camera_optical_joint']/origin", 'rpy')
    cosine, sine = math.cos(roll), math.sin(roll)
    about_x = [[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]]
    cosine, sine = math.cos(yaw), math.sin(yaw)
    about_z = [[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]
    assert pitch == 0
    turned = np.array(about_z) @ np.array(about_x)
    np.testing.assert_allclose(turned, [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)


def test_the_wheels_are_where_the_robot_s_parameters_have_them() -> None:
    """Radius, track and axle; and the wheels reach down to the floor at rest."""
    parameters = RobotParameters()
    base, left, right = read_description(P3DX.urdf)
    assert left.origin_m == (0.0445, 0.1655, -0.0413)
    assert right.origin_m == (0.0445, -0.1655, -0.0413)
    assert left.contact_radius_m == right.contact_radius_m == parameters.wheel_radius_m == 0.0975
    assert parameters.track_m == pytest.approx(0.331)
    for part in (base, left, right):
        lowest = part.origin_m[2] + part.contact_m[2] - part.contact_radius_m
        assert parameters.height_m + lowest == pytest.approx(0, abs=1.1e-5)


def test_the_robot_weighs_nine_kilograms_and_stands_firmly() -> None:
    """The centre of mass lies between caster and axle."""
    base, left, right = read_description(P3DX.urdf)
    assert base.mass_kg + left.mass_kg + right.mass_kg == pytest.approx(9.0)
    assert base.contact_m[0] < base.mass_centre_m[0] < left.origin_m[0]


def test_inertias_are_those_of_the_shapes_named_in_the_file() -> None:
    """A box of 0.43 x 0.27 x 0.177 m and 8 kg, cylinders of 0.0975 x 0.04 m and 0.5 kg."""
    base, left, right = read_description(P3DX.urdf)
    box = [
        8 / 12 * (0.27**2 + 0.177**2),
        8 / 12 * (0.43**2 + 0.177**2),
        8 / 12 * (0.43**2 + 0.27**2),
    ]
    assert base.inertia_kg_m2 == pytest.approx(box, rel=1e-3)
    across = 0.5 / 12 * (3 * 0.0975**2 + 0.04**2)
    cylinder = [across, 0.5 / 2 * 0.0975**2, across]
    assert left.inertia_kg_m2 == right.inertia_kg_m2 == pytest.approx(cylinder, rel=1e-3)


def test_the_urdf_is_installed_with_the_package() -> None:
    """setup.py names it, and it lies beside the module."""
    assert P3DX.urdf.is_file()
    setup = Path(__file__).parents[3] / 'sim_bridge' / 'setup.py'
    assert "'robots/*.urdf'" in setup.read_text(encoding='utf-8')
