"""`spikelane camera`: the calibration of a simulated camera, for `filter.ground_view`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from spikelane.runs.arguments import (
    add_parameter_arguments,
    add_robot_arguments,
    given_robot,
    parse_parameters,
)
from spikelane.runs.configuration import make_groups
from spikelane_sim.calibration import write_calibration
from spikelane_sim.simulated_calibration import simulated_calibration
from spikelane_sim.simulator_parameters import SimulatorParameters


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.description = (
        'Write the lens and the place of a simulated camera for --param '
        'filter.ground_view.file=FILE, with which a controller that was trained with another '
        'camera drives. The node camera_calibration does the same for a camera in a ROS graph.'
    )
    parser.add_argument('out', type=Path, metavar='FILE', help='file to write, such as davis.yaml')
    add_robot_arguments(parser)
    add_parameter_arguments(parser, example='simulator.camera.fov_deg=60')
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(options: argparse.Namespace) -> int:
    """Write the calibration.

    Returns:
        0.

    Raises:
        SpikelaneError: An option is wrong, or the file cannot be written.
    """
    given = parse_parameters(options.param) | given_robot(options)
    groups: dict[str, Any] = make_groups(given, {'simulator': SimulatorParameters})
    calibration = simulated_calibration(groups['simulator'])
    write_calibration(options.out, calibration)
    x_m, y_m, z_m = calibration.place_m
    result = {
        'file': str(options.out),
        'width': calibration.width,
        'height': calibration.height,
        'x_m': x_m,
        'y_m': y_m,
        'z_m': z_m,
        'pitch_deg': calibration.angles_deg[1],
    }
    said = (
        f'camera of {calibration.width} x {calibration.height} px, {z_m:.3f} m above the floor, '
        f'{x_m:.3f} m ahead of the axle, {result["pitch_deg"]:g} deg down: {options.out}'
    )
    print(json.dumps(result) if options.json else said)
    return 0
