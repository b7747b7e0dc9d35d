"""The robots' URDFs: proper trees, real masses, and no contradiction to the parameters."""

import math
from xml.etree import ElementTree

import numpy as np
import pytest

from spikelane_sim.robots.description import read_description
from spikelane_sim.robots.registry import robot_model, robot_models
from spikelane_sim.simulator_parameters import SimulatorParameters

ROBOTS = tuple(robot_models())
every_robot = pytest.mark.parametrize('name', ROBOTS)


def urdf(name: str) -> ElementTree.Element:
    """Return the description of a robot."""
    return ElementTree.parse(robot_model(name).urdf).getroot()


def numbers(robot: ElementTree.Element, path: str, attribute: str = 'xyz') -> list[float]:
    """Return the numbers of an attribute of an element."""
    element = robot.find(path)
    assert element is not None
    return [float(number) for number in element.attrib[attribute].split()]


def test_there_are_two_robots() -> None:
    """The paper's, and one of today."""
    assert ROBOTS == ('p3dx', 'turtlebot4')


@every_robot
def test_links_and_joints_make_one_tree_rooted_in_base_link(name: str) -> None:
    """Every link but base_link is some joint's child, once."""
    robot = urdf(name)
    links = [link.attrib['name'] for link in robot.findall('link')]
    children = [child.attrib['link'] for child in robot.findall('joint/child')]
    parents = {parent.attrib['link'] for parent in robot.findall('joint/parent')}
    assert sorted(children + ['base_link']) == sorted(links)
    assert parents <= set(links)


@every_robot
def test_the_frames_that_others_rely_on_are_there(name: str) -> None:
    """Names of links and joints on /tf and joint_states."""
    robot = urdf(name)
    joints = {joint.attrib['name']: joint.attrib['type'] for joint in robot.findall('joint')}
    assert joints['left_wheel_joint'] == joints['right_wheel_joint'] == 'continuous'
    links = {link.attrib['name'] for link in robot.findall('link')}
    assert {'base_link', 'event_camera_link', 'event_camera_optical_frame'} <= links


@every_robot
def test_viewers_need_no_other_file(name: str) -> None:
    """Simple shapes only, each of a colour that is defined."""
    robot = urdf(name)
    assert robot.find('.//mesh') is None
    defined = {material.attrib['name'] for material in robot.findall('material')}
    used = [material.attrib['name'] for material in robot.findall('link/visual/material')]
    assert used
    assert set(used) <= defined


@every_robot
def test_the_camera_is_where_the_camera_s_parameters_have_it(name: str) -> None:
    """Place and pitch, which the renderer takes from CameraParameters."""
    robot = urdf(name)
    camera = SimulatorParameters.from_mapping({'robot.model': name}).camera
    place = numbers(robot, "joint[@name='event_camera_joint']/origin")
    assert place == [camera.x_m, camera.y_m, camera.z_m]
    rpy = numbers(robot, "joint[@name='event_camera_joint']/origin", 'rpy')
    assert rpy == pytest.approx([0, math.radians(camera.pitch_deg), 0])


@every_robot
def test_the_optical_frame_looks_along_the_camera_s_x_axis(name: str) -> None:
    """REP 103: z forward, x to the right, y down."""
    robot = urdf(name)
    roll, pitch, yaw = numbers(robot, "joint[@name='event_camera_optical_joint']/origin", 'rpy')
    cosine, sine = math.cos(roll), math.sin(roll)
    about_x = [[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]]
    cosine, sine = math.cos(yaw), math.sin(yaw)
    about_z = [[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]
    assert pitch == 0
    turned = np.array(about_z) @ np.array(about_x)
    np.testing.assert_allclose(turned, [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)


@every_robot
def test_the_wheels_are_where_the_robots_parameters_have_them(name: str) -> None:
    """Radius, track and axle; and wheels and caster reach down to the floor at rest."""
    parameters = SimulatorParameters.from_mapping({'robot.model': name}).robot
    base, left, right = read_description(robot_model(name).urdf)
    assert left.contact_radius_m == right.contact_radius_m == parameters.wheel_radius_m
    assert left.origin_m[1] - right.origin_m[1] == pytest.approx(parameters.track_m, abs=1e-12)
    assert left.origin_m[0] == right.origin_m[0] == parameters.axle_x_m
    for part in (base, left, right):
        lowest = part.origin_m[2] + part.contact_m[2] - part.contact_radius_m
        assert parameters.height_m + lowest == pytest.approx(0, abs=1.1e-5)


def test_the_pioneers_wheels_are_those_of_the_papers_scene() -> None:
    """In base_link."""
    _, left, right = read_description(robot_model('p3dx').urdf)
    assert (left.origin_m, left.contact_radius_m) == ((0.0445, 0.1655, -0.0413), 0.0975)
    assert right.origin_m == (0.0445, -0.1655, -0.0413)


def test_the_turtlebots_wheels_are_those_of_its_base() -> None:
    """Radius 0.03575 m, 0.233 m apart; at most 0.306 m/s."""
    robot = SimulatorParameters.from_mapping({'robot.model': 'turtlebot4'}).robot
    assert (robot.wheel_radius_m, robot.track_m) == (0.03575, 0.233)
    assert robot.max_wheel_velocity_rad_s * 0.03575 == pytest.approx(0.306, abs=1e-3)


@pytest.mark.parametrize(('name', 'mass_kg'), [('p3dx', 9.0), ('turtlebot4', 3.945)])
def test_the_robot_has_its_weight_and_stands_firmly(name: str, mass_kg: float) -> None:
    """The centre of mass lies between caster and axle."""
    base, left, right = read_description(robot_model(name).urdf)
    assert base.mass_kg + left.mass_kg + right.mass_kg == pytest.approx(mass_kg)
    ends = sorted((base.contact_m[0], left.origin_m[0]))
    assert ends[0] < base.mass_centre_m[0] < ends[1]


def test_inertias_are_those_of_the_shapes_named_in_the_file() -> None:
    """A box of 0.43 x 0.27 x 0.177 m and 8 kg, cylinders of 0.0975 x 0.04 m and 0.5 kg."""
    base, left, right = read_description(robot_model('p3dx').urdf)
    box = [
        8 / 12 * (0.27**2 + 0.177**2),
        8 / 12 * (0.43**2 + 0.177**2),
        8 / 12 * (0.43**2 + 0.27**2),
    ]
    assert base.inertia_kg_m2 == pytest.approx(box, rel=1e-3)
    across = 0.5 / 12 * (3 * 0.0975**2 + 0.04**2)
    cylinder = [across, 0.5 / 2 * 0.0975**2, across]
    assert left.inertia_kg_m2 == right.inertia_kg_m2 == pytest.approx(cylinder, rel=1e-3)


def test_the_turtlebots_inertias_are_those_of_cylinders() -> None:
    """They have 0.164 x 0.19 m and 3.545 kg, and 0.03575 x 0.015 m and 0.2 kg."""
    base, left, right = read_description(robot_model('turtlebot4').urdf)
    across = 3.545 / 12 * (3 * 0.164**2 + 0.19**2)
    assert base.inertia_kg_m2 == pytest.approx([across, across, 3.545 / 2 * 0.164**2], rel=1e-3)
    across = 0.2 / 12 * (3 * 0.03575**2 + 0.015**2)
    cylinder = [across, 0.2 / 2 * 0.03575**2, across]
    assert left.inertia_kg_m2 == right.inertia_kg_m2 == pytest.approx(cylinder, rel=1e-3)
