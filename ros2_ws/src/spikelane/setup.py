"""ROS package spikelane; all but its nodes stands in the repository's pyproject.toml."""

from pathlib import Path
import sys

from setuptools import setup

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / 'setup'))

from ros_package import setup_arguments

NODES = (
    'camera_calibration',
    'lane_from_pose',
    'recorder',
    'replay',
    'viewer',
    'wheels_to_twist',
)

setup(**setup_arguments('spikelane', {name: f'spikelane_entry:{name}' for name in NODES}))
