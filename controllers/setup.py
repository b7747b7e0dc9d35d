"""ROS package spikelane_controllers; all but its nodes is in the repository's pyproject.toml."""

from pathlib import Path
import sys

from setuptools import setup

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'setup'))

from ros_package import registered, setup_arguments

NODE = 'spikelane_controllers.nodes.main:main'

setup(
    **setup_arguments(
        'spikelane_controllers', dict.fromkeys(registered('spikelane.controllers'), NODE)
    )
)
