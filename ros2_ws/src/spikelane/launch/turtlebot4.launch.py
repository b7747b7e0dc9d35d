"""A controller on a TurtleBot 4 with a Prophesee camera; the robot's own bringup runs already.

ros2 launch spikelane turtlebot4.launch.py camera_file:=my_camera.yaml
"""

from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction

from spikelane.launch import graph
from spikelane.launch.arguments import argument, Arguments, namespace_argument
from spikelane.launch.real_robot import driver, robot_arguments, robot_controller


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; the rest depends on them."""
    return LaunchDescription(
        [
            namespace_argument(),
            *robot_arguments(),
            argument('serial', 'Serial number of the camera; empty: the first that is found.', ''),
            argument('bias_file', "File of the sensor's biases; empty: those of the camera.", ''),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[Any]:
    """Return the nodes and how they end."""
    arguments = Arguments(context)
    controller = robot_controller(arguments, 'turtlebot4')
    # The driver publishes ~/events, best-effort: event_camera/events.
    camera = driver(
        'metavision_driver',
        'driver_node',
        'event_camera',
        namespace=arguments.text('namespace'),
        parameters=[
            {
                'serial': arguments.text('serial'),
                'bias_file': arguments.text('bias_file'),
                'frame_id': 'event_camera_optical_frame',
                'event_message_time_threshold': 1.0e-3,
                'send_queue_size': 1000,
            }
        ],
    )
    cameras = [camera] if arguments.is_true('camera') else []
    return [*graph.end_in_order([[controller]], [], []), *cameras, controller]
