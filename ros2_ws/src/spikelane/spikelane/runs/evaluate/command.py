"""`spikelane evaluate`: laps of each lane with several seeds, measured on the whole."""

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
from spikelane.runs.configuration import check_number
from spikelane.runs.evaluate.config import EvaluateConfig
from spikelane.runs.evaluate.run import draw_some_courses, evaluate
from spikelane.runs.evaluate.summary import UNITS, units_in_words

#: Drives that did not complete their laps, of which each has a line.
_MOST_INCOMPLETE = 20

#: The parameter of each pixel model that is its noise.
_NOISE = {'coppelia': 'coppelia.noise_rate_hz', 'esim': 'esim.shot_rate_hz'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    add_controller_arguments(parser)
    parser.add_argument(
        '--seeds', type=int, default=1, help='number of seeds, starting at --seed (default: 1)'
    )
    parser.add_argument(
        '--laps', type=int, help='consecutive laps for each lane and seed (default: 1)'
    )
    parser.add_argument(
        '--lanes', nargs='+', default=(), metavar='LANE', help='lanes to drive (default: all)'
    )
    parser.add_argument(
        '--courses',
        nargs='+',
        default=(),
        metavar='COURSE',
        help='scenarios or course files to drive instead of --scenario; random:N means the N '
        'random courses of seeds 0 to N - 1, random:FIRST-LAST means those of these seeds',
    )
    parser.add_argument(
        '--latency-ms',
        type=int,
        metavar='MS',
        help='delay from an observation to its command, a multiple of 50 [ms] (default: 0)',
    )
    parser.add_argument(
        '--event-loss',
        type=float,
        metavar='SHARE',
        help='share of events that are lost, 0 to 1 (default: 0)',
    )
    parser.add_argument(
        '--noise-hz',
        type=float,
        metavar='HZ',
        help='rate of noise events of each pixel [Hz] (default: 0)',
    )
    parser.add_argument(
        '--resume', action='store_true', help='resume the evaluation in the folder'
    )
    add_record_argument(parser)
    add_configuration_arguments(parser, transport='inprocess', out='runs/evaluate-...')


def run(options: argparse.Namespace) -> int:
    """Evaluate.

    Returns:
        0, whether laps were completed or not.

    Raises:
        SpikelaneError: An option is wrong, or something failed.
    """
    config = EvaluateConfig.make(
        request_of(options, _parameters(options)),
        {'seeds': options.seeds, 'lanes': options.lanes, 'courses': options.courses},
    )
    record = parse_names(options.record)
    check_recordable(config, record)
    with run_folder(options, config, '%') as (folder, show):
        metrics = evaluate(config, folder, lambda steps, share: show(steps, 100.0 * share), record)
        result = {**metrics, 'folder': str(folder.path)}
        if 'by_course' in metrics['summary']:
            result['figure'] = str(draw_some_courses(config, folder, metrics))
    print(json.dumps(result) if options.json else _summary(config, result))
    return 0


def _parameters(options: argparse.Namespace) -> dict[str, Any]:
    # A simulator takes 0 laps for a drive without end.
    check_number('--laps', options.laps, 1, 1_000_000)
    given = given_parameters(options) | given_weights(options)
    model = str(given.get('simulator.pixels.model', 'coppelia'))
    flags = {
        'simulator.episode.max_laps': options.laps,
        'simulator.link.latency_ms': options.latency_ms,
        'simulator.link.event_loss': options.event_loss,
        f'simulator.pixels.{_NOISE.get(model, _NOISE["coppelia"])}': options.noise_hz,
    }
    return given | {name: value for name, value in flags.items() if value is not None}


def _summary(config: EvaluateConfig, result: dict[str, Any]) -> str:
    """Return the results for people.

    They are a line for each lane, how far each drive came that did not complete its laps, and
    what the intervals are over.
    """
    groups = dict(result['summary']['by_lane'])
    if len(groups) > 1:
        groups['all'] = result['summary']['all']
    lines = [_line(name, group) for name, group in groups.items()]
    lines += _incomplete(config, result)
    if courses := result['summary'].get('courses_completed'):
        lines.append(
            f'{"courses":10} all laps completed on {courses["successes"]} of {courses["n"]} '
            f'(95 %: {courses["ci_low"]:.3f} to {courses["ci_high"]:.3f})'
        )
    every = result['summary']['all']
    lines.append(f'{"intervals":10} over {UNITS[every["unit"]]}: {units_in_words(every)}')
    lines += [
        f'{"note":10} {lap["course"]}, {lap["lane"]} lane, seed {lap["seed"]}: {note}'
        for lap in result['laps']
        for note in lap.get('notes', ())
    ]
    return '\n'.join([*lines, f'{"folder":10} {result["folder"]}'])


def _incomplete(config: EvaluateConfig, result: dict[str, Any]) -> list[str]:
    """Return a line for each drive that did not complete its laps, of the first ones."""
    several = 'by_course' in result['summary']
    lines = []
    for each, lap in zip(config.laps(), result['laps'], strict=True):
        if lap['completed']:
            continue
        place = f'{lap["course"]}, ' if several else ''
        length_m = each.length_m * max(1, config.simulator.episode.max_laps)
        lines.append(
            f'{"":10} {place}{lap["lane"]}, seed {lap["seed"]}: '
            f'{lap["reason"].replace("_", " ")} after {lap["progress_m"]:.1f} of {length_m:.1f} m'
        )
    if len(lines) > _MOST_INCOMPLETE:
        left = len(lines) - _MOST_INCOMPLETE
        lines = [*lines[:_MOST_INCOMPLETE], f'{"":10} and {left} more, in metrics.json']
    return lines


def _line(name: str, group: dict[str, Any]) -> str:
    completed, error = group['completed'], group['mean_abs_distance_m']
    text = f'{name:10} {completed["successes"]} of {completed["n"]} completed'
    if error is None:
        return text
    text += f', mean error {error["mean"]:.4f} m'
    if error['std'] is None:
        return text
    return f'{text} (95 %: {error["ci_low"]:.4f} to {error["ci_high"]:.4f}, s {error["std"]:.4f})'
