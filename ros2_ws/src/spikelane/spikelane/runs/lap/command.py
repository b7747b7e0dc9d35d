"""`spikelane lap`: one controller, one lap; recorded, measured and drawn."""

from __future__ import annotations

import argparse
import json
from typing import Any

from spikelane.recording.record import check_recordable, parse_names
from spikelane.runs.arguments import (
    add_configuration_arguments,
    add_controller_arguments,
    add_record_argument,
    given_parameters,
    given_weights,
    request_of,
)
from spikelane.runs.command import run_folder
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.run import drive, report_lap
from spikelane.runs.output import in_lines


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    add_controller_arguments(parser)
    parser.add_argument('--lane', help="outer or inner (default: the course's first, outer)")
    add_record_argument(parser)
    add_configuration_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Drive the lap.

    Returns:
        0 where the lap was completed, otherwise 1.

    Raises:
        SpikelaneError: An option is wrong, or something failed.
    """
    asked = request_of(options, given_parameters(options) | given_weights(options))
    config = LapConfig.make(asked, options.lane)
    record = parse_names(options.record)
    check_recordable(config, record)
    with run_folder(options, config) as (folder, show):
        result = report_lap(config, drive(config, folder, show, record=record), folder)
    print(json.dumps(result) if options.json else _summary(result))
    return 0 if result['completed'] else 1


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
        **({'recording': result['recording']} if 'recording' in result else {}),
    }
    notes = [in_lines({'note': note}) for note in result.get('notes', ())]
    return '\n'.join([in_lines(lines), *notes])
