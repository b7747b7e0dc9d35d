"""The planar rigid body: against an independent formulation, closed forms and its contract."""

import copy
import math
import pickle

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from numpy.typing import NDArray
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import lsq_linear

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.robots import make_robot, RobotParameters
from spikelane_sim.robots.description import check_symmetry, read_description
from spikelane_sim.robots.registry import robot_model
from spikelane_sim.robots.rigid import _impulses, _turn, rigid_body, RigidDrive

FINE = {'engine': 'rigid', 'pybullet.physics_step_s': 0.0005}


def make(**given: object) -> RigidDrive:
    """Make a robot; __ stands for a dot."""
    values = {name.replace('__', '.'): value for name, value in given.items()}
    robot = make_robot(RobotParameters.from_mapping({'engine': 'rigid', **values}))
    assert isinstance(robot, RigidDrive)
    return robot


def heading_rad(pose: NDArray[np.float64]) -> float:
    """Return the heading, from -pi to pi."""
    return math.remainder(2 * math.atan2(pose[5], pose[6]), 2 * math.pi)


class ThreeBodies:
    """The P3-DX as three rigid bodies held together by forces: Newton's and Euler's equations.

    The unknowns are nine accelerations (x, y and heading of base and wheels), two of the wheels'
    spins, and the forces of ten constraints: each wheel stays where it is on the base (x, y and
    heading), and neither rolls forward faster than it spins nor slips sideways. Numbers are those
    of pioneer.urdf, written out.
    """

    masses = np.repeat([8.0, 0.5, 0.5], 3)
    inertias = np.array([0.1719, 0.001255, 0.001255])
    spins = np.full(2, 0.002377 + 0.01)
    places = np.array([[0.0445, 0.1655], [0.0445, -0.1655]])

    def accelerations(self, heading: float, turn: float, forward: float, torques) -> tuple:
        """Return dv/dt of the axle's middle along the heading, and dw/dt."""
        cosine, sine = math.cos(heading), math.sin(heading)
        turned = np.array([[cosine, -sine], [sine, cosine]])
        mass = np.diag([8, 8, 0.1719, 0.5, 0.5, 0.001255, 0.5, 0.5, 0.001255, *self.spins])
        rows, sides = [], []
        ahead, left = turned[:, 0], turned[:, 1]
        for index, place in enumerate(self.places):
            at = 3 + 3 * index
            x, y = turned @ place
            for row, side in (
                ({at: 1, 0: -1, 2: y}, -(turn**2) * x),
                ({at + 1: 1, 1: -1, 2: -x}, -(turn**2) * y),
                ({at + 2: 1, 2: -1}, 0.0),
                ({at: left[0], at + 1: left[1]}, self._turned(turn, forward, place)),
                ({at: ahead[0], at + 1: ahead[1], 9 + index: -0.0975}, 0.0),
            ):
                rows.append([row.get(column, 0.0) for column in range(11)])
                sides.append(side)
        constraints = np.array(rows)
        size = len(rows)
        matrix = np.block([[mass, constraints.T], [constraints, np.zeros((size, size))]])
        found = np.linalg.lstsq(matrix, [*np.zeros(9), *torques, *sides], rcond=None)[0]
        # The axle's middle is the middle of the wheels.
        middle = (found[3:5] + found[6:8]) / 2
        return float(middle @ ahead), float(found[2])

    @staticmethod
    def _turned(turn: float, forward: float, place) -> float:
        """Return how fast the wheel's sideways direction turns away from its velocity.

        d/dt (left . velocity) = 0, and left turns into -ahead.
        """
        return turn * (forward - turn * place[1])


