"""A robot of another size by parameters alone: parts, drives, URDF, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
import pytest

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.robots import make_robot, RobotParameters
from spikelane_sim.robots.description import read_description
from spikelane_sim.robots.differential_drive import read_geometry
from spikelane_sim.robots.registry import robot_model
from spikelane_sim.robots.sizing import describe, sized_urdf

SMALL = str(Path(__file__).parents[4] / 'docs/examples/robot/small.urdf')
EVERYTHING = {'wheel_radius_m': 0.05, 'track_m': 0.25, 'axle_x_m': 0.06, 'height_m': 0.08}
SIZES = [
    {'wheel_radius_m': 0.06},
    {'track_m': 0.5},
    EVERYTHING,
    {'model': 'turtlebot4', 'track_m': 0.3, 'wheel_radius_m': 0.05},
    {'model': SMALL, 'wheel_radius_m': 0.04, 'track_m': 0.2, 'height_m': 0.02},
]


def made(**given: object) -> RobotParameters:
    """Return parameters of a robot."""
    return RobotParameters.from_mapping(given)


def test_without_another_size_nothing_changes() -> None:
    """The parts and the text are those of the file, to the last byte."""
    for model in ('p3dx', 'turtlebot4', SMALL):
        urdf = robot_model(model).urdf
        assert describe(made(model=model)) == read_description(urdf)
        assert sized_urdf(made(model=model, wheel_torque_n_m=0.5)) == urdf.read_text('utf-8')


def test_the_parts_have_the_size_that_is_given() -> None:
    """Wheels stand 0.01 mm deep in the floor, the caster as deep, and all masses stay."""
    base, left, right = describe(made(**EVERYTHING))
    assert left.origin_m == pytest.approx((0.06, 0.125, 0.05 - 0.08001), abs=1e-12)
    assert right.origin_m == pytest.approx((0.06, -0.125, 0.05 - 0.08001), abs=1e-12)
    assert left.contact_radius_m == right.contact_radius_m == 0.05
    # A sphere of 0.0375 m, as far back as in pioneer.urdf.
    assert base.contact_m == pytest.approx((-0.18, 0.0, 0.0375 - 0.08001), abs=1e-12)
    assert (base.mass_kg, left.mass_kg, right.mass_kg) == (8.0, 0.5, 0.5)
    # The inertia of a solid cylinder about its axis, m r^2 / 2; the file has rounded numbers.
    assert left.inertia_kg_m2[1] == pytest.approx(0.5 * 0.05**2 / 2, rel=1e-3)


def path_of(given: dict[str, object], engine: str) -> NDArray[np.float64]:
    """Return where the robot is after each of 400 steps, x and y, (400, 2)."""
    robot = make_robot(made(**given, engine=engine))
    rng = np.random.default_rng(1)
    wheels = [WheelVelocities(*rng.uniform(0.5, 2.5, 2)) for _ in range(40)]
    path = [robot.step(each)[-1, :2] for each in wheels for _ in range(10)]
    robot.close()
    return np.array(path)


@pytest.mark.parametrize('given', SIZES)
def test_the_engines_agree_on_every_size(given: dict[str, object]) -> None:
    """The rigid body to 0.2 % of the path of pybullet, the ideal drive to 6 %."""
    physics, rigid, ideal = (path_of(given, name) for name in ('pybullet', 'rigid', 'kinematic'))
    length_m = np.linalg.norm(np.diff(physics, axis=0), axis=1).sum()
    assert np.linalg.norm(rigid - physics, axis=1).max() < 0.002 * length_m
    assert np.linalg.norm(ideal - physics, axis=1).max() < 0.06 * length_m


def test_a_wider_robot_turns_more_slowly() -> None:
    """On the spot at 1 rad/s, by v = 0.0975 m/s at each wheel: 2 v / track."""
    turns = []
    for track_m in (0.331, 0.662):
        robot = make_robot(made(track_m=track_m))
        for _ in range(40):
            robot.step(WheelVelocities(-1.0, 1.0))
        turns.append(robot.state.angular[2])
        robot.close()
    assert turns == pytest.approx([2 * 0.0975 / 0.331, 2 * 0.0975 / 0.662], rel=1e-3)


@pytest.mark.parametrize('given', SIZES)
def test_the_urdf_says_the_same(given: dict[str, object], tmp_path: Path) -> None:
    """It is a robot of its own, of this size, and other nodes read the wheels out of it."""
    parameters = made(**given)
    text = sized_urdf(parameters)
    geometry = read_geometry(text, 'left_wheel_joint', 'right_wheel_joint')
    assert geometry == pytest.approx((parameters.wheel_radius_m, parameters.track_m))
    file = tmp_path / 'sized.urdf'
    file.write_text(text, encoding='utf-8')
    assert read_description(file) == describe(parameters)


@pytest.mark.parametrize('engine', ['pybullet', 'rigid'])
@pytest.mark.parametrize('axle_x_m', [-0.05, -0.3])
def test_a_robot_that_would_tip_over_is_refused(engine: str, axle_x_m: float) -> None:
    """In one sentence, which says where the axle may be; the ideal drive has no masses."""
    centre = 'axle_x_m: expected the mass centre of pioneer.urdf, at x = .* m, between the axle'
    with pytest.raises(ParameterError, match=f'^{centre}.*got the axle at x = {axle_x_m:g} m$'):
        make_robot(made(engine=engine, axle_x_m=axle_x_m))
    assert make_robot(made(engine='kinematic', axle_x_m=axle_x_m))
