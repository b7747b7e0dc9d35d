"""Wheels that are not what the robot takes them for."""

from __future__ import annotations

import pytest

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

ERRORS = {
    'robot.left_wheel_factor': 0.9,
    'robot.right_wheel_factor': 1.05,
    'robot.track_factor': 1.1,
}


@pytest.mark.parametrize('engine', ['kinematic', 'rigid', 'pybullet'])
def test_the_robot_drives_as_the_real_sizes_say(engine: str) -> None:
    """Half a turn of radian: r (f_l u_l + f_r u_r) / 2 ahead, r (f_r u_r - f_l u_l) / (k b)."""
    values = {'robot.engine': engine, **ERRORS, 'episode.max_distance_m': 0.0}
    parameters = SimulatorParameters.from_mapping(values)
    with Simulator(parameters, sensors=('events', 'encoders')) as simulator:
        simulator.reset('outer', 0)
        for _ in range(40):
            seen = simulator.step(WheelVelocities(2.0, 1.8))
        state = simulator.robot_state
    rate = 0.0975 * (1.05 * 1.8 - 0.9 * 2.0) / (1.1 * 0.331)
    assert state.angular[2] == pytest.approx(rate, rel=0.02)
    assert state.linear[0] == pytest.approx(0.0975 * (1.05 * 1.8 + 0.9 * 2.0) / 2, rel=0.02)
    assert seen.encoders is not None
    assert seen.encoders.velocities == pytest.approx((2.0, 1.8), rel=0.01)
    assert seen.encoders.angles == pytest.approx((4.0, 3.6), rel=0.05)