def driven_by_three_bodies(torques: tuple[float, float], time_s: float) -> NDArray[np.float64]:
    """Return x, y of base_link, heading, v and w after constant torques from v = 0.3, w = 1."""
    bodies = ThreeBodies()

    def rates(_: float, state: NDArray[np.float64]) -> list[float]:
        _, _, heading, forward, turn = state
        dv, dw = bodies.accelerations(heading, turn, forward, torques)
        cosine, sine = math.cos(heading), math.sin(heading)
        sideways = -0.0445 * turn
        return [
            cosine * forward - sine * sideways,
            sine * forward + cosine * sideways,
            turn,
            dv,
            dw,
        ]

    start = [0.0, 0.0, 0.0, 0.3, 1.0]
    return solve_ivp(rates, (0, time_s), start, rtol=1e-10, atol=1e-12).y[:, -1]


@pytest.mark.parametrize(
    ('wheels', 'torques'),
    [
        (WheelVelocities(60.0, 60.0), (1.0, 1.0)),
        (WheelVelocities(-60.0, 60.0), (-1.0, 1.0)),
        (WheelVelocities(60.0, -60.0), (1.0, -1.0)),
        (WheelVelocities(-60.0, -60.0), (-1.0, -1.0)),
    ],
)
def test_motion_under_full_torque_is_that_of_three_bodies(
    wheels: WheelVelocities, torques: tuple[float, float]
) -> None:
    """Half a second from v = 0.3 m/s and w = 1 rad/s: as an integration of Newton's equations.

    The error falls with the step of the physics, and is below 0.1 % at 0.5 ms.
    """
    expected = driven_by_three_bodies(torques, 0.5)
    errors = []
    for step_s in (0.0025, 0.0005):
        robot = make(pybullet__physics_step_s=step_s)
        robot._state[3:5] = 0.3, 1.0
        for _ in range(10):
            robot.step(wheels)
        found = robot._state[:5]
        errors.append(np.abs(found - expected).max())
    assert np.abs(expected[:2]).max() > 0.05
    assert errors[1] < 1e-3 * np.abs(expected).max()
    assert errors[1] < errors[0] / 4


def test_the_drive_s_torque_is_limited() -> None:
    """From rest it accelerates as Newton's law says for 9 kg and four rotating masses."""
    robot = make()
    for _ in range(4):
        robot.step(WheelVelocities(12.0, 12.0))
    acceleration = 2 * 1.0 / 0.0975 / (9.0 + 2 * 0.012377 / 0.0975**2)
    assert robot.state.linear[0] == pytest.approx(acceleration * 0.2, rel=1e-12)


def test_it_turns_on_the_spot_as_its_inertia_lets_it() -> None:
    """Torques of 1 N m push at 0.1655 m against the inertia about the axle, wheels included."""
    robot = make()
    robot.step(WheelVelocities(-12.0, 12.0))
    about_axle = 0.1719 + 8 * 0.0445**2 + 2 * (0.001255 + 0.5 * 0.1655**2)
    felt = about_axle + 2 * 0.012377 * (0.1655 / 0.0975) ** 2
    assert robot.state.angular[2] == pytest.approx(0.05 * 2 * 0.1655 / 0.0975 / felt, rel=2e-3)


def test_a_robot_told_to_stand_stands() -> None:
    """Exactly where it was put."""
    robot = make()
    robot.reset(3.0, 0.25, 0.3)
    for _ in range(20):
        pose = robot.step(WheelVelocities(0.0, 0.0))[-1]
    assert pose.tolist() == [3.0, 0.25, 0.13879, 0.0, 0.0, math.sin(0.15), math.cos(0.15)]


@pytest.mark.parametrize('model', ['p3dx', 'turtlebot4'])
@pytest.mark.parametrize('wheels', [(1.0, 1.25), (2.0, -1.0), (3.0, 3.0)])
def test_commands_are_reached_exactly(model: str, wheels: tuple[float, float]) -> None:
    """And then kept, in a bend too, where the mass centre pulls outwards."""
    robot = make(model=model)
    for _ in range(40):
        robot.step(WheelVelocities(*wheels))
        if robot.state.wheel_velocities == pytest.approx(wheels, rel=1e-12):
            break
    else:
        pytest.fail('never reached')
    robot.step(WheelVelocities(*wheels))
    assert robot.state.wheel_velocities == pytest.approx(wheels, rel=1e-12)


