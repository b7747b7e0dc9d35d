"""Several controllers drive the same lap side by side, each in a namespace; one bag of all.

    ros2 launch spikelane compare.launch.py controllers:=braitenberg,rstdp seed:=1 bag:=both

Each has a simulator of its own. All ends by itself when all laps are over.
"""

from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction

from spikelane.launch import graph
from spikelane.launch.arguments import (
    argument,
    Arguments,
    lap_arguments,
    lap_parameters,
    run_arguments,
)
from spikelane_controllers.registry import controller_names, usual_controller, usual_training
from spikelane_sim import topic_names


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; the rest depends on them."""
    return LaunchDescription(
        [
            *run_arguments(),
            argument(
                'controllers',
                f'Controllers to compare, separated by commas: {", ".join(controller_names())}.',
                f'{usual_controller()},{usual_training()}',
            ),
            *lap_arguments(),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[Any]:
    """Return the nodes and how they end.

    Raises:
        ValueError: A controller is unknown, or named twice.
    """
    arguments = Arguments(context)
    names = arguments.text('controllers').split(',')
    if not set(names) <= set(controller_names()) or len(set(names)) < len(names):
        raise ValueError(
            f'controllers: expected different ones of {", ".join(controller_names())}, '
            f'got {",".join(names)}'
        )
    lap = lap_parameters(arguments)
    pairs = [graph.driving(name, arguments, lap, namespace=name) for name in names]
    topics = [
        topic_names.DIAGNOSTICS,
        *(topic for name in names for topic in graph.in_namespace(name)),
    ]
    facts = ('controllers', 'scenario', 'seed')
    return graph.whole_run(arguments, pairs, facts, topics, shown=names[0])
