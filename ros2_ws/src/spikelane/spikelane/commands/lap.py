"""`spikelane lap`: one controller, one lap; recorded, measured and drawn."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import contextlib
import json
from pathlib import Path
import re
import sys
from typing import Any

import yaml

from spikelane.lap import (
    drive_lap,
    DrivenLap,
    LapConfig,
    make_config,
    make_folder,
    report_lap,
    Show,
    TRANSPORTS,
)
from spikelane.run_folder import RunFolder
from spikelane_controllers.registry import CONTROLLERS
from spikelane_sim.errors import ParameterError, SpikelaneError

_SHOWN_EVERY_STEPS = 100
_EXPONENT = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        '--scenario',
        default='1',
        help="the paper's 1, 2 or 3, or the path of a course file (default: 1)",
    )
    parser.add_argument(
        '--controller',
        default='braitenberg',
        choices=CONTROLLERS,
        help='what drives (default: braitenberg)',
    )
    parser.add_argument('--lane', help="outer or inner (default: the course's first, outer)")
    parser.add_argument('--seed', type=int, default=0, help='of all randomness (default: 0)')
    parser.add_argument(
        '--transport',
        default='ros',
        choices=TRANSPORTS,
        help='as processes of a ROS graph, recorded; or within this process (default: ros)',
    )
    parser.add_argument(
        '--robot',
        choices=('pybullet', 'kinematic'),
        help='simulated by physics, or as an ideal differential drive (default: pybullet)',
    )
    parser.add_argument(
        '--pixels', choices=('coppelia', 'esim'), help='pixel model (default: coppelia)'
    )
    parser.add_argument(
        '--antialias',
        action=argparse.BooleanOptionalAction,
        help="smooth the camera image's edges (default: no)",
    )
    parser.add_argument(
        '--param',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='any other parameter: simulator.camera.fov_deg=90, braitenberg.steering.v_max=2.0',
    )
    parser.add_argument(
        '--out',
        type=Path,
        metavar='DIR',
        help='folder for the results, new or empty (default: runs/lap-..., numbered)',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(options: argparse.Namespace) -> int:
    """Drive the lap.

    Returns:
        0 where the lap was completed, otherwise 1.

    Raises:
        SpikelaneError: An option is wrong, or something failed.
    """
    config = make_config(
        options.scenario,
        options.controller,
        options.lane,
        options.seed,
        options.transport,
        _parameters(options),
    )
    folder = make_folder(config, options.out)
    with _progress(options.json) as show:
        driven = _drive(config, folder, show)
    result = report_lap(config, driven, folder)
    print(json.dumps(result) if options.json else _summary(result))
    return 0 if result['completed'] else 1


def _drive(config: LapConfig, folder: RunFolder, show: Show) -> DrivenLap:
    if config.transport == 'inprocess':
        return drive_lap(config, show)
    try:
        # Here and not above: laps in-process must work where there is no ROS.
        from spikelane.nodes.lap import drive_lap_over_ros
    except ImportError as error:
        raise SpikelaneError(
            f'--transport ros: expected ROS 2 and the built workspace, got {error}'
        ) from None
    driven: DrivenLap = drive_lap_over_ros(config, folder, show)
    return driven


def _parameters(options: argparse.Namespace) -> dict[str, Any]:
    parameters = {}
    for text in options.param:
        name, equals, value = text.partition('=')
        if not equals:
            raise ParameterError(f'--param: expected NAME=VALUE, got {text!r}')
        parameters[name] = _value(name, value)
    flags = {
        'simulator.robot.model': options.robot,
        'simulator.pixels.model': options.pixels,
        'simulator.camera.antialias': options.antialias,
    }
    return parameters | {name: value for name, value in flags.items() if value is not None}


def _value(name: str, text: str) -> Any:
    """Return what a text means in YAML, where `1e-3` and the like are numbers too."""
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        raise ParameterError(f'{name}: expected a value as in YAML, got {text!r}') from None
    # YAML 1.1 wants a point and a sign (1.0e-3); JSON and people do not.
    return float(value) if isinstance(value, str) and _EXPONENT.fullmatch(value) else value


@contextlib.contextmanager
def _progress(is_quiet: bool) -> Iterator[Show]:
    """Give what shows progress to people: on one line of a terminal's standard error."""
    if is_quiet or not sys.stderr.isatty():
        yield lambda step, progress_m: None
        return
    due = 0

    def show(step: int, progress_m: float) -> None:
        nonlocal due
        if step >= due:
            due = step + _SHOWN_EVERY_STEPS
            print(f'\r{step:6d} steps, {progress_m:5.1f} m ', end='', file=sys.stderr)

    try:
        yield show
    finally:
        print(file=sys.stderr)


def _summary(result: dict[str, Any]) -> str:
    """Return the results for people, one line each."""
    lap_time_s = result['lap_time_s']
    ended = f'in {lap_time_s:.2f} s (simulated)' if result['completed'] else result['reason']
    lines = {
        'lap completed': f'{"yes" if result["completed"] else "no"}, {ended}',
        'steps': f'{result["steps"]}, {result["steps_per_s"]:.0f} per second',
        'mean error': f'{result["mean_abs_distance_m"]:.4f} m from the lane centre',
        'largest error': f'{result["max_abs_distance_m"]:.4f} m',
        'mean deviation': f'{result["mean_distance_m"]:+.4f} m (right of the centre +)',
        'events': f'{result["events"]}',
        'bag': result['bag'] or 'none (in-process)',
        'figure': result['figure'],
    }
    return '\n'.join(f'{name:15} {value}' for name, value in lines.items())
