"""`spikelane export`: a spiking network in a format that other programs read."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from spikelane.commands.arguments import add_parameter_arguments, parse_parameters
from spikelane.configuration import parameter_groups
from spikelane_controllers.weights import shipped_weights
from spikelane_sim.errors import ParameterError

FORMATS = ('nir',)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument('format', choices=FORMATS, help='Neuromorphic Intermediate Representation')
    parser.add_argument(
        'checkpoint',
        metavar='DIR',
        help='folder that a transfer left, a checkpoint in it, or the name of shipped weights',
    )
    parser.add_argument('out', type=Path, metavar='FILE', help='to write, such as lane.nir')
    add_parameter_arguments(parser, example='dqn_snn.neurons.clamped=false')
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(options: argparse.Namespace) -> int:
    """Export.

    Returns:
        0.

    Raises:
        SpikelaneError: An option is wrong, or something failed.
    """
    # Here and not above: the parameters alone take their time.
    from spikelane_controllers.dqn_snn import DqnSnnParameters
    from spikelane_controllers.nir_export import export_nir

    name = options.checkpoint
    checkpoint = name if name in shipped_weights('dqn_snn') else str(Path(name).absolute())
    given = parse_parameters(options.param)
    if 'dqn_snn.checkpoint' in given:
        raise ParameterError('dqn_snn.checkpoint: expected as an argument, got a parameter too')
    groups = parameter_groups(given, {'dqn_snn': {'checkpoint': checkpoint}})
    parameters = DqnSnnParameters.from_mapping(groups['dqn_snn'], 'dqn_snn')
    graph = export_nir(options.out, parameters)
    nodes = {name: type(node).__name__ for name, node in graph.nodes.items()}
    result = {'file': str(options.out), 'nodes': nodes, 'metadata': graph.metadata}
    if options.json:
        print(json.dumps(result))
        return 0
    print(f'{options.out}: ' + ' -> '.join(nodes.values()))
    if parameters.neurons.clamped:
        print(
            'NIR has no word for potentials that never fall below 0 (metadata v_min): a simulator '
            'must raise them after each time step to fire as the controller does.'
        )
    return 0
