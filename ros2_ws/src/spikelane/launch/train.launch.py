"""A controller learns by driving, in lockstep; all ends by itself when it has learnt enough.

ros2 launch spikelane train.launch.py controller:=rstdp scenario:=2 output:=my_training
"""

from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction

from spikelane.launch import graph
from spikelane.runs.train.config import training_defaults
from spikelane_controllers.registry import training_names, usual_training
from spikelane_sim.parameters import grouped


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; the rest depends on them."""
    return LaunchDescription(
        [
            graph.namespace_argument(),
            *graph.run_arguments(record=False),
            *graph.controller_arguments(training_names(), default=usual_training()),
            graph.argument('output', "Folder of the training's checkpoints."),
            graph.argument('steps', 'To learn for; 0: as many as is usual.', '0'),
            graph.flag('resume', 'Whether to go on with the training in the folder.', False),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[Any]:
    """Return the nodes and how they end."""
    arguments = graph.Arguments(context)
    name, steps = arguments.text('controller'), arguments.number('steps')
    is_recorded, is_viewed = arguments.is_true('record'), arguments.is_true('viewer')
    defaults = grouped({**training_defaults(name), 'simulator.autostart': False})
    learning = {
        'output': str(Path(arguments.text('output')).absolute()),
        'resume': arguments.is_true('resume'),
        **({'steps': steps} if steps else {}),
    }
    driving = [
        graph.simulator(arguments, name, defaults['simulator']),
        graph.controller(name, arguments, defaults[name] | learning),
    ]
    facts = {key: arguments.text(key) for key in ('controller', 'scenario', 'seed')}
    recording = [graph.recorder(arguments, facts)] if is_recorded else []
    viewing = [graph.viewer(arguments, {})] if is_viewed else []
    ending = graph.end_in_order([driving], recording, viewing)
    return [*ending, *recording, *viewing, *driving]
