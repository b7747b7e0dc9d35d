"""Run a launch file as `ros2 launch` does: run_launch.py FILE NAME:=VALUE ...

Exits with the status of the launch; prints each process's status as it ends.
"""

import sys

from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.launch_description_sources import AnyLaunchDescriptionSource


def main() -> int:
    """Run it."""
    file, *arguments = sys.argv[1:]
    service = LaunchService()

    def tell(event, context) -> None:
        print('ENDED', event.action.node_name, event.returncode, flush=True)

    service.include_launch_description(
        LaunchDescription(
            [
                RegisterEventHandler(OnProcessExit(on_exit=tell)),
                IncludeLaunchDescription(
                    AnyLaunchDescriptionSource(file),
                    launch_arguments=[tuple(each.split(':=', 1)) for each in arguments],
                ),
            ]
        )
    )
    return service.run()


if __name__ == '__main__':
    sys.exit(main())