@given(st.floats(-0.2, 0.2))
def test_small_turns_have_exact_sines(angle: float) -> None:
    """To the last bits of the library's functions, on both sides of where the series end."""
    sine, slack = _turn(angle)
    assert sine == pytest.approx(math.sin(angle), rel=4e-16)
    assert slack == pytest.approx(2 * math.sin(angle / 2) ** 2, rel=1e-13, abs=1e-17)


@settings(deadline=None)
@given(
    st.floats(-1.0, 1.0),
    st.floats(-8.0, 8.0),
    st.floats(0.05, 5.0),
    st.sampled_from(['p3dx', 'turtlebot4']),
    st.floats(0.02, 50.0),
)
def test_impulses_are_the_nearest_within_their_limits(
    lacking_v: float, lacking_w: float, torque: float, model: str, coupling: float
) -> None:
    """As a solver of bounded least squares finds them, also where the motors disturb each other.

    The pair that reaches either velocity or its limit is the minimum of p.A p / 2 - p.lacking,
    A being the change of both rims by both impulses.
    """
    parameters = RobotParameters.from_mapping({'model': model, 'wheel_torque_n_m': torque})
    body = rigid_body(parameters, read_description(robot_model(model).urdf))
    body = body._replace(
        turn_per_impulse=body.turn_per_impulse * coupling,
        impulse_per_turn=body.impulse_per_turn / coupling,
    )
    half = body.track_m / 2
    forward, turn = body.forward_per_impulse, half * body.turn_per_impulse
    changes = np.array([[forward + turn, forward - turn], [forward - turn, forward + turn]])
    lacking = np.array([lacking_v - half * lacking_w, lacking_v + half * lacking_w])
    both, difference = _impulses(body, lacking_v, lacking_w)
    root = np.linalg.cholesky(changes).T
    limit = body.most_impulse
    expected = lsq_linear(root, np.linalg.solve(root.T, lacking), (-limit, limit), tol=1e-14).x
    found = [(both - difference) / 2, (both + difference) / 2]
    np.testing.assert_allclose(found, expected, atol=2e-6 * limit)


def wander(robot: RigidDrive, steps: int = 60, seed: int = 1) -> NDArray[np.float64]:
    """Return the poses of a drive with changing commands from a given place."""
    robot.reset(9.25, 7.0, 1.5 * math.pi)
    commands = np.random.default_rng(seed).uniform(-2.5, 6.0, (steps, 2))
    return np.concatenate([robot.step(WheelVelocities(*pair)) for pair in commands.tolist()])


def test_a_reset_leaves_nothing_of_the_past() -> None:
    """The same bits from a new robot, after another drive and after standing."""
    robot = make()
    first = wander(robot)
    robot.step(WheelVelocities(12.0, -12.0))
    assert wander(robot).tobytes() == first.tobytes() == wander(make()).tobytes()
    assert wander(robot, seed=2).tobytes() != first.tobytes()


def test_a_copy_has_the_same_future_and_disturbs_nobody() -> None:
    """Copied and pickled while it drives."""
    robot = make()
    wander(robot, 10)
    others = [copy.deepcopy(robot), pickle.loads(pickle.dumps(robot))]  # noqa: S301
    others[0].step(WheelVelocities(3.0, 3.0))
    others[0] = copy.deepcopy(robot)
    futures = []
    for each in (robot, *others):
        poses = [each.step(WheelVelocities(2.0, 0.5 * step)) for step in range(20)]
        futures.append((np.concatenate(poses).tobytes(), each.state))
    assert futures[0] == futures[1] == futures[2]


def test_looking_more_often_changes_nothing() -> None:
    """With ten poses a step, every tenth equals the only pose, except for rounding."""
    one, ten = make(), make_robot(RobotParameters(engine='rigid'), 10)
    assert isinstance(ten, RigidDrive)
    np.testing.assert_allclose(wander(ten)[9::10], wander(one), atol=1e-12)


