"""`spikelane export`: a spiking network in a format that other programs read."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from spikelane.runs.arguments import add_parameter_arguments, parse_parameters
from spikelane.runs.configuration import make_groups
from spikelane_controllers.registry import card, cards, controller_class, hook
from spikelane_controllers.weights import shipped_weights
from spikelane_sim.errors import ParameterError

FORMATS = ('nir',)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('format', choices=FORMATS, help='Neuromorphic Intermediate Representation')
    parser.add_argument(
        'checkpoint',
        metavar='DIR',
        help='output folder of a transfer, a checkpoint in it, or the name of shipped weights',
    )
    names = exported_names()
    parser.add_argument(
        '--controller',
        choices=names,
        default=names[0],
        help=f'controller that the network belongs to (default: {names[0]})',
    )
    parser.add_argument('out', type=Path, metavar='FILE', help='file to write, such as lane.nir')
    add_parameter_arguments(parser, example=f'{names[0]}.neurons.threshold_mv=1.0')
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def exported_names() -> tuple[str, ...]:
    """Return the names of the controllers that have a NIR graph."""
    return tuple(name for name, each in cards().items() if each.nir_graph)


def run(options: argparse.Namespace) -> int:
    """Export.

    Returns:
        0.

    Raises:
        SpikelaneError: An option is wrong, or something failed.
    """
    controller = options.controller
    name = options.checkpoint
    is_shipped = name in shipped_weights(controller)
    checkpoint = name if is_shipped else str(Path(name).absolute())
    given = parse_parameters(options.param)
    if f'{controller}.checkpoint' in given:
        raise ParameterError(
            f'{controller}.checkpoint: expected as an argument, got a parameter too'
        )
    groups = make_groups(
        {**given, f'{controller}.checkpoint': checkpoint},
        {controller: controller_class(controller).parameters_class},
    )
    export_nir = hook(controller, card(controller).nir_graph)
    graph = export_nir(options.out, groups[controller])
    nodes = {name: type(node).__name__ for name, node in graph.nodes.items()}
    result = {'file': str(options.out), 'nodes': nodes, 'metadata': graph.metadata}
    if options.json:
        print(json.dumps(result))
        return 0
    print(f'{options.out}: ' + ' -> '.join(nodes.values()))
    if 'v_min' in graph.metadata:
        print(
            'NIR has no word for potentials that never fall below 0 (metadata v_min): a simulator '
            'must raise them after each time step to fire as the controller does.'
        )
    return 0
