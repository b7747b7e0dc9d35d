"""A robot that only a URDF describes: its values, its drives with all engines, what is refused."""

from __future__ import annotations

from collections.abc import Callable
import hashlib
import math
from pathlib import Path
import re

import numpy as np
from numpy.typing import NDArray
import pytest

from spikelane.runs.configuration import Request
from spikelane.runs.input_files import input_digests
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.metrics import lap_metrics
from spikelane.runs.lap.run import drive_lap
from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.robots import make_robot, RobotParameters
from spikelane_sim.robots.description import read_description
from spikelane_sim.robots.registry import robot_model
from spikelane_sim.simulator_parameters import SimulatorParameters

SMALL = Path(__file__).parents[4] / 'docs/examples/robot/small.urdf'
ENGINES = ('pybullet', 'rigid', 'kinematic')


def given(urdf: Path = SMALL, **values: object) -> dict[str, object]:
    """Return parameters with a URDF as the robot."""
    return {'robot.model': str(urdf), **{f'robot.{name}': each for name, each in values.items()}}


def test_its_size_limits_and_camera_are_those_of_the_file() -> None:
    """Whatever frames the links have; a value that is given counts more."""
    parameters = SimulatorParameters.from_mapping(given(wheel_torque_n_m=0.01))
    robot, camera = parameters.robot, parameters.camera
    assert (robot.wheel_radius_m, robot.track_m, robot.axle_x_m) == (0.033, 0.16, 0.0)
    assert (robot.height_m, robot.max_wheel_velocity_rad_s) == (0.01, 6.7)
    assert robot.wheel_torque_n_m == 0.01
    assert robot.rotor_inertia_kg_m2 == pytest.approx(4 * 0.00001634, rel=1e-12)
    assert (camera.x_m, camera.y_m, camera.z_m) == (0.05, 0.0, 0.2458)
    assert camera.pitch_deg == 30.0
    model = robot_model(str(SMALL))
    assert (model.title, model.entity) == ('small', 'small')


def test_what_is_fixed_to_the_base_is_one_part_with_it() -> None:
    """Masses add up, moments about the common centre by the parallel axis theorem."""
    base, left, right = read_description(SMALL)
    assert base.mass_kg == pytest.approx(0.8 + 0.14)
    x_m, z_m = -0.8 * 0.032 / 0.94, (0.8 * 0.05 + 0.14 * 0.13) / 0.94
    assert base.mass_centre_m == pytest.approx((x_m, 0.0, z_m))
    box = 0.8 * np.square((-0.032 - x_m, 0.05 - z_m))
    mast = 0.14 * np.square((-x_m, 0.13 - z_m))
    forward, up = box + mast
    own = (0.001973 + 0.000672, 0.001973 + 0.000672, 0.002613 + 0.000005)
    expected = (own[0] + up, own[1] + up + forward, own[2] + forward)
    assert base.inertia_kg_m2 == pytest.approx(expected, rel=1e-6)
    assert (base.contact_m, base.contact_radius_m) == ((-0.081, 0.0, 0.0), 0.01)
    assert left.origin_m == (0.0, 0.08, 0.023)
    assert right.origin_m == (0.0, -0.08, 0.023)
    # The cylinders lie along y, though they are described along z.
    assert left.inertia_kg_m2 == right.inertia_kg_m2 == (0.000008978, 0.00001634, 0.000008978)


def path_of(engine: str) -> NDArray[np.float64]:
    """Return where the robot is after each of 1,000 steps, (1000, 2)."""
    robot = make_robot(RobotParameters.from_mapping({'model': str(SMALL), 'engine': engine}))
    rng = np.random.default_rng(1)
    wheels = [WheelVelocities(*rng.uniform(0.5, 2.5, 2)) for _ in range(100)]
    path = [robot.step(each)[-1, :2] for each in wheels for _ in range(10)]
    robot.close()
    return np.array(path)


def test_the_engines_agree_as_the_page_says() -> None:
    """Over 2.5 m, with a new command each 0.5 s, in parts of the path."""
    physics, rigid, ideal = map(path_of, ENGINES)
    length_m = np.linalg.norm(np.diff(physics, axis=0), axis=1).sum()
    assert length_m == pytest.approx(2.5, abs=0.05)
    assert np.linalg.norm(rigid - physics, axis=1).max() < 0.0005 * length_m
    assert 0.001 < np.linalg.norm(ideal - physics, axis=1).max() / length_m < 0.03


