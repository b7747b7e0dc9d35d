"""The Pioneer P3-DX, the robot of the paper; the parameters' defaults are its values."""

from pathlib import Path

from spikelane_sim.robots.model import RobotModel

P3DX = RobotModel('Pioneer P3-DX', 'pioneer', Path(__file__).with_name('pioneer.urdf'))
