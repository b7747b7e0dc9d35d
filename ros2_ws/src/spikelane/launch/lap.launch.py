"""A lap in lockstep, recorded; all ends by itself when the lap is over.

ros2 launch spikelane lap.launch.py scenario:=2 controller:=rstdp seed:=1 bag:=my_lap
"""

from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction

from spikelane.launch import graph
from spikelane.runs.lap.config import NO_PROGRESS_STEPS


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; the rest depends on them."""
    return LaunchDescription(
        [
            graph.namespace_argument(),
            *graph.run_arguments(),
            *graph.controller_arguments(),
            graph.argument('lane', "outer or inner; empty: the course's first.", ''),
            graph.flag(
                'autostart',
                'Whether the lap begins at once, or when simulator/reset is called.',
                True,
            ),
            graph.argument('max_steps', 'Steps of 50 ms that end the lap early; 0: none.', '0'),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[Any]:
    """Return the nodes and how they end."""
    arguments = graph.Arguments(context)
    name = arguments.text('controller')
    is_recorded, is_viewed = arguments.is_true('record'), arguments.is_true('viewer')
    lap = {
        'lane': arguments.text('lane'),
        'episode.max_steps': arguments.number('max_steps'),
        'episode.no_progress_steps': NO_PROGRESS_STEPS,
        'end_after_episodes': 1,
        'autostart': arguments.is_true('autostart'),
    }
    driving = [
        graph.simulator(arguments, name, lap),
        graph.controller(name, arguments, {}),
    ]
    facts = {key: arguments.text(key) for key in ('controller', 'scenario', 'seed')}
    recording = [graph.recorder(arguments, facts)] if is_recorded else []
    viewing = [graph.viewer(arguments, {})] if is_viewed else []
    ending = graph.end_in_order([driving], recording, viewing)
    return [*ending, *recording, *viewing, *driving]