@pytest.mark.parametrize('engine', ['rigid', 'kinematic'])
def test_it_completes_a_lap(engine: str) -> None:
    """By R-STDP with the weights learnt on the Pioneer P3-DX, as it is."""
    parameters = {'simulator.robot.model': str(SMALL), 'simulator.robot.engine': engine}
    config = LapConfig.make(Request('1', 'rstdp', 0, 'inprocess', parameters), 'inner')
    measured = lap_metrics(drive_lap(config, lambda *_: None).trajectory, 0.05)
    assert measured['completed']
    assert measured['mean_abs_distance_m'] < 0.02
    digest = hashlib.sha256(SMALL.read_bytes()).hexdigest()
    assert input_digests(config.to_dict())[str(SMALL)] == digest


@pytest.fixture
def changed(tmp_path: Path) -> Callable[[str, str], Path]:
    """Give what writes the file with a change: a pattern, and what stands for it."""

    def change(pattern: str, text: str) -> Path:
        new, count = re.subn(pattern, text, SMALL.read_text('utf-8'), flags=re.S)
        assert count
        file = tmp_path / 'odd.urdf'
        file.write_text(new, encoding='utf-8')
        return file

    return change


@pytest.mark.parametrize(
    ('pattern', 'text', 'error'),
    [
        (
            '"left_wheel_joint"',
            '"wheel_left_joint"',
            'expected a joint left_wheel_joint, got base',
        ),
        ('child link="right_wheel"', 'child link="tyre"', "that is a link, got 'tyre'"),
        ('<axis xyz="0 0 1"/>', '', 'left_wheel_joint: expected an axis along y of base_link'),
        ('<limit.*?/>', '', 'joint left_wheel_joint: expected a limit with effort and velocity'),
        ('effort="0.017" ', '', 'joint left_wheel_joint: expected a limit with effort and velo'),
        ('<cylinder radius="0.033"[^>]*/>', '<mesh/>', 'link left_wheel: expected a mass with in'),
        ('<cylinder radius="0.033"', '<cylinder radius="big"', "a number as radius, got 'big'"),
        ('<sphere radius="0.01"', '<sphere radius="0.008"', 'one caster: a sphere as collision'),
        ('event_camera_optical_frame', 'camera', 'expected a link event_camera_optical_frame'),
        ('rpy="-1.57\\S* 0 -1.57\\S*"', '', 'expected x to the right of the robot'),
        ('"base_link"', '"body"', 'expected a link base_link, got base_footprint, body'),
        ('</robot>', '', 'expected a URDF, got no XML'),
    ],
)
@pytest.mark.parametrize('engine', ENGINES)
def test_a_file_that_lacks_something_is_refused_in_one_sentence(
    changed: Callable[[str, str], Path], pattern: str, text: str, error: str, engine: str
) -> None:
    """With every engine alike, and with the file's name."""
    file = changed(pattern, text)
    with pytest.raises(ParameterError, match=re.escape(error)) as caught:
        SimulatorParameters.from_mapping(given(file, engine=engine))
    assert 'odd.urdf: ' in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_file_that_is_not_there_is_refused() -> None:
    """As is a name that is no robot's."""
    with pytest.raises(ParameterError, match=r'none\.urdf: expected a URDF, got No such file'):
        SimulatorParameters.from_mapping(given(Path('none.urdf')))
    expected = r'robot\.model: expected one of p3dx, turtlebot4, or the path of a \.urdf file'
    with pytest.raises(ParameterError, match=expected):
        SimulatorParameters.from_mapping({'robot.model': 'burger'})


def test_a_camera_that_looks_down_steeper_is_taken_as_it_is(
    changed: Callable[[str, str], Path],
) -> None:
    """Its pitch is the angle below the horizon."""
    file = changed('0.5235987755982988', str(math.radians(45)))
    assert SimulatorParameters.from_mapping(given(file)).camera.pitch_deg == 45.0
