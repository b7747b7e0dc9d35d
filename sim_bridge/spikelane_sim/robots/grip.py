"""Whether a robot's wheels can slip or leave the floor, which `rigid.py` takes for impossible."""

from __future__ import annotations

import math
from typing import NamedTuple, TYPE_CHECKING

from spikelane_sim.errors import ParameterError
from spikelane_sim.robots.description import Description

if TYPE_CHECKING:
    from spikelane_sim.robots import RobotParameters

_GRAVITY_M_S2 = 9.81


def check_grip(parameters: RobotParameters, description: Description, friction: float) -> None:
    """Refuse torques and velocities that the floor cannot hold.

    The hardest case is taken: full torque, while the robot turns about one standing wheel as fast
    as it may. The caster must carry some load then, and the inner wheel as much as it takes to
    hold its motor's push and half of the push sideways.

    A robot that never turns as hard as that has `max_sideways_m_s2`. The push sideways is then
    shared by the wheels as their loads are. That the robot does not turn harder is not checked
    while it drives.

    Args:
        parameters: The robot's.
        description: Its parts.
        friction: Coefficient of the wheels' friction on the floor.

    Raises:
        ParameterError: A wheel could slip, or wheels or caster could leave the floor.
    """
    masses = _masses(parameters, description)
    push_n = parameters.wheel_torque_n_m / parameters.wheel_radius_m
    forward_m_s2 = 2 * push_n / masses.felt_kg
    fastest_m_s = parameters.max_wheel_velocity_rad_s * parameters.wheel_radius_m
    sideways_m_s2 = fastest_m_s**2 / (2 * parameters.track_m)
    is_given = 0 < parameters.max_sideways_m_s2 < sideways_m_s2
    if is_given:
        sideways_m_s2 = parameters.max_sideways_m_s2
    caster_m = description.base.contact_m[0] - parameters.axle_x_m
    weight_n = masses.mass_kg * _GRAVITY_M_S2
    rest_n = weight_n * masses.centre_m / caster_m
    shifted_n = masses.moment_kg_m * forward_m_s2 / abs(caster_m)
    rolled_n = masses.moment_kg_m * sideways_m_s2 / parameters.track_m
    inner_n = (weight_n - rest_n - shifted_n) / 2 - rolled_n
    share = inner_n / (weight_n - rest_n - shifted_n) if is_given else 0.5
    needed_n = math.hypot(push_n, masses.mass_kg * sideways_m_s2 * share)
    if rest_n < shifted_n or needed_n > friction * inner_n:
        raise ParameterError(
            'wheel_torque_n_m, max_wheel_velocity_rad_s and pybullet.wheel_friction: expected '
            'values with which no wheel can slip and none can leave the floor, got '
            f'{parameters.wheel_torque_n_m:g}, {parameters.max_wheel_velocity_rad_s:g} and '
            f'{friction:g}; the engine pybullet can have these, rigid cannot'
        )


class _Masses(NamedTuple):
    mass_kg: float
    felt_kg: float  # with the inertia of what turns with the wheels
    centre_m: float  # of mass, ahead of the axle
    moment_kg_m: float  # moment about the floor by acceleration: of all parts, and of the spin


def _masses(parameters: RobotParameters, description: Description) -> _Masses:
    spin = description.left.inertia_kg_m2[1] + parameters.rotor_inertia_kg_m2
    mass_kg = sum(part.mass_kg for part in description)
    ahead, above = (
        sum(
            part.mass_kg * (part.origin_m[axis] + part.mass_centre_m[axis] - from_m)
            for part in description
        )
        for axis, from_m in ((0, parameters.axle_x_m), (2, -parameters.height_m))
    )
    return _Masses(
        mass_kg=mass_kg,
        felt_kg=mass_kg + 2 * spin / parameters.wheel_radius_m**2,
        centre_m=ahead / mass_kg,
        moment_kg_m=above + 2 * spin / parameters.wheel_radius_m,
    )
