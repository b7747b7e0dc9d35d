"""A controller on a Pioneer P3-DX with a DVXplorer: base, joystick, camera and controller.

ros2 launch spikelane p3dx.launch.py camera_file:=my_camera.yaml port:=/dev/ttyUSB0
"""

from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction

from spikelane.launch import graph
from spikelane.launch.arguments import argument, Arguments, flag
from spikelane.launch.real_robot import driver, robot_arguments, robot_controller


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; the rest depends on them."""
    return LaunchDescription(
        [
            *robot_arguments(),
            argument('serial', 'Serial number of the camera; empty: the first that is found.', ''),
            argument('port', "Serial port of the robot's base.", '/dev/ttyUSB0'),
            flag('base', "Start the driver of the robot's base.", True),
            flag('joystick', 'Start the driver of the joystick.', True),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[Any]:
    """Return the nodes and how they end."""
    arguments = Arguments(context)
    controller = robot_controller(arguments, 'p3dx')
    # The driver publishes ~/events, best-effort: event_camera/events.
    camera = driver(
        'libcaer_driver',
        'driver_node',
        'event_camera',
        parameters=[
            {
                'device_type': 'dvxplorer',
                'serial': arguments.text('serial'),
                'frame_id': 'event_camera_optical_frame',
                'event_message_time_threshold': 1.0e-3,
                'dvs_enabled': True,
            }
        ],
    )
    # It takes Twist on cmd_vel, and stops by itself 0.2 s after the last one.
    base = driver(
        'p2os_driver',
        'p2os_driver',
        'p2os_driver',
        parameters=[{'port': arguments.text('port'), 'cmd_vel_timeout': 0.2}],
        remappings=[('pose', 'odom')],
    )
    joystick = driver('joy_linux', 'joy_linux_node', 'joy_linux_node')
    wanted = {'camera': camera, 'base': base, 'joystick': joystick}
    drivers = [node for name, node in wanted.items() if arguments.is_true(name)]
    return [*graph.end_in_order([[controller]], [], []), *drivers, controller]
