"""Look at nodes that run: in the browser, in RViz, or through a bridge for Foxglove.

ros2 launch spikelane view.launch.py                  # in the browser
ros2 launch spikelane view.launch.py with:=rviz
ros2 launch spikelane view.launch.py with:=foxglove   # open config/foxglove.json there
"""

from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from spikelane.launch import graph
from spikelane.launch.arguments import argument, Arguments


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; the rest depends on them."""
    return LaunchDescription(
        [
            argument(
                'with',
                'In the browser; or packages rviz2, foxglove_bridge, where they are installed.',
                'browser',
                ('browser', 'rviz', 'foxglove'),
            ),
            argument('namespace', 'Namespace of the nodes shown in the browser.', ''),
            argument('port', 'Port of the page, or of the bridge; on this machine alone.', '0'),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[Any]:
    """Return what shows."""
    arguments = Arguments(context)
    port, config = (
        arguments.number('port'),
        Path(get_package_share_directory('spikelane'), 'config'),
    )
    if arguments.text('with') == 'rviz':
        file = str(config / 'spikelane.rviz')
        node = Node(package='rviz2', executable='rviz2', arguments=['-d', file])
    elif arguments.text('with') == 'foxglove':
        bridge = {'address': '127.0.0.1', 'port': port or 8765, 'use_sim_time': True}
        node = Node(package='foxglove_bridge', executable='foxglove_bridge', parameters=[bridge])
    else:
        settings = {'web_port': port} if port else {}
        node = graph.viewer(arguments, settings)
    return [*graph.end_in_order([], [], [node]), node]
