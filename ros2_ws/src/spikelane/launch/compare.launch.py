"""Several controllers drive the same lap side by side, each in a namespace; one bag of all.

    ros2 launch spikelane compare.launch.py controllers:=braitenberg,rstdp seed:=1 bag:=both

Each has a simulator of its own. All ends by itself when all laps are over.
"""

from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction

from spikelane.launch import graph
from spikelane.runs.lap.config import NO_PROGRESS_STEPS
from spikelane_controllers.registry import controller_names, usual_controller, usual_training
from spikelane_sim import topic_names


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; the rest depends on them."""
    return LaunchDescription(
        [
            *graph.run_arguments(),
            graph.argument(
                'controllers',
                f'Which, with commas between them: {", ".join(controller_names())}.',
                f'{usual_controller()},{usual_training()}',
            ),
            graph.argument('lane', "outer or inner; empty: the course's first.", ''),
            graph.argument('max_steps', 'Steps of 50 ms that end the laps early; 0: none.', '0'),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[Any]:
    """Return the nodes and how they end.

    Raises:
        ValueError: A controller is unknown, or named twice.
    """
    arguments = graph.Arguments(context)
    names = arguments.text('controllers').split(',')
    if not set(names) <= set(controller_names()) or len(set(names)) < len(names):
        raise ValueError(
            f'controllers: expected different ones of {", ".join(controller_names())}, '
            f'got {",".join(names)}'
        )
    is_recorded, is_viewed = arguments.is_true('record'), arguments.is_true('viewer')
    lap = {
        'lane': arguments.text('lane'),
        'episode.max_steps': arguments.number('max_steps'),
        'episode.no_progress_steps': NO_PROGRESS_STEPS,
        'end_after_episodes': 1,
    }
    pairs = [
        [
            graph.simulator(arguments, name, lap, namespace=name),
            graph.controller(name, arguments, {}, namespace=name),
        ]
        for name in names
    ]
    facts = {key: arguments.text(key) for key in ('controllers', 'scenario', 'seed')}
    topics = [
        topic_names.DIAGNOSTICS,
        *(topic for name in names for topic in graph.in_namespace(name)),
    ]
    recording = [graph.recorder(arguments, facts, topics)] if is_recorded else []
    # The first is the one that is shown.
    viewing = [graph.viewer(arguments, {}, namespace=names[0])] if is_viewed else []
    ending = graph.end_in_order(pairs, recording, viewing)
    return [*ending, *recording, *viewing, *(node for pair in pairs for node in pair)]
