"""The TurtleBot 4 drives: laps of the paper's course, and its speed."""

import numpy as np
import pytest

from spikelane.runs.configuration import Request
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.metrics import lap_metrics
from spikelane.runs.lap.run import drive_lap
from spikelane_sim.contract import WheelVelocities
from spikelane_sim.robots import make_robot, RobotParameters


@pytest.mark.parametrize('controller', ['braitenberg', 'rstdp'])
def test_it_completes_a_lap(controller: str) -> None:
    """With the weights learnt on the Pioneer P3-DX, and without a change of any parameter."""
    parameters = {'simulator.robot.model': 'turtlebot4', 'simulator.robot.engine': 'kinematic'}
    config = LapConfig.make(Request('1', controller, 0, 'inprocess', parameters), 'inner')
    measured = lap_metrics(drive_lap(config, lambda *_: None).trajectory, 0.05)
    assert measured['completed']
    assert 11000 < measured['steps'] < 12000
    assert measured['mean_abs_distance_m'] < 0.05


def test_it_stands_and_speeds_up_as_its_base_may() -> None:
    """By 0.9 m/s^2 until its wheels have the velocity asked for; at rest it does not move."""
    robot = make_robot(RobotParameters.from_mapping({'model': 'turtlebot4'}))
    rest = np.concatenate([robot.step(WheelVelocities(0.0, 0.0)) for _ in range(40)])
    assert np.abs(rest[:, :3]).max() < 1e-4
    for _ in range(4):
        robot.step(WheelVelocities(8.0, 8.0))
    assert robot.state.linear[0] == pytest.approx(0.9 * 0.2, rel=0.05)
    for _ in range(4):
        robot.step(WheelVelocities(8.0, 8.0))
    assert robot.state.linear[0] == pytest.approx(8.0 * 0.03575, rel=1e-3)
    robot.close()


def test_physics_and_ideal_drive_agree_in_a_bend() -> None:
    """The speeds of both engines, once the wheels have theirs."""
    states = []
    for engine in ('pybullet', 'kinematic'):
        robot = make_robot(RobotParameters.from_mapping({'model': 'turtlebot4', 'engine': engine}))
        for _ in range(40):
            robot.step(WheelVelocities(2.5, 4.0))
        states.append(robot.state)
        robot.close()
    physics, ideal = states
    assert physics.linear[0] == pytest.approx(ideal.linear[0], rel=2e-3)
    assert physics.angular[2] == pytest.approx(ideal.angular[2], rel=2e-3)
