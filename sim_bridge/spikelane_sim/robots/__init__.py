"""Robots: a Pioneer P3-DX in a physics engine, and an ideal differential drive.

How far the two agree is told in `pioneer.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

from spikelane_sim.contract import Robot
from spikelane_sim.parameters import parameter, Parameters

PYBULLET = 'pybullet'
KINEMATIC = 'kinematic'


@dataclass(frozen=True, kw_only=True)
class RobotParameters(Parameters):
    """Everything a robot is made from; the geometry is also in `pioneer.urdf`."""

    model: str = parameter(
        PYBULLET,
        'Rigid-body physics, or an ideal differential drive for sweeps',
        choices=(PYBULLET, KINEMATIC),
    )
    wheel_radius_m: float = parameter(
        0.0975, 'Radius of the wheels', unit='m', low=0.01, high=1.0, source="paper's simulation"
    )
    track_m: float = parameter(
        0.331,
        'Distance between the wheels',
        unit='m',
        low=0.01,
        high=2.0,
        source="paper's simulation",
    )
    axle_x_m: float = parameter(
        0.0445,
        "Place of the wheels' axle ahead of base_link",
        unit='m',
        low=-1.0,
        high=1.0,
        source="paper's simulation",
    )
    height_m: float = parameter(
        0.13879,
        'Height of base_link above the floor at rest',
        unit='m',
        low=0.0,
        high=2.0,
        source="paper's simulation",
    )
    max_wheel_velocity_rad_s: float = parameter(
        12.3,
        'Fastest wheel velocity that is asked of the robot, either way',
        unit='rad/s',
        low=0.0,
        high=100.0,
        source='a P3-DX drives at most 1.2 m/s, and 1.2 m/s / 0.0975 m is 12.3 rad/s',
    )
    # 1 N m brakes at 1.8 m/s^2; from 2.7 m/s^2 on (1.5 N m) the caster would leave the floor.
    wheel_torque_n_m: float = parameter(
        1.0, "Largest torque of a wheel's drive (pybullet)", unit='N m', low=0.01, high=100.0
    )
    # A rotor of about 7e-6 kg m^2 behind a gear of 38:1 weighs this much at the wheel: four times
    # the wheel itself.
    rotor_inertia_kg_m2: float = parameter(
        0.01,
        "Inertia of a motor's rotor as felt at its wheel (pybullet)",
        unit='kg m^2',
        low=0.0,
        high=1.0,
    )
    wheel_friction: float = parameter(
        0.8, 'Friction of the wheels on the floor (pybullet)', low=0.0, high=10.0
    )
    physics_step_s: float = parameter(
        0.005,
        'Step of the physics, a whole fraction of 0.05 s (pybullet)',
        unit='s',
        low=0.0005,
        high=0.05,
        source="paper's simulation",
    )
    solver_iterations: int = parameter(
        50,
        'Most iterations of the contact solver, which stops when it has converged (pybullet)',
        low=1,
        high=1000,
    )


def make_robot(parameters: RobotParameters, poses_per_step: int = 1) -> Robot:
    """Make the robot that `parameters.model` names, placed at the origin.

    Args:
        parameters: What to make.
        poses_per_step: How many poses `step` returns, at equal distances in time.

    Raises:
        ParameterError: Parameters contradict each other, the robot's description or
            poses_per_step.
    """
    # The engine is loaded only where it is used.
    if parameters.model == KINEMATIC:
        from spikelane_sim.robots.kinematic import Kinematic

        return Kinematic(parameters, poses_per_step)
    from spikelane_sim.robots.pioneer import Pioneer

    return Pioneer(parameters, poses_per_step)
