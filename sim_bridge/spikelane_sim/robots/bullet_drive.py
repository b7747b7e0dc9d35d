"""A differential drive in the physics engine Bullet (pybullet).

pybullet needs some care, found by measurement:

- A friction that is set in one call of changeDynamics with other properties can be dropped
  without a word (bulletphysics/bullet3 issue 3314), so each call sets one property. A caster
  that keeps its default friction makes the robot turn up to 80 % slow.
- Motor impulses are limited to force times `fixedTimeStep`, in every sub-step, so the force is
  divided by the number of sub-steps. The trajectory is then the same, but for rounding, however
  many sub-steps one call of stepSimulation takes.
- The drive and the grip of a wheel work against each other in the solver, which takes the longer
  to converge the lighter the wheel. With the geared rotor's inertia, which the real robot has
  too, it needs 20 to 30 iterations instead of more than 50.

How far the Pioneer P3-DX agrees with the ideal differential drive of `kinematic.py`, once the
commanded velocities are reached (first rows: the paper's range, last row: 12.3 and 0 rad/s):

    =========================================  ==========  ============
    wheels                                     speed       turning rate
    =========================================  ==========  ============
    0.5 to 2.5 rad/s, differing by up to 1     to 0.01 %   to 0.003 %
    turning on the spot                        -           to 0.005 %
    up to 12.3 rad/s, straight                 to 0.001 %  -
    up to 12.3 rad/s, one wheel standing       to 0.4 %    to 0.001 %
    =========================================  ==========  ============

What is left is the solver's residual: sideways slip that grows with the centripetal force, up to
5 mm/s. Reaching a velocity takes 55 ms per rad/s. Laps of the paper's course take equally
many steps to 0.02 %. The body tilts by less than 0.0002 degrees, so the camera does not shake.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
import functools
import math
from typing import Any, NamedTuple, TYPE_CHECKING
import weakref

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.contract import RobotState, WheelVelocities
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.period import PERIOD_MS
from spikelane_sim.robots.bullet import pybullet
from spikelane_sim.robots.pybullet_engine import PybulletParameters
from spikelane_sim.robots.sizing import describe

if TYPE_CHECKING:
    from spikelane_sim.robots import RobotParameters

_GRAVITY_M_S2 = 9.81
# The solver stops once no constraint's velocity changes by more than the root of this. At
# pybullet's default of 1e-7 a robot told to stand creeps by 0.02 mm/s.
_SOLVER_RESIDUAL_M2_S2 = 1e-9
_BASE = -1  # pybullet's index of the base link
_LEFT, _RIGHT = 0, 1  # and of the wheels, in the order they are given to it
_WHEELS = (_LEFT, _RIGHT)
_LEVEL = (0.0, 0.0, 0.0, 1.0)


class _Past(NamedTuple):
    """Everything that the state of the physics depends on."""

    pose: tuple[float, float, float]  # of the last reset: x, y [m], heading [rad]
    commands: array[float]  # wheel velocities of all steps since, left and right in turn [rad/s]


class BulletDrive:
    """A robot on a level floor (`contract.Robot`).

    It can be copied and pickled. Bullet does not tell all of its state (contacts, impulses to
    begin the solver with), so that a copy is placed where the robot was reset last and driven
    with the same commands, which leads to the same bits.
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
                not divide the steps, or the robot would tip over.
        """
        self._physics = parameters.own(PybulletParameters)
        self._substeps = self._physics.steps_per_pose(poses_per_step, period_s)
        self._description = describe(parameters)
        self._parameters = parameters
        self._poses_per_step = poses_per_step
        self._period_s = period_s
        self._torques = (parameters.wheel_torque_n_m / self._substeps,) * 2
        self._engine = _Engine()
        self.reset(0.0, 0.0, 0.0)

    def reset(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Place the robot, at rest.

        The whole world is made anew, so that nothing of the past reaches the next run's bits.
        """
        self._past = _Past((x_m, y_m, heading_rad), array('d'))
        engine = self._engine
        engine.resetSimulation()
        engine.setGravity(0.0, 0.0, -_GRAVITY_M_S2)
        engine.setPhysicsEngineParameter(
            fixedTimeStep=self._period_s / self._poses_per_step,
            numSubSteps=self._substeps,
            numSolverIterations=self._physics.solver_iterations,
            solverResidualThreshold=_SOLVER_RESIDUAL_M2_S2,
            deterministicOverlappingPairs=1,
        )
        self._lay_floor()
        self._make_body((x_m, y_m, self._parameters.height_m), heading_rad)
        self._set_dynamics()
        self._drive(WheelVelocities(0.0, 0.0))

    def step(self, wheels: WheelVelocities) -> NDArray[np.float64]:
        """Drive for one step; see `contract.Robot`."""
        self._past.commands.extend(wheels)
        self._drive(wheels)
        poses = np.empty((self._poses_per_step, 7))
        for row in range(self._poses_per_step):
            self._engine.stepSimulation()
            position, orientation = self._pose()
            poses[row, :3] = position
            poses[row, 3:] = orientation
        return poses

    @property
    def state(self) -> RobotState:
        """Pose and motion now."""
        position, orientation = self._pose()
        linear, angular = self._engine.getBaseVelocity(self._body)
        left, right = self._engine.getJointStates(self._body, _WHEELS)
        to_body = (-orientation[0], -orientation[1], -orientation[2], orientation[3])
        angular = _rotate(to_body, angular)
        # The engine speaks of the centre of mass, we of base_link's origin.
        x, y, z = _rotate(to_body, linear)
        swing = _cross(angular, self._description.base.mass_centre_m)
        return RobotState(
            position=position,
            orientation=orientation,
            linear=(x - swing[0], y - swing[1], z - swing[2]),
            angular=angular,
            wheel_angles=(left[0], right[0]),
            wheel_velocities=(left[1], right[1]),
        )

    def close(self) -> None:
        """Release the physics engine; a second call does nothing."""
        self._engine.close()

    def __getstate__(self) -> dict[str, Any]:
        """Return what the robot is made from, and its past."""
        return {
            'parameters': self._parameters,
            'poses_per_step': self._poses_per_step,
            'period_s': self._period_s,
            'past': self._past,
            'is_closed': self._engine.is_closed,
        }

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Become a robot with the same future, in an engine of its own."""
        self.__init__(  # type: ignore[misc]
            state['parameters'], state['poses_per_step'], state['period_s']
        )
        past = state['past']
        self.reset(*past.pose)
        for left, right in zip(past.commands[::2], past.commands[1::2], strict=True):
            self.step(WheelVelocities(left, right))
        if state['is_closed']:
            self.close()

    def _lay_floor(self) -> None:
        # At height 0: there the robot stands without a drop, its wheels 0.01 mm deep in the
        # floor, the depth that Bullet leaves alone.
        shape = self._engine.createCollisionShape(pybullet.GEOM_PLANE)
        floor = self._engine.createMultiBody(0.0, shape)
        self._engine.changeDynamics(floor, _BASE, lateralFriction=1.0)

    def _make_body(self, position_m: Sequence[float], heading_rad: float) -> None:
        base, *wheels = self._description
        caster, left, right = (
            self._engine.createCollisionShape(
                pybullet.GEOM_SPHERE,
                radius=part.contact_radius_m,
                collisionFramePosition=part.contact_m,
            )
            for part in self._description
        )
        self._body = self._engine.createMultiBody(
            base.mass_kg,
            caster,
            basePosition=position_m,
            baseOrientation=(0.0, 0.0, math.sin(heading_rad / 2), math.cos(heading_rad / 2)),
            baseInertialFramePosition=base.mass_centre_m,
            linkMasses=[wheel.mass_kg for wheel in wheels],
            linkCollisionShapeIndices=[left, right],
            linkVisualShapeIndices=[-1, -1],
            linkPositions=[wheel.origin_m for wheel in wheels],
            linkOrientations=[_LEVEL, _LEVEL],
            linkInertialFramePositions=[wheel.mass_centre_m for wheel in wheels],
            linkInertialFrameOrientations=[_LEVEL, _LEVEL],
            linkParentIndices=[0, 0],
            linkJointTypes=[pybullet.JOINT_REVOLUTE] * 2,
            linkJointAxis=[(0.0, 1.0, 0.0)] * 2,
        )

    def _set_dynamics(self) -> None:
        change = functools.partial(self._engine.changeDynamics, self._body)
        base, *wheels = self._description
        change(_BASE, linearDamping=0.0)
        change(_BASE, angularDamping=0.0)
        change(_BASE, activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING)
        change(_BASE, lateralFriction=0.0)
        change(_BASE, localInertiaDiagonal=base.inertia_kg_m2)
        for index, wheel in zip(_WHEELS, wheels, strict=True):
            x, y, z = wheel.inertia_kg_m2
            y += self._parameters.rotor_inertia_kg_m2
            change(index, lateralFriction=self._physics.wheel_friction)
            change(index, localInertiaDiagonal=(x, y, z))

    def _drive(self, wheels: WheelVelocities) -> None:
        self._engine.setJointMotorControlArray(
            self._body,
            _WHEELS,
            pybullet.VELOCITY_CONTROL,
            targetVelocities=wheels,
            forces=self._torques,
        )

    def _pose(self) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
        """Return the place of base_link [m] and its quaternion."""
        position, orientation = self._engine.getBasePositionAndOrientation(self._body)
        x, y, z = _rotate(orientation, self._description.base.mass_centre_m)
        return (position[0] - x, position[1] - y, position[2] - z), tuple(orientation)


class _Engine:
    """A physics server of our own, whose functions are methods here.

    pybullet's own BulletClient prints a line to the standard output for every client.
    """

    def __init__(self) -> None:
        self._id = pybullet.connect(pybullet.DIRECT)
        if self._id < 0:
            raise SpikelaneError('robot.engine: pybullet has no room for one more robot')
        self._release = weakref.finalize(self, pybullet.disconnect, self._id)

    def __getattr__(self, name: str) -> Any:
        function = functools.partial(getattr(pybullet, name), physicsClientId=self._id)
        setattr(self, name, function)
        return function

    @property
    def is_closed(self) -> bool:
        """Whether it has been disconnected."""
        return not self._release.alive

    def close(self) -> None:
        """Disconnect; what is called afterwards raises pybullet.error."""
        self._release()
        # The server's number may be given to another one.
        self.__dict__ = {'_id': -1, '_release': self._release}


def _cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def _rotate(quaternion: Sequence[float], vector: Sequence[float]) -> tuple[float, float, float]:
    """Turn a vector by a unit quaternion x, y, z, w."""
    w = quaternion[3]
    x, y, z = _cross(quaternion, vector)
    x, y, z = _cross(quaternion, (x + w * vector[0], y + w * vector[1], z + w * vector[2]))
    return vector[0] + 2 * x, vector[1] + 2 * y, vector[2] + 2 * z
