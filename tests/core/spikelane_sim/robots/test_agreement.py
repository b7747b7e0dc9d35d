"""How far the robot in pybullet, the rigid body and the ideal differential drive agree."""

import math

import numpy as np
import pytest

from spikelane_sim.contract import Robot, WheelVelocities
from spikelane_sim.course import load_course
from spikelane_sim.episode_rules import advance
from spikelane_sim.robots import make_robot, RobotParameters
from spikelane_sim.robots.bullet_drive import BulletDrive

COURSE = load_course('scenario_1')


def steady_motion(robot: Robot, wheels: WheelVelocities) -> tuple[float, float]:
    """Return the axle's speed [m/s] and the turning rate [rad/s] over 2 s, once settled."""
    robot.reset(0.0, 0.0, 0.0)
    poses = np.concatenate([robot.step(wheels) for _ in range(80)])[39:]
    heading = np.unwrap(2 * np.arctan2(poses[:, 5], poses[:, 6]))
    axle = poses[:, 0] + 1j * poses[:, 1] + 0.0445 * np.exp(1j * heading)
    middle = (heading[1:] + heading[:-1]) / 2
    forward = (np.diff(axle) * np.exp(-1j * middle)).real
    return float(forward.mean() / 0.05), float((heading[-1] - heading[0]) / 2.0)


@pytest.mark.parametrize('forward', [0.5, 1.0, 1.5, 2.5])
@pytest.mark.parametrize('difference', [-1.0, -0.25, 0.0, 0.25, 1.0])
def test_steady_driving_in_the_paper_s_range(forward: float, difference: float) -> None:
    """Speed and turning rate within 0.1 % of the ideal; the issue asks for 1 % and 5 %."""
    wheels = WheelVelocities(forward - difference / 2, forward + difference / 2)
    speed, turn = steady_motion(BulletDrive(RobotParameters()), wheels)
    assert speed == pytest.approx(forward * 0.0975, rel=1e-3)
    assert turn == pytest.approx(difference * 0.0975 / 0.331, rel=1e-3, abs=1e-5)


@pytest.mark.parametrize('velocity', [-6.0, -1.0, -0.05, 0.05, 0.5, 6.0])
def test_turning_on_the_spot(velocity: float) -> None:
    """Within 0.1 %, the axle staying in place to 0.5 % of the wheels' speed."""
    speed, turn = steady_motion(
        BulletDrive(RobotParameters()), WheelVelocities(-velocity, velocity)
    )
    assert speed == pytest.approx(0.0, abs=0.005 * abs(velocity) * 0.0975)
    assert turn == pytest.approx(2 * velocity * 0.0975 / 0.331, rel=1e-3)


@pytest.mark.parametrize(
    ('left', 'right'), [(12.3, 12.3), (-6.0, -6.0), (12.3, 8.0), (0.0, 12.3), (-2.0, -1.0)]
)
def test_steady_driving_up_to_the_fastest(left: float, right: float) -> None:
    """Speed within 1 %, turning rate within 0.1 %, even round one standing wheel at 0.6 m/s."""
    speed, turn = steady_motion(BulletDrive(RobotParameters()), WheelVelocities(left, right))
    assert speed == pytest.approx((left + right) / 2 * 0.0975, rel=0.01)
    assert turn == pytest.approx((right - left) * 0.0975 / 0.331, rel=1e-3, abs=1e-5)


def drive_lap(robot: Robot, lane: str) -> tuple[int, float]:
    """Return how many steps a simple follower takes for a lap, and its mean error [m]."""
    course = COURSE.lane(lane)
    x, y, heading = course.start.x_m, course.start.y_m, course.start.heading_rad
    robot.reset(x, y, heading)
    position, progress = COURSE.locate(lane, x, y, heading).position_m, 0.0
    errors: list[float] = []
    while progress < course.length_m and len(errors) < 9000:
        here = COURSE.locate(lane, x, y, heading)
        progress = advance(course.length_m, position, here.position_m, progress)
        position = here.position_m
        errors.append(abs(here.distance_m))
        steer = 2.0 * here.distance_m - 1.5 * here.heading_error_rad
        pose = robot.step(WheelVelocities(1.25 - steer, 1.25 + steer))[-1]
        x, y, heading = pose[0], pose[1], 2 * math.atan2(pose[5], pose[6])
    return len(errors), float(np.mean(errors))


@pytest.mark.parametrize('lane', ['outer', 'inner'])
def test_laps_take_the_same_time(lane: str) -> None:
    """Within 0.2 %, at the same mean error; the issue asks for 2 %."""
    steps, error = drive_lap(make_robot(RobotParameters()), lane)
    ideal_steps, ideal_error = drive_lap(make_robot(RobotParameters(engine='kinematic')), lane)
    assert 4000 < ideal_steps < 6000
    assert steps == pytest.approx(ideal_steps, rel=0.002)
    assert error == pytest.approx(ideal_error, abs=0.001)


@pytest.mark.parametrize('lane', ['outer', 'inner'])
def test_the_rigid_body_laps_as_physics_does(lane: str) -> None:
    """The numbers of steps differ by one at most, the mean errors by less than 0.01 mm."""
    steps, error = drive_lap(make_robot(RobotParameters()), lane)
    rigid_steps, rigid_error = drive_lap(make_robot(RobotParameters(engine='rigid')), lane)
    assert 4000 < steps < 6000
    assert rigid_steps == pytest.approx(steps, abs=1)
    assert rigid_error == pytest.approx(error, abs=1e-5)
