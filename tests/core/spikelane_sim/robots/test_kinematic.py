"""The ideal differential drive, against closed forms and numbers worked out by hand."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from numpy.typing import NDArray
import pytest

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.robots import make_robot, RobotParameters
from spikelane_sim.robots.kinematic import Kinematic

PARAMETERS = RobotParameters(engine='kinematic')
VELOCITIES = st.floats(-12.3, 12.3)


def drive(robot: Kinematic, wheels: WheelVelocities, steps: int) -> NDArray[np.float64]:
    """Return the last pose after some steps with the same velocities."""
    poses = np.concatenate([robot.step(wheels) for _ in range(steps)])
    return np.array(poses[-1])


def test_a_straight_metre_takes_the_wheels_a_known_angle() -> None:
    """1 rad/s for 20 s at a radius of 0.0975 m is 1.95 m."""
    pose = drive(Kinematic(PARAMETERS), WheelVelocities(1.0, 1.0), 400)
    np.testing.assert_allclose(pose, [1.95, 0, 0.13879, 0, 0, 0, 1], atol=1e-12)


def test_equal_and_opposite_wheels_turn_about_the_axle() -> None:
    """After half a turn base_link is as far before the axle's old place as it was behind."""
    rate = 2.0 * 0.0975 / 0.331 * 1.0
    velocity = math.pi / (rate * 0.05 * 100)
    pose = drive(Kinematic(PARAMETERS), WheelVelocities(-velocity, velocity), 100)
    np.testing.assert_allclose(pose, [0.089, 0, 0.13879, 0, 0, 1, 0], atol=1e-12)


def test_one_standing_wheel_is_the_centre_of_the_circle() -> None:
    """With the left wheel at rest a quarter turn takes base_link round (0.0445, 0.1655)."""
    velocity = math.pi / 2 * 0.331 / 0.0975 / 5.0
    pose = drive(Kinematic(PARAMETERS), WheelVelocities(0.0, velocity), 100)
    half = math.sqrt(0.5)
    expected = [0.0445 + 0.1655, 0.1655 - 0.0445, 0.13879, 0, 0, half, half]
    np.testing.assert_allclose(pose, expected, atol=1e-12)


def test_left_and_right_are_not_mixed_up() -> None:
    """A faster right wheel turns the robot to the left, towards positive y and heading."""
    robot = Kinematic(PARAMETERS)
    pose = drive(robot, WheelVelocities(1.0, 1.5), 20)
    assert pose[1] > 0
    assert pose[5] > 0
    assert robot.state.angular[2] == pytest.approx(0.5 * 0.0975 / 0.331)


def test_reset_places_the_robot_where_it_is_told() -> None:
    """The start of the inner lane, looking along negative y."""
    robot = Kinematic(PARAMETERS)
    robot.step(WheelVelocities(1.0, -3.0))
    robot.reset(9.25, 7.0, 1.5 * math.pi)
    state = robot.state
    assert state.position == (9.25, 7.0, 0.13879)
    assert state.orientation == pytest.approx((0, 0, math.sqrt(0.5), -math.sqrt(0.5)))
    assert state.wheel_velocities == state.wheel_angles == (0.0, 0.0)
    pose = robot.step(WheelVelocities(2.0, 2.0))[-1]
    assert pose[:2] == pytest.approx([9.25, 7.0 - 2 * 0.0975 * 0.05])


@given(left=VELOCITIES, right=VELOCITIES, count=st.integers(1, 20))
def test_poses_within_a_step_lie_on_the_arc_of_one_long_step(
    left: float, right: float, count: int
) -> None:
    """However finely a step is looked at, it is the same arc, at equal times."""
    wheels = WheelVelocities(left, right)
    fine = Kinematic(PARAMETERS, count)
    fine.reset(1.0, -2.0, 0.7)
    poses = fine.step(wheels)
    coarse = Kinematic(PARAMETERS)
    for row in range(count):
        # A robot whose wheels turn slower by a fraction is as far after a step as a fast one
        # after that fraction of it.
        coarse.reset(1.0, -2.0, 0.7)
        part = (row + 1) / count
        expected = coarse.step(WheelVelocities(left * part, right * part))[-1]
        np.testing.assert_allclose(poses[row], expected, atol=1e-12)


@given(left=VELOCITIES, right=VELOCITIES, steps=st.integers(1, 50))
def test_many_steps_compose_to_one_arc(left: float, right: float, steps: int) -> None:
    """The axle's middle ends where the circle of constant radius leads."""
    robot = Kinematic(PARAMETERS)
    x, y = drive(robot, WheelVelocities(left, right), steps)[:2]
    time_s = 0.05 * steps
    turn = (right - left) * 0.0975 / 0.331
    forward = (left + right) * 0.0975 / 2
    angle = turn * time_s
    if abs(angle) > 1e-3:
        radius = forward / turn
        axle = complex(0.0445, radius) - 1j * radius * np.exp(1j * angle)
    else:
        axle = 0.0445 + forward * time_s * np.exp(0.5j * angle)
    body = axle - 0.0445 * np.exp(1j * angle)
    assert abs(complex(x, y) - body) < 1e-6 * abs(forward * time_s) + 1e-10


@given(left=VELOCITIES, right=VELOCITIES)
def test_the_state_s_velocity_is_the_derivative_of_the_pose(left: float, right: float) -> None:
    """Checked by the difference over a hundredth of a step, in base_link's own frame."""
    robot = Kinematic(PARAMETERS, 100)
    first, *_ = robot.step(WheelVelocities(left, right))
    forward, sideways, _ = robot.state.linear
    np.testing.assert_allclose(
        first[:2] / 0.0005, [forward, sideways], atol=0.001 * (1 + abs(left) + abs(right))
    )


def test_the_state_is_the_last_pose() -> None:
    """Position, orientation and the wheels' angles after three steps."""
    robot = Kinematic(PARAMETERS, 4)
    pose = drive(robot, WheelVelocities(2.0, -1.0), 3)
    state = robot.state
    assert state.position == tuple(pose[:3])
    assert state.orientation == pytest.approx(pose[3:], abs=1e-15)
    assert state.wheel_angles == pytest.approx((0.3, -0.15))
    assert state.wheel_velocities == (2.0, -1.0)


def test_no_poses_are_refused() -> None:
    """One line says what was expected."""
    with pytest.raises(ParameterError, match='poses_per_step: expected at least 1, got 0'):
        make_robot(PARAMETERS, 0)
