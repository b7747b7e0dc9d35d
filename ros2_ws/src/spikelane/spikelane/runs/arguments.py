"""Arguments that several commands share: what determines a run, and where it goes."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from pathlib import Path
import re
from typing import Any

from spikelane.runs.configuration import Request, TRANSPORTS
from spikelane.runs.output import add_output_arguments
from spikelane_controllers.registry import controller_class, controller_names, usual_controller
from spikelane_controllers.weights import shipped_weights
from spikelane_sim.errors import ParameterError
from spikelane_sim.parsing import parse_yaml, ParseError
from spikelane_sim.robots.registry import engines, robot_model, robot_models
from spikelane_sim.sensor_preset import load_preset, preset_names, preset_parameters

_SHOWN_EVERY_STEPS = 100
_EXPONENT = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+')


def add_configuration_arguments(
    parser: argparse.ArgumentParser, *, transport: str | None = 'ros', out: str = 'runs/lap-...'
) -> None:
    """Declare the arguments that determine a run.

    Args:
        parser: Parser of the command.
        transport: The default, None where there is no choice.
        out: The default folder, as shown in the help text.
    """
    parser.add_argument(
        '--scenario',
        default='1',
        help="the paper's 1, 2 or 3, the path of a course file, or random:SEED (default: 1)",
    )
    parser.add_argument('--seed', type=int, default=0, help='seed of all randomness (default: 0)')
    if transport is not None:
        _add_transport_argument(parser, transport)
    add_robot_arguments(parser)
    parser.add_argument(
        '--preset',
        metavar='NAME|FILE',
        help='use the pixel characteristics of a real event camera: '
        f'{", ".join(preset_names())}, or a file in the same format; --pixels, --antialias and '
        '--param take precedence',
    )
    parser.add_argument(
        '--pixels', choices=('coppelia', 'esim'), help='pixel model (default: coppelia)'
    )
    parser.add_argument(
        '--antialias',
        action=argparse.BooleanOptionalAction,
        help='smooth the edges in the camera image (default: no)',
    )
    add_parameter_arguments(
        parser, example=f'simulator.camera.fov_deg=90, {usual_controller()}.steering.v_max=2.0'
    )
    add_output_arguments(
        parser, f'folder for the results, new or empty (default: {out}, numbered)'
    )


def add_robot_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare which robot drives and what moves it, which `given_robot` reads."""
    parser.add_argument(
        '--robot',
        type=_robot,
        metavar='ROBOT',
        help=f'robot to simulate: {", ".join(robot_models())}, or the path of its URDF (default: '
        'p3dx); an engine is also accepted, as by --engine',
    )
    parser.add_argument(
        '--engine',
        choices=tuple(engines()),
        help='how the robot is moved: physics (pybullet), the physics of a body that cannot slip, '
        'which is faster (rigid), or an ideal differential drive (kinematic) (default: pybullet)',
    )


def add_parameter_arguments(parser: argparse.ArgumentParser, *, example: str) -> None:
    """Declare `--param`, which `parse_parameters` reads."""
    parser.add_argument(
        '--param',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help=f'set any other parameter, for example {example}',
    )


def _add_transport_argument(parser: argparse.ArgumentParser, default: str) -> None:
    parser.add_argument(
        '--transport',
        default=default,
        choices=TRANSPORTS,
        help='run as a ROS graph, which records laps, with simulator and controller in a process '
        'each (ros) or in one (composed), or within this process without ROS (inprocess) '
        f'(default: {default})',
    )


def add_controller_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare which controller drives, and with which weights."""
    parser.add_argument(
        '--controller',
        default=usual_controller(),
        choices=controller_names(),
        help=f'controller that drives (default: {usual_controller()})',
    )
    parser.add_argument(
        '--checkpoint',
        metavar='DIR',
        help='output folder of a training, or a checkpoint in it; for controllers that learn '
        '(default: the weights shipped for the scenario, otherwise those for scenario 1)',
    )


def add_record_argument(parser: argparse.ArgumentParser) -> None:
    """Declare what is recorded of the controller, which `parse_names` reads."""
    parser.add_argument(
        '--record',
        metavar='NAMES',
        help='record quantities of the controller in recording.nc (NetCDF), with commas between '
        'them, for example spikes,weights; all: everything that the controller offers',
    )


def given_weights(options: argparse.Namespace) -> dict[str, str]:
    """Return the parameter that a given checkpoint is.

    Raises:
        ParameterError: The controller has no weights to learn.
    """
    if options.checkpoint is None:
        return {}
    known = {spec.name for spec in controller_class(options.controller).parameters_class.specs()}
    if 'checkpoint' not in known:
        raise ParameterError(
            f'--checkpoint: expected a controller that learns, got {options.controller}'
        )
    # The nodes need not run in this folder.
    path = str(Path(options.checkpoint).absolute())
    is_shipped = options.checkpoint in shipped_weights(options.controller)
    return {f'{options.controller}.checkpoint': options.checkpoint if is_shipped else path}


def given_parameters(options: argparse.Namespace) -> dict[str, Any]:
    """Return the parameters that were given under dotted names.

    Raises:
        ParameterError: One cannot be read.
    """
    flags = {
        'simulator.pixels.model': options.pixels,
        'simulator.camera.antialias': options.antialias,
    }
    given = {name: value for name, value in flags.items() if value is not None}
    return _preset(options) | parse_parameters(options.param) | given_robot(options) | given


def _preset(options: argparse.Namespace) -> dict[str, Any]:
    """Return the parameters of the preset that was given, none without one.

    Raises:
        ParameterError: It cannot be read.
    """
    if options.preset is None:
        return {}
    values = preset_parameters(load_preset(options.preset))
    return {f'simulator.{name}': value for name, value in values.items()}


def _robot(text: str) -> str:
    """Return a robot or engine.

    Raises:
        argparse.ArgumentTypeError: It is neither, nor a URDF that can be read.
    """
    if text not in engines():
        try:
            robot_model(text)
        except ParameterError as error:
            raise argparse.ArgumentTypeError(str(error)) from None
    return text


def given_robot(options: argparse.Namespace) -> dict[str, str]:
    """Return the parameters that a given robot and engine are."""
    flags = {'simulator.robot.model': options.robot, 'simulator.robot.engine': options.engine}
    return {name: value for name, value in flags.items() if value is not None}


def request_of(options: argparse.Namespace, parameters: Mapping[str, Any]) -> Request:
    """Return what a run is asked for with, by the arguments that determine any run.

    Args:
        options: The arguments, of `add_configuration_arguments` and `controller`.
        parameters: All that were given.
    """
    transport = getattr(options, 'transport', 'inprocess')
    return Request(options.scenario, options.controller, options.seed, transport, parameters)


def parse_parameters(texts: Iterable[str]) -> dict[str, Any]:
    """Return parameters from texts like NAME=VALUE.

    Raises:
        ParameterError: One cannot be read.
    """
    parameters = {}
    for text in texts:
        name, equals, value = text.partition('=')
        if not equals:
            raise ParameterError(f'--param: expected NAME=VALUE, got {text!r}')
        parameters[name] = _value(name, value)
    return parameters


def _value(name: str, text: str) -> Any:
    """Return what a text means in YAML, where `1e-3` and the like are numbers too."""
    try:
        value = parse_yaml(text)
    except ParseError as error:
        raise ParameterError(
            f'{name}: expected a value as in YAML, got {text!r:.80}: {error}'
        ) from None
    # YAML 1.1 wants a point and a sign (1.0e-3); JSON and people do not.
    return float(value) if isinstance(value, str) and _EXPONENT.fullmatch(value) else value
