"""ROS package spikelane; all but its nodes stands in the repository's pyproject.toml."""

from pathlib import Path
import sys

from setuptools import setup

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / 'setup'))

from ros_package import setup_arguments

NODES = {
    'recorder': 'spikelane.nodes.recorder:main',
    'replay': 'spikelane.runs.replay.nodes.replay:main',
    'viewer': 'spikelane.nodes.viewer:main',
    'wheels_to_twist': 'spikelane.nodes.wheels_to_twist:main',
}

setup(**setup_arguments('spikelane', NODES))
