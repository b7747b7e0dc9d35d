"""A planar rigid body on two driven wheels that do not slip: Bullet's robot, solved by hand.

On a level floor, with a caster that has no friction and wheels that hold, the robot of
`bullet_drive.py` has two velocities left: v, forward, of the middle of the axle, and the turning
rate w. Bullet's solver finds them, in every step of the physics, by iterating over some twenty
unknown impulses; here they are written down. Both take the same steps in time, since an exact
integration would differ by up to 0.4 % from Bullet's (one wheel at 12.3 rad/s, the other at rest).

Symbols: h step of the physics; r radius of the wheels; b distance between them; m mass of all
parts; c place of its centre ahead of the axle; I inertia of all parts about the vertical through
the axle's middle; J inertia of a wheel and its motor's rotor about the wheel's axis; T largest
torque. The wheels' velocities u_l, u_r are (v -/+ w b/2) / r, as nothing slips.

1. Between two steps the body turns by d = w h, while its momentum keeps its direction in the
   world. Seen from the turned body the velocity of the mass centre (v, c w) is then
   (v cos d + c w sin d, c w cos d - v sin d).
2. The floor pushes a wheel forward with what its motor's impulse p does not need to turn it:
   (p - J du) / r, du being the change of u. Forward, and about the axle's middle, where the
   floor's sideways push has no lever, the impulses balance:

       m (v' - v cos d - c w sin d) = sum of the pushes
       (I - m c^2) (w' - w) + m c (c w' - c w cos d + v sin d) = (right push - left push) b/2

   With M = m + 2 J / r^2 and K = I + J b^2 / (2 r^2), the inertias that the motors feel, this is

       M v' = M v - m (v (1 - cos d) - c w sin d) + (p_l + p_r) / r
       K w' = K w - m c (c w (1 - cos d) + v sin d) + (p_r - p_l) b / (2 r)

   For h towards 0 these are Lagrange's equations of the differential drive,
   M dv/dt = m c w^2 + (torque_l + torque_r) / r and
   K dw/dt = -m c v w + (torque_r - torque_l) b / (2 r).
3. Bullet's velocity motor (gain 1, as pybullet has it) takes its wheel to the velocity asked for
   within one step, or as near as an impulse of at most T h does. p_l and p_r depend on each other
   by 2.; they are the one pair within their limits in which either motor that is not at its limit
   has reached its velocity (a linear complementarity problem of two unknowns).
4. The mass centre of the base moves by h times its new velocity, in the direction that the body
   still has, then the body turns by h w'. The wheels turn by h u'. (Semi-implicit Euler, as in
   Bullet.)

Damping: none, as in `bullet_drive.py`. The caster carries its load and does nothing else.
Sources of the parameters: masses, their centres, inertias and places of the parts are read out of
the robot's URDF; rotor_inertia_kg_m2 and wheel_torque_n_m are `RobotParameters`, h is
`PybulletParameters.physics_step_s`. The friction `wheel_friction` does not appear above: torques
and velocities at which a wheel could slip, or wheels or caster could leave the floor, are
refused, see `grip.py`.

How far it agrees with pybullet: docs/robots.md.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TYPE_CHECKING

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.compiled import uncounted
from spikelane_sim.contract import RobotState, WheelVelocities
from spikelane_sim.engine import Engine
from spikelane_sim.period import PERIOD_MS
from spikelane_sim.robots.description import check_symmetry, Description
from spikelane_sim.robots.grip import check_grip
from spikelane_sim.robots.pybullet_engine import PybulletParameters
from spikelane_sim.robots.sizing import describe

if TYPE_CHECKING:
    from spikelane_sim.robots import RobotParameters

#: Columns of a state: place of base_link, heading, v, w, and the wheels' angles.
_X, _Y, _HEADING, _FORWARD, _TURN, _LEFT, _RIGHT = range(7)
#: Passes over both motors until neither impulse changes; usually two to six.
_MOST_PASSES = 200
#: Below this angle the series of `_turn` are exact in double precision.
_SMALL_RAD = 0.05


class RigidBody(NamedTuple):
    """What the equations above need, as numbers: see the module's symbols."""

    step_s: float  # h
    radius_m: float  # r
    track_m: float  # b
    height_m: float  # of base_link
    base_m: float  # the mass centre of the base ahead of base_link
    base_from_axle_m: float  # the same ahead of the axle
    centre_m: float  # c
    momentum_share: float  # m / M
    swing_share_1_m: float  # m c / K
    forward_per_impulse: float  # 1 / (M r) [1 / (kg m)]
    impulse_per_forward: float  # M r
    turn_per_impulse: float  # b / (2 K r) [1 / (kg m^2)]
    impulse_per_turn: float  # 2 K r / b
    most_impulse: float  # T h [N m s]


