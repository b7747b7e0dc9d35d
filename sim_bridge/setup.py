"""ROS package spikelane_sim; all but its nodes stands in the repository's pyproject.toml."""

from pathlib import Path
import sys

from setuptools import setup

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'setup'))

from ros_package import setup_arguments

setup(**setup_arguments('spikelane_sim', {'simulator': 'spikelane_sim_entry:simulator'}))
