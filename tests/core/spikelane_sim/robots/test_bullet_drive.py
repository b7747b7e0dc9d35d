"""The Pioneer in pybullet: rest, torque, bits, independence, release."""

import gc
import math
import subprocess
import sys

import numpy as np
from numpy.typing import NDArray
import pybullet
import pytest

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.robots import make_robot, RobotParameters
from spikelane_sim.robots.bullet_drive import BulletDrive


def wander(robot: BulletDrive, steps: int = 60, seed: int = 1) -> NDArray[np.float64]:
    """Return the poses of a drive with changing commands from a given place."""
    robot.reset(9.25, 7.0, 1.5 * math.pi)
    commands = np.random.default_rng(seed).uniform(-0.5, 2.5, (steps, 2))
    return np.concatenate([robot.step(WheelVelocities(*pair)) for pair in commands.tolist()])


def tilt_rad(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angle between the body's vertical and the world's."""
    return 2 * np.hypot(poses[:, 3], poses[:, 4])


def test_a_robot_told_to_stand_stays_where_it_was_put() -> None:
    """10 s of zero commands move it by less than 0.1 mm, from the first step on."""
    robot = BulletDrive(RobotParameters())
    robot.reset(3.0, 0.25, 0.3)
    poses = np.concatenate([robot.step(WheelVelocities(0.0, 0.0)) for _ in range(200)])
    expected = [3.0, 0.25, 0.13879, 0, 0, math.sin(0.15), math.cos(0.15)]
    np.testing.assert_allclose(poses[:, :2] - expected[:2], 0, atol=1e-4)
    np.testing.assert_allclose(poses[:, 2], 0.13879, atol=1e-6)
    np.testing.assert_allclose(poses[:, 3:] - expected[3:], 0, atol=1e-5)


def test_the_body_does_not_shake_while_driving() -> None:
    """Hard changes of speed tilt it by less than 0.001 degrees and lift it by less than 1 um."""
    poses = wander(BulletDrive(RobotParameters(), 10))
    assert np.degrees(tilt_rad(poses)).max() < 1e-3
    np.testing.assert_allclose(poses[:, 2], 0.13879, atol=1e-6)


def test_the_drive_s_torque_is_limited() -> None:
    """From rest it accelerates as Newton's law says for 9 kg and four rotating masses.

    Both wheels push with 1 N m / 0.0975 m; each wheel and its rotor (0.002377 + 0.01 kg m^2)
    resists like I / r^2 kilograms.
    """
    robot = BulletDrive(RobotParameters())
    for _ in range(4):
        robot.step(WheelVelocities(12.0, 12.0))
    acceleration = 2 * 1.0 / 0.0975 / (9.0 + 2 * 0.012377 / 0.0975**2)
    assert robot.state.linear[0] == pytest.approx(acceleration * 0.2, rel=0.005)


def test_more_torque_accelerates_faster() -> None:
    """The parameter reaches the motors, in proportion."""
    speeds = []
    for torque in (0.25, 0.5):
        robot = BulletDrive(RobotParameters(wheel_torque_n_m=torque))
        robot.step(WheelVelocities(12.0, 12.0))
        speeds.append(robot.state.linear[0])
    assert speeds[1] / speeds[0] == pytest.approx(2.0, rel=0.01)


def test_wheels_spin_on_ice() -> None:
    """Friction bounds the acceleration where the torque does not."""
    robot = BulletDrive(RobotParameters.from_mapping({'pybullet.wheel_friction': 0.02}))
    for _ in range(4):
        robot.step(WheelVelocities(12.0, 12.0))
    assert 0.0 < robot.state.linear[0] < 0.02 * 9.81 * 0.2
    assert robot.state.wheel_velocities[0] > 5.0


def test_commands_are_reached_within_two_steps() -> None:
    """From rest to the paper's fastest, 1.5 rad/s."""
    robot = BulletDrive(RobotParameters())
    robot.step(WheelVelocities(1.5, 1.5))
    robot.step(WheelVelocities(1.5, 1.5))
    assert robot.state.wheel_velocities == pytest.approx((1.5, 1.5), rel=1e-3)


def test_the_state_agrees_with_the_poses() -> None:
    """Velocities are those of base_link's origin, in base_link."""
    robot = BulletDrive(RobotParameters(), 10)
    for _ in range(40):
        poses = robot.step(WheelVelocities(1.0, 2.0))
    state = robot.state
    assert state.position == tuple(poses[-1, :3])
    assert state.orientation == tuple(poses[-1, 3:])
    turn = 0.0975 / 0.331
    assert state.linear == pytest.approx((1.5 * 0.0975, -0.0445 * turn, 0), abs=3e-4)
    assert state.angular == pytest.approx((0, 0, turn), abs=3e-4)
    assert state.wheel_velocities == pytest.approx((1.0, 2.0), abs=1e-3)
    assert state.wheel_angles == pytest.approx((2.0, 4.0), abs=0.15)


def test_a_reset_leaves_nothing_of_the_past() -> None:
    """The same bits from a new robot, after another drive and after standing."""
    robot = BulletDrive(RobotParameters())
    first = wander(robot)
    for _ in range(7):
        robot.step(WheelVelocities(12.0, -12.0))
    assert wander(robot).tobytes() == first.tobytes()
    assert wander(BulletDrive(RobotParameters())).tobytes() == first.tobytes()
    assert wander(robot, seed=2).tobytes() != first.tobytes()


def test_looking_more_often_changes_nothing() -> None:
    """With ten poses a step, every tenth equals the only pose, except for rounding."""
    one, ten = BulletDrive(RobotParameters(), 1), BulletDrive(RobotParameters(), 10)
    np.testing.assert_allclose(wander(ten)[9::10], wander(one), atol=1e-9)


def test_another_process_computes_the_same_bits() -> None:
    """Without anything shared but the code."""
    program = f"""
import sys
sys.path[:0] = {sys.path!r}
import math
import numpy as np
from numpy.typing import NDArray
from spikelane_sim.contract import WheelVelocities
from spikelane_sim.robots import make_robot, RobotParameters
robot = make_robot(RobotParameters())
robot.step(WheelVelocities(3.0, 2.0))
robot.reset(9.25, 7.0, 1.5 * math.pi)
commands = np.random.default_rng(1).uniform(-0.5, 2.5, (60, 2))
poses = [robot.step(WheelVelocities(*pair)) for pair in commands.tolist()]
print(np.concatenate(poses).tobytes().hex())
"""
    result = subprocess.run(
        [sys.executable, '-c', program], capture_output=True, text=True, check=True, timeout=120
    )
    assert result.stdout == wander(BulletDrive(RobotParameters())).tobytes().hex() + '\n'


def test_robots_in_one_process_are_independent() -> None:
    """Two driven in turn compute what each computes alone."""
    alone = wander(BulletDrive(RobotParameters()), 20)
    first, second = BulletDrive(RobotParameters()), BulletDrive(RobotParameters())
    for robot in (first, second):
        robot.reset(9.25, 7.0, 1.5 * math.pi)
    commands = np.random.default_rng(1).uniform(-0.5, 2.5, (20, 2)).tolist()
    for pair, expected in zip(commands, alone, strict=True):
        wheels = WheelVelocities(*pair)
        assert first.step(wheels)[0].tobytes() == expected.tobytes()
        assert second.step(wheels)[0].tobytes() == expected.tobytes()


def test_a_closed_robot_is_released_and_harms_no_other() -> None:
    """Its server's number is given on; using it is an error, closing it again is none."""
    closed = BulletDrive(RobotParameters())
    closed.close()
    other = BulletDrive(RobotParameters())
    closed.close()
    with pytest.raises(pybullet.error):
        closed.step(WheelVelocities(1.0, 1.0))
    other.step(WheelVelocities(0.0, 0.0))
    assert other.state.position == pytest.approx((0, 0, 0.13879), abs=1e-5)


def test_forgotten_robots_are_released() -> None:
    """The engine has room for 1,024 servers; dropping a robot gives its place back."""
    numbers = set()
    for _ in range(5):
        numbers.add(BulletDrive(RobotParameters())._engine._id)
        gc.collect()
    assert len(numbers) == 1


@pytest.mark.parametrize('step_s', [0.004, 0.03, 0.05 / 11])
def test_a_physics_step_that_does_not_fit_is_refused(step_s: float) -> None:
    """Not a fraction of 50 ms, or one whose count pybullet gets wrong."""
    with pytest.raises(ParameterError, match=r'physics_step_s: expected a whole fraction of 0.05'):
        make_robot(RobotParameters.from_mapping({'pybullet.physics_step_s': step_s}))


@pytest.mark.parametrize('step_s', [0.05, 0.01, 0.005, 0.0025, 0.002, 0.001, 0.0005])
def test_usual_physics_steps_are_taken(step_s: float) -> None:
    """A step lasts 50 ms with each of them."""
    robot = make_robot(RobotParameters.from_mapping({'pybullet.physics_step_s': step_s}))
    for _ in range(20):
        robot.step(WheelVelocities(1.0, 1.0))
    assert robot.state.wheel_angles[0] == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize('poses', [0, -1, 3, 20])
def test_poses_that_do_not_fit_the_physics_are_refused(poses: int) -> None:
    """Ten steps of the physics can be looked at 1, 2, 5 or 10 times."""
    expected = f'pixels.esim.substeps: expected a divisor of 10, .* got {poses}$'
    with pytest.raises(ParameterError, match=expected):
        make_robot(RobotParameters(), poses)
