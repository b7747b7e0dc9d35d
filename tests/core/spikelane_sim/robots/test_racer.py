"""The robot with the speed of a racing car, and how hard a robot may turn in the engine rigid."""

from pathlib import Path

import numpy as np
import pytest

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.robots import make_robot, RobotParameters
from spikelane_sim.robots.description import read_description

RACER = Path(__file__).parents[4] / 'docs/examples/robot/racer.urdf'
SOFT_TYRES = {'model': str(RACER), 'pybullet.wheel_friction': 1.5}


def test_it_has_the_mass_and_the_inertia_of_the_car() -> None:
    """3.74 kg and 0.04712 kg m^2 about the mass centre, which is 0.02 m ahead and 0.03 m high."""
    parts = [
        (part.mass_kg, np.add(part.origin_m, part.mass_centre_m), part.inertia_kg_m2[2])
        for part in read_description(RACER)
    ]
    mass_kg = sum(mass for mass, _, _ in parts)
    assert mass_kg == pytest.approx(3.74)
    centre = sum(mass * place for mass, place, _ in parts) / mass_kg
    assert centre == pytest.approx([0.02, 0.0, 0.03], abs=1e-4)
    inertia = sum(own + mass * np.square(place - centre)[:2].sum() for mass, place, own in parts)
    assert inertia == pytest.approx(0.04712, rel=0.01)


@pytest.mark.parametrize(
    ('values', 'is_refused'),
    [
        (SOFT_TYRES, True),
        (SOFT_TYRES | {'max_sideways_m_s2': 10.5}, False),
        (SOFT_TYRES | {'max_sideways_m_s2': 12.0}, True),
        (SOFT_TYRES | {'max_sideways_m_s2': 10.5, 'pybullet.wheel_friction': 1.0}, True),
        ({'max_wheel_velocity_rad_s': 14.5}, True),
        ({'max_wheel_velocity_rad_s': 14.5, 'max_sideways_m_s2': 2.0}, False),
        # Harder than it can turn: about a standing wheel, (14.5 x 0.0975)^2 / (2 x 0.331) = 3.02.
        ({'max_wheel_velocity_rad_s': 14.5, 'max_sideways_m_s2': 3.1}, True),
    ],
)
def test_rigid_takes_a_robot_that_holds_as_hard_as_it_turns(
    values: dict[str, object], is_refused: bool
) -> None:
    """Otherwise it refuses, as always, what could slip at its fastest."""
    parameters = RobotParameters.from_mapping({'engine': 'rigid', **values})
    if is_refused:
        with pytest.raises(ParameterError, match='no wheel can slip'):
            make_robot(parameters)
    else:
        make_robot(parameters).close()


def test_physics_and_rigid_agree_in_a_fast_bend() -> None:
    """4 m/s on a circle of 2.25 m, as on the outer lane: 7.1 m/s^2, which the tyres hold."""
    states = []
    for engine in ('pybullet', 'rigid'):
        values = SOFT_TYRES | {'engine': engine, 'max_sideways_m_s2': 10.5}
        robot = make_robot(RobotParameters.from_mapping(values))
        mean, half = 4.0 / 0.0508, 4.0 / 2.25 * 0.136 / 0.0508
        for share in [number / 40 for number in range(40)] + [1.0] * 20:
            robot.step(WheelVelocities(share * (mean - half), share * (mean + half)))
        states.append(robot.state)
        robot.close()
    physics, rigid = states
    assert rigid.linear[0] == pytest.approx(4.0, rel=1e-3)
    assert physics.linear[0] == pytest.approx(4.0, rel=0.02)
    assert physics.angular[2] == pytest.approx(4.0 / 2.25, rel=0.02)
