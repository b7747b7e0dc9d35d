"""What colcon needs to know of the package; all else is in pyproject.toml."""

from setuptools import setup

setup(
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/my_controllers']),
        ('share/my_controllers', ['package.xml']),
    ],
)
