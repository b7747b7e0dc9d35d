"""A lap in lockstep, recorded; all ends by itself when the lap is over.

ros2 launch spikelane lap.launch.py scenario:=2 controller:=rstdp seed:=1 bag:=my_lap
"""

from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction

from spikelane.launch import graph
from spikelane.launch.arguments import (
    Arguments,
    controller_arguments,
    flag,
    lap_arguments,
    lap_parameters,
    namespace_argument,
    run_arguments,
)


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; the rest depends on them."""
    return LaunchDescription(
        [
            namespace_argument(),
            *run_arguments(),
            *controller_arguments(),
            *lap_arguments(),
            flag(
                'autostart',
                'Begin the lap at once instead of when simulator/reset is called.',
                True,
            ),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[Any]:
    """Return the nodes and how they end."""
    arguments = Arguments(context)
    name = arguments.text('controller')
    lap = {**lap_parameters(arguments), 'autostart': arguments.is_true('autostart')}
    driving = graph.driving(name, arguments, lap)
    return graph.whole_run(arguments, [driving], ('controller', 'scenario', 'seed'))
