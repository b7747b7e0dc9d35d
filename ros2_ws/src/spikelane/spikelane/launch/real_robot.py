"""What the launch files of real robots share: their arguments, and the controller's parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from launch.actions import DeclareLaunchArgument, Shutdown
from launch_ros.actions import Node

from spikelane.launch import graph
from spikelane.launch.arguments import argument, Arguments, flag, period_argument
from spikelane.runs.train.config import training_defaults
from spikelane_controllers.registry import controller_names, usual_training
from spikelane_sim.parameters import grouped


def robot_arguments() -> list[DeclareLaunchArgument]:
    """Declare what a controller on any robot takes."""
    return [
        argument('controller', 'What drives.', usual_training(), controller_names()),
        argument(
            'checkpoint',
            'Weights to drive or to begin with, as scenario_1 or a folder of a training; empty: '
            "the controller's default.",
            '',
        ),
        argument(
            'camera_file',
            'Calibration of the camera, through which its events are seen as from the trained '
            'camera; empty: the image is scaled.',
            '',
        ),
        argument(
            'robot_file', "Parameters of robot and limits; empty: the robot's of the package.", ''
        ),
        period_argument('the controller, in which it answers the events'),
        argument('seed', 'Seed of all randomness, a whole number from 0.', '0'),
        flag('camera', 'Start the driver of the camera.', True),
        argument('output', 'Folder of a training on the robot; empty: nothing is learnt.', ''),
        flag('resume', 'Resume the training in the folder.', False),
        argument(
            'lane_source',
            'Topic of the distance from the lane in learning: lane/distance or lane/state.',
            'distance',
            ('distance', 'state'),
        ),
    ]


def robot_controller(arguments: Arguments, robot: str) -> Node:
    """Return the controller that drives a robot.

    Args:
        arguments: Of `robot_arguments`.
        robot: As of `graph.controller_on_robot`.
    """
    name = arguments.text('controller')
    others: dict[str, Any] = {}
    if output := arguments.text('output'):
        others |= grouped(training_defaults(name))[name]
        others |= {
            'learning': True,
            'output': str(Path(output).absolute()),
            'resume': arguments.is_true('resume'),
            'lane_source': arguments.text('lane_source'),
        }
    if checkpoint := arguments.text('checkpoint'):
        others['checkpoint'] = checkpoint
    if camera_file := arguments.text('camera_file'):
        others['filter.chain'] = 'correlation,ground_view'
        others['filter.ground_view.file'] = str(Path(camera_file).absolute())
    return graph.controller_on_robot(name, robot, arguments, others)


def driver(package: str, executable: str, name: str, **options: Any) -> Node:
    """Return a node of another package without which nothing drives: its end ends all."""
    return Node(
        package=package,
        executable=executable,
        name=name,
        output='screen',
        on_exit=Shutdown(reason=f'{name} has ended'),
        **options,
    )