def rigid_body(parameters: RobotParameters, description: Description) -> RigidBody:
    """Return the numbers of the equations.

    Args:
        parameters: The robot's.
        description: Its parts.
    """
    base, left, right = description
    step_s = _physics(parameters).physics_step_s
    radius_m, track_m = parameters.wheel_radius_m, parameters.track_m
    mass_kg = sum(part.mass_kg for part in description)
    base_m = base.mass_centre_m[0]
    base_from_axle_m = base_m - parameters.axle_x_m
    inertia = base.inertia_kg_m2[2] + base.mass_kg * base_from_axle_m**2
    for wheel in (left, right):
        inertia += wheel.inertia_kg_m2[2] + wheel.mass_kg * (track_m / 2) ** 2
    spin = left.inertia_kg_m2[1] + parameters.rotor_inertia_kg_m2
    felt_kg = mass_kg + 2 * spin / radius_m**2
    felt_kg_m2 = inertia + spin * track_m**2 / (2 * radius_m**2)
    centre_m = base.mass_kg * base_from_axle_m / mass_kg
    return RigidBody(
        step_s=step_s,
        radius_m=radius_m,
        track_m=track_m,
        height_m=parameters.height_m,
        base_m=base_m,
        base_from_axle_m=base_from_axle_m,
        centre_m=centre_m,
        momentum_share=mass_kg / felt_kg,
        swing_share_1_m=mass_kg * centre_m / felt_kg_m2,
        forward_per_impulse=1 / (felt_kg * radius_m),
        impulse_per_forward=felt_kg * radius_m,
        turn_per_impulse=track_m / (2 * felt_kg_m2 * radius_m),
        impulse_per_turn=2 * felt_kg_m2 * radius_m / track_m,
        most_impulse=parameters.wheel_torque_n_m * step_s,
    )


