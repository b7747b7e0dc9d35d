"""`spikelane replay`: a recorded drive through a controller once more; compared and measured."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
import json
from pathlib import Path
import sys
from typing import Any

from spikelane.bag.changes import RecordedChange
from spikelane.bag.drive import RecordedDrive
from spikelane.runs.arguments import (
    add_parameter_arguments,
    given_weights,
    parse_parameters,
)
from spikelane.runs.command import run_folder
from spikelane.runs.configuration import Request
from spikelane.runs.output import add_output_arguments, in_lines
from spikelane.runs.replay.config import ReplayConfig
from spikelane.runs.replay.metrics import unmeasured
from spikelane.runs.replay.run import replay, report_replay
from spikelane_controllers.registry import controller_class, controller_names, usual_controller
from spikelane_sim.errors import ParameterError
from spikelane_sim.filters import FilterParameters
from spikelane_sim.parameters import flatten, Parameters
from spikelane_sim.parsing import parse_json
from spikelane_sim.period import TimedParameters


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.description = (
        'Let a controller answer the observations in a bag (open loop), and compare its wheel '
        'velocities with the recorded ones, step by step. The metrics of the drive are computed '
        'from the bag alone. The bag may come from Spikelane or from ros2 bag record (MCAP or '
        'SQLite, compressed or not). It may also come from a real event camera of any size; the '
        'events are then cropped, scaled and binned by time into steps of 50 ms.'
    )
    parser.add_argument(
        'bag', type=Path, metavar='BAG', help="a bag's folder, or one of its .mcap or .db3 files"
    )
    parser.add_argument(
        '--controller',
        choices=controller_names(),
        help='controller that answers (default: the recorded one, if the bag names it)',
    )
    parser.add_argument(
        '--checkpoint',
        metavar='DIR',
        help='output folder of a training, or a checkpoint in it; for controllers that learn '
        '(default: the weights of the recorded drive, otherwise those shipped for the scenario)',
    )
    parser.add_argument(
        '--scenario',
        help="the paper's 1, 2 or 3, or the path of a course file; selects the shipped weights "
        "(default: the bag's scenario, otherwise 1)",
    )
    parser.add_argument(
        '--seed',
        type=int,
        help="seed of the controller's randomness (default: the bag's seed, otherwise 0)",
    )
    parser.add_argument(
        '--events',
        metavar='TOPIC',
        help='topic of the event packets (default: /event_camera/events, or the only one)',
    )
    parser.add_argument(
        '--no-lane-state',
        action='store_true',
        help='pass only events to the controller, like a node with use_lane_state:=false',
    )
    add_parameter_arguments(
        parser,
        example=f'{usual_controller()}.steering.v_max=2.0, sensor.crop_width=480 '
        '(default: those of the recorded drive, if the bag has them)',
    )
    add_output_arguments(
        parser, 'folder for the results, new or empty (default: runs/replay-..., numbered)'
    )


def run(options: argparse.Namespace) -> int:
    """Replay.

    Returns:
        0, whether the answers agree or not; 1 where nothing could be measured.

    Raises:
        SpikelaneError: An option is wrong, or the bag cannot be read.
    """
    drive = RecordedDrive(options.bag, options.events)
    said = drive.source.custom_data
    options.controller = options.controller or drive.controller
    if options.controller not in controller_names():
        raise ParameterError(
            f'--controller: expected one of {", ".join(controller_names())}, as the bag '
            + (
                f'says that {options.controller} drove'
                if options.controller
                else 'does not say what drove'
            )
        )
    if options.seed is None and 'seed' not in said and drive.has_wheels:
        drive.notes.append(
            'the bag does not say the seed of what drove: the answers are compared with those of '
            'seed 0 (--seed)'
        )
    asked = Request(
        options.scenario or _recorded_scenario(said),
        options.controller,
        _seed(said) if options.seed is None else options.seed,
        parameters=_recorded_period(options.controller, drive)
        | _recorded_parameters(options, said)
        | given_weights(options)
        | parse_parameters(options.param),
    )
    config = ReplayConfig.make(
        asked,
        options.bag,
        events_topic=options.events,
        use_lane_state=not options.no_lane_state,
    )
    changes = _changes_again(config, drive, parse_parameters(options.param))
    with run_folder(options, config) as (folder, show):
        replayed = replay(config, drive, show, changes)
        result = report_replay(config, drive, replayed, folder)
    print(json.dumps(result) if options.json else _summary(result))
    if failure := unmeasured(replayed.answers, replayed.sensor):
        print(f'spikelane replay: {options.bag}: {failure}', file=sys.stderr)
    return 1 if failure else 0


def _changes_again(
    config: ReplayConfig, drive: RecordedDrive, given: Mapping[str, Any]
) -> list[RecordedChange]:
    """Return the changes of what drove that are made again; the notes say which and which not.

    A parameter that is given keeps the given value.
    """
    recorded = drive.changes.controller
    if not recorded:
        return []
    if config.controller != drive.controller:
        drive.notes.append(f'the changes are not made again: {drive.controller} drove')
        return []
    fixed = {name for name in flatten(given) if name.startswith(f'{config.controller}.')}
    made = []
    for each in recorded:
        values = {
            name: value
            for name, value in each.change.values.items()
            if f'{config.controller}.{name}' not in fixed
        }
        if values:
            made.append(each._replace(change=each.change._replace(values=values)))
    drive.notes.append(
        'the changes are made again where they took effect'
        + (f', except those of {", ".join(sorted(fixed))}, which are given' if fixed else '')
    )
    return made


def _seed(said: dict[str, str]) -> int:
    """Return the seed that a bag's facts give, 0 where they give none."""
    text = said.get('seed', '')
    return int(text) if text.isdecimal() else 0


