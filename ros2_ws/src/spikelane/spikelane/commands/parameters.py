"""`spikelane parameters`: every parameter that `--param` takes, as a page in Markdown."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
import json
from typing import Any

from spikelane.markdown import markdown_table
from spikelane_controllers.registry import (
    controller_class,
    controller_names,
    training_class,
    training_names,
    transfer_class,
    transfer_names,
)
from spikelane_sim.binning import SensorParameters
from spikelane_sim.filters import FilterParameters
from spikelane_sim.parameters import Parameters, ParameterSpec
from spikelane_sim.simulator_parameters import SimulatorParameters

_HEADER = ('parameter', 'default', 'allowed', 'meaning', 'source', 'changes from')
_NOTHING = '–'  # noqa: RUF001  # a dash stands where there is nothing

#: Groups that belong to no controller.
_COMMON: Mapping[str, type[Parameters]] = {
    'simulator': SimulatorParameters,
    'filter': FilterParameters,
    'sensor': SensorParameters,
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.description = (
        'Print all parameters of a group or a controller. The last column says from when on a '
        'change holds that is made while the node runs (ros2 param set); where it is empty, the '
        'parameter is fixed.'
    )
    parser.add_argument(
        'name',
        choices=(*_COMMON, *controller_names()),
        help='a group of parameters, or a controller: its own parameters, and those of its '
        'training and transfer',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(options: argparse.Namespace) -> int:
    """Print the parameters.

    Returns:
        0.

    Raises:
        SpikelaneError: What the controller needs is not installed.
    """
    groups = parameter_classes(options.name)
    if options.json:
        print(json.dumps({name: _facts(spec) for name, spec in _specs(groups)}))
        return 0
    print(f'# Parameters: {options.name}\n')
    print(markdown_table(_HEADER, [_cells(name, spec) for name, spec in _specs(groups)]))
    return 0


def parameter_classes(name: str) -> dict[str, type[Parameters]]:
    """Return the classes of the parameters of a group or a controller, by their groups."""
    if name in _COMMON:
        return {name: _COMMON[name]}
    groups = {name: controller_class(name).parameters_class}
    if name in training_names():
        groups['training'] = training_class(name).parameters_class
    if name in transfer_names():
        groups |= transfer_class(name).parameters_classes
    return groups


def _specs(groups: Mapping[str, type[Parameters]]) -> Iterator[tuple[str, ParameterSpec]]:
    """Yield every parameter with its full name."""
    for group, cls in groups.items():
        for spec in cls.specs():
            yield f'{group}.{spec.name}', spec


def _facts(spec: ParameterSpec) -> dict[str, Any]:
    return {
        'default': _plain(spec.default),
        'allowed': spec.allowed,
        'unit': spec.unit,
        'description': spec.description,
        'source': spec.source,
        'changes': spec.changes,
    }


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _cells(name: str, spec: ParameterSpec) -> tuple[str, ...]:
    default = json.dumps(_plain(spec.default), ensure_ascii=False)
    source = spec.source or _NOTHING
    changes = spec.changes or _NOTHING
    return f'`{name}`', f'`{default}`', spec.allowed, spec.description, source, changes