def test_the_state_agrees_with_the_poses() -> None:
    """Velocities are those of base_link's origin, in base_link; wheels roll what is driven."""
    robot = make()
    poses = wander(robot)
    state = robot.state
    assert state.position == tuple(poses[-1, :3])
    assert state.orientation == pytest.approx(tuple(poses[-1, 3:]))
    for _ in range(20):
        robot.step(WheelVelocities(1.0, 2.0))
    before = robot.state
    pose = robot.step(WheelVelocities(1.0, 2.0))[-1]
    state = robot.state
    turn = 0.0975 / 0.331
    assert state.linear == pytest.approx((1.5 * 0.0975, -0.0445 * turn, 0))
    assert state.angular == pytest.approx((0, 0, turn))
    assert state.wheel_velocities == pytest.approx((1.0, 2.0))
    assert np.subtract(state.wheel_angles, before.wheel_angles) == pytest.approx((0.05, 0.1))
    moved = np.hypot(pose[0] - before.position[0], pose[1] - before.position[1])
    assert moved == pytest.approx(0.05 * np.hypot(*state.linear[:2]), rel=1e-4)


def test_left_and_right_are_not_mixed_up() -> None:
    """A faster right wheel turns the robot to the left."""
    robot = make()
    for _ in range(20):
        pose = robot.step(WheelVelocities(1.0, 1.5))[-1]
    assert pose[1] > 0
    assert heading_rad(pose) > 0
    assert robot.state.wheel_angles[0] < robot.state.wheel_angles[1]


@pytest.mark.parametrize(
    ('model', 'name', 'value'),
    [
        ('p3dx', 'wheel_torque_n_m', 1.5),
        ('p3dx', 'max_wheel_velocity_rad_s', 14.5),
        ('p3dx', 'pybullet.wheel_friction', 0.5),
        ('turtlebot4', 'wheel_torque_n_m', 0.25),
    ],
)
def test_what_could_slip_or_tip_over_is_refused(model: str, name: str, value: float) -> None:
    """All that counts is named, with what came."""
    expected = f'wheel_torque_n_m, max_wheel_velocity_rad_s and pybullet.wheel_friction: .*{value}'
    with pytest.raises(ParameterError, match=expected):
        make(**{'model': model, name: value})


@pytest.mark.parametrize('step_s', [0.004, 0.03])
def test_a_physics_step_that_does_not_fit_is_refused(step_s: float) -> None:
    """The step is that of pybullet's parameters."""
    with pytest.raises(ParameterError, match=r'physics_step_s: expected a whole fraction of 0.05'):
        make(pybullet__physics_step_s=step_s)


@pytest.mark.parametrize('poses', [0, -1, 3, 20])
def test_poses_that_do_not_fit_the_physics_are_refused(poses: int) -> None:
    """Ten steps of the physics can be looked at 1, 2, 5 or 10 times."""
    with pytest.raises(ParameterError, match=r'pixels.esim.substeps: expected a divisor of 10'):
        make_robot(RobotParameters(engine='rigid'), poses)


def test_a_lopsided_robot_is_refused() -> None:
    """A planar body that is not symmetric needs other equations; the URDF is named."""
    good = read_description(robot_model('p3dx').urdf)
    check_symmetry(good, 'good.urdf')
    heavier = good._replace(left=good.left._replace(mass_kg=0.6))
    leaning = good._replace(base=good.base._replace(mass_centre_m=(0.0, 0.01, -0.02)))
    nearer = good._replace(right=good.right._replace(origin_m=(0.0445, -0.16, -0.0413)))
    wheels = {'mass_centre_m': (0.01, 0.0, 0.0)}
    swaying = good._replace(left=good.left._replace(**wheels), right=good.right._replace(**wheels))
    for bad in (heavier, leaning, nearer, swaying):
        with pytest.raises(ParameterError, match=r'^bad.urdf: expected equal and balanced wheels'):
            check_symmetry(bad, 'bad.urdf')