def _recorded_scenario(said: dict[str, str]) -> str:
    """Return the paper's scenario that a bag's facts give, 1 where it was driven elsewhere."""
    text = said.get('scenario', '')
    return text if text.isdecimal() else '1'


def _recorded_parameters(options: argparse.Namespace, said: dict[str, str]) -> dict[str, Any]:
    """Return the parameters of what drove, where a bag's facts give them and it answers again."""
    if options.controller != said.get('controller'):
        return {}
    own = _recorded_group(
        said, 'parameters', controller_class(options.controller).parameters_class
    )
    if options.scenario is not None:  # asks for its weights
        own.pop('checkpoint', None)
    filters = _recorded_group(said, 'filter', FilterParameters)
    return flatten({options.controller: own, 'filter': filters})


def _recorded_period(controller: str, drive: RecordedDrive) -> dict[str, Any]:
    """Return the control period of what drove, where the controller is made for one."""
    cls = controller_class(controller).parameters_class
    period_ms = drive.period_ms
    if period_ms is None or not issubclass(cls, TimedParameters):
        return {}
    return {f'{controller}.period_ms': period_ms}


def _recorded_group(said: dict[str, str], name: str, cls: type[Parameters]) -> dict[str, Any]:
    """Return parameters of a class that a bag's facts give, under its names alone."""
    try:
        values = dict(parse_json(said.get(name, '{}')))
    except (TypeError, ValueError):
        return {}
    known = {spec.name for spec in cls.specs()}
    return {name: value for name, value in values.items() if name in known}


def _summary(result: dict[str, Any]) -> str:
    """Return the results for people, one line each."""
    lines = {'steps': f'{result["steps"]}, {result["observations"]} observations'}
    if result['agreement'] is None:
        lines['agreement'] = 'unknown: the bag has no answers to compare with'
    else:
        lines['agreement'] = (
            f'{result["agreement"]:.4%}, {result["equal"]} of {result["answers"]} answers'
        )
        first = result['first_difference']
        lines['first differing'] = 'none' if first is None else f'observation {first}'
        largest = result['largest_difference_rad_s']
        lines['largest'] = 'unknown' if largest is None else f'{largest:.4g} rad/s'
    if result['mean_abs_distance_m'] is not None:
        lines['mean error'] = f'{result["mean_abs_distance_m"]:.4f} m from the lane centre'
        lines['mean deviation'] = f'{result["mean_distance_m"]:+.4f} m (right of the centre +)'
        lines['episodes'] = str(len(result['episodes']))
    events = result['events']
    lines['events'] = f'{events["on"]} on, {events["off"]} off in {result["packets"]} packets'
    lines['processing'] = (
        f'{result["processing_s"]:.2f} s for {result["duration_s"]:.2f} s of recording'
    )
    lines['figure'] = result['figure'] or 'none'
    notes = [in_lines({'note': note}) for note in result['notes']]
    return '\n'.join([in_lines(lines), *notes])
