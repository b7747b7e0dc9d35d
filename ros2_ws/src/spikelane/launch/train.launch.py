"""A controller learns by driving, in lockstep; all ends by itself when it has learnt enough.

ros2 launch spikelane train.launch.py controller:=rstdp scenario:=2 output:=my_training
"""

from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction

from spikelane.launch import graph
from spikelane.launch.arguments import (
    argument,
    Arguments,
    controller_arguments,
    flag,
    namespace_argument,
    run_arguments,
)
from spikelane.runs.configuration import step_limits
from spikelane.runs.train.config import training_defaults
from spikelane_controllers.registry import training_names, usual_training
from spikelane_sim.parameters import grouped


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments; the rest depends on them."""
    return LaunchDescription(
        [
            namespace_argument(),
            *run_arguments(record=False),
            *controller_arguments(training_names(), default=usual_training()),
            argument('output', "Folder of the training's checkpoints."),
            argument('steps', 'Steps of the training; 0: the default of the controller.', '0'),
            flag('resume', 'Resume the training in the folder.', False),
            OpaqueFunction(function=start),
        ]
    )


def start(context: LaunchContext) -> list[Any]:
    """Return the nodes and how they end."""
    arguments = Arguments(context)
    name, steps = arguments.text('controller'), arguments.number('steps')
    usual = {**training_defaults(name)}
    if arguments.period_ms is not None:
        usual |= step_limits(usual, arguments.period_ms)
    defaults = grouped({**usual, 'simulator.autostart': False})
    learning = {
        'output': str(Path(arguments.text('output')).absolute()),
        'resume': arguments.is_true('resume'),
        **({'steps': steps} if steps else {}),
    }
    own = defaults[name] | learning
    driving = graph.driving(name, arguments, defaults['simulator'], own)
    return graph.whole_run(arguments, [driving], ('controller', 'scenario', 'seed'))