class RigidDrive:
    """A robot on a level floor whose wheels hold (`contract.Robot`).

    Attributes:
        body: The numbers of the equations.
        substeps: Steps of the physics from one pose to the next.
    """

    def __init__(
        self,
        parameters: RobotParameters,
        poses_per_step: int = 1,
        period_s: float = PERIOD_MS / 1000,
    ) -> None:
        """Make the robot, at the origin.

        Raises:
            ParameterError: The step of the physics does not divide period_s, poses_per_step does
                not divide the steps, the robot is not symmetric, or it could slip or tip over.
        """
        self.substeps = _physics(parameters).steps_per_pose(poses_per_step, period_s)
        description = describe(parameters)
        check_symmetry(description, parameters.model)
        check_grip(parameters, description, _physics(parameters).wheel_friction)
        self.body = rigid_body(parameters, description)
        self._axle_x_m = parameters.axle_x_m
        self._poses_per_step = poses_per_step
        self.reset(0.0, 0.0, 0.0)

    def reset(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Place the robot, at rest."""
        self._state = np.array([x_m, y_m, heading_rad, 0.0, 0.0, 0.0, 0.0])

    def step(self, wheels: WheelVelocities) -> NDArray[np.float64]:
        """Drive for one step; see `contract.Robot`."""
        poses = np.empty((self._poses_per_step, 7))
        drive_step(self.body, self._state, wheels.left, wheels.right, self.substeps, poses)
        return poses

    @property
    def state(self) -> RobotState:
        """Pose and motion now."""
        x_m, y_m, heading_rad, forward, turn, left_rad, right_rad = self._state.tolist()
        half = turn * self.body.track_m / 2
        return RobotState(
            position=(x_m, y_m, self.body.height_m),
            orientation=(0.0, 0.0, math.sin(heading_rad / 2), math.cos(heading_rad / 2)),
            linear=(forward, -self._axle_x_m * turn, 0.0),
            angular=(0.0, 0.0, turn),
            wheel_angles=(left_rad, right_rad),
            wheel_velocities=(
                (forward - half) / self.body.radius_m,
                (forward + half) / self.body.radius_m,
            ),
        )

    def close(self) -> None:
        """Release nothing."""


@numba.njit(cache=True)
def drive_step(body, state, left, right, substeps, poses):  # type: ignore[no-untyped-def]
    """Drive for one step.

    Args:
        body: A `RigidBody`.
        state: x, y, heading [rad], v [m/s], w [rad/s] and the wheels' angles [rad], (7,);
            changed in place.
        left: Velocity asked of the left wheel [rad/s].
        right: The same for the right wheel.
        substeps: Steps of the physics from one pose to the next.
        poses: Where the poses go, as `contract.Robot.step` returns them, (n, 7).
    """
    h, r = body.step_s, body.radius_m
    heading, v, w = state[_HEADING], state[_FORWARD], state[_TURN]
    driven_m, turned_rad = 0.0, 0.0
    wanted_v, wanted_w = (left + right) * r / 2, (right - left) * r / body.track_m
    cosine, sine = math.cos(heading), math.sin(heading)
    x, y = state[_X] + body.base_m * cosine, state[_Y] + body.base_m * sine
    swing, slack = _turn(w * h)
    for row in range(poses.shape[0]):
        for _ in range(substeps):
            v, w = (
                v - body.momentum_share * (v * slack - body.centre_m * w * swing),
                w - body.swing_share_1_m * (body.centre_m * w * slack + v * swing),
            )
            both, difference = _impulses(body, wanted_v - v, wanted_w - w)
            v += body.forward_per_impulse * both
            w += body.turn_per_impulse * difference
            sideways = body.base_from_axle_m * w
            x += h * (cosine * v - sine * sideways)
            y += h * (sine * v + cosine * sideways)
            driven_m += h * v
            turned_rad += h * w
            swing, slack = _turn(w * h)
            cosine, sine = (
                cosine - slack * cosine - swing * sine,
                sine - slack * sine + swing * cosine,
            )
        _write_pose(
            poses[row],
            x - body.base_m * cosine,
            y - body.base_m * sine,
            body.height_m,
            heading + turned_rad,
        )
    state[_X], state[_Y], state[_HEADING] = poses[-1, 0], poses[-1, 1], heading + turned_rad
    state[_FORWARD], state[_TURN] = v, w
    state[_LEFT] += (driven_m - body.track_m / 2 * turned_rad) / r
    state[_RIGHT] += (driven_m + body.track_m / 2 * turned_rad) / r


@uncounted
def _write_pose(pose, x_m, y_m, z_m, heading_rad):  # type: ignore[no-untyped-def]
    pose[0], pose[1], pose[2] = x_m, y_m, z_m
    pose[3], pose[4] = 0.0, 0.0
    pose[5], pose[6] = math.sin(heading_rad / 2), math.cos(heading_rad / 2)


@numba.njit(cache=True)
def _turn(angle_rad):  # type: ignore[no-untyped-def]
    """Return sin and 1 - cos of an angle; small ones, as all are in practice, by their series."""
    if abs(angle_rad) > _SMALL_RAD:
        return math.sin(angle_rad), 1 - math.cos(angle_rad)
    a = angle_rad * angle_rad
    sine = angle_rad * (1 - a * (1 / 6) * (1 - a * (1 / 20) * (1 - a * (1 / 42))))
    return sine, a * 0.5 * (1 - a * (1 / 12) * (1 - a * (1 / 30) * (1 - a * (1 / 56))))


@numba.njit(cache=True)
def _impulses(body, lacking_v, lacking_w):  # type: ignore[no-untyped-def]
    """Return the motors' impulses: right + left and right - left [N m s].

    Args:
        body: A `RigidBody`.
        lacking_v: What v lacks of the velocity asked for [m/s].
        lacking_w: What w lacks [rad/s].
    """
    limit = body.most_impulse
    both = lacking_v * body.impulse_per_forward
    difference = lacking_w * body.impulse_per_turn
    if abs(both) + abs(difference) <= 2 * limit:
        return both, difference
    # Changes of a wheel's rim velocity by its own motor's impulse, and by that of the other one.
    half_track_m = body.track_m / 2
    own = body.forward_per_impulse + half_track_m * body.turn_per_impulse
    other = body.forward_per_impulse - half_track_m * body.turn_per_impulse
    share, inverse = other / own, 1 / own
    free_left = (lacking_v - half_track_m * lacking_w) * inverse
    free_right = (lacking_v + half_track_m * lacking_w) * inverse
    right = min(limit, max(-limit, (both + difference) / 2))
    left = 0.0
    # Projected Gauss-Seidel: the error falls by (other / own)^2 in each pass.
    for _ in range(_MOST_PASSES):
        before = right
        left = min(limit, max(-limit, free_left - share * right))
        right = min(limit, max(-limit, free_right - share * left))
        if right == before:
            break
    return right + left, right - left


def _physics(parameters: RobotParameters) -> PybulletParameters:
    """Return the parameters of the engine that this one stands for."""
    found = parameters.pybullet  # type: ignore[attr-defined]  # fields of engines
    assert isinstance(found, PybulletParameters)
    return found


ENGINE = Engine(RigidDrive)
