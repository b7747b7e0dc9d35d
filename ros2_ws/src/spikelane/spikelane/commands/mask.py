"""`spikelane mask`: the hot pixels of a camera, found in a recording, for the filter of them."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from spikelane.bag.drive import RecordedDrive
from spikelane.bag.events import recorded_events
from spikelane.runs.arguments import add_parameter_arguments, parse_parameters
from spikelane_sim.filters.hot_pixels import (
    count_pixels,
    find_hot_pixels,
    HotPixelSearchParameters,
    write_hot_pixels,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.description = (
        'Find the pixels of an event camera that fire by themselves, and write them for '
        '--param filter.hot_pixels.file=FILE. The bag may be any that `spikelane replay` reads; '
        'best is half a minute of a scene in which little moves.'
    )
    parser.add_argument(
        'bag', type=Path, metavar='BAG', help="a bag's folder, or one of its .mcap or .db3 files"
    )
    parser.add_argument('out', type=Path, metavar='FILE', help='file to write, such as hot.json')
    parser.add_argument(
        '--events',
        metavar='TOPIC',
        help='topic of the event packets (default: /event_camera/events, or the only one)',
    )
    add_parameter_arguments(parser, example='least_rate_hz=20')
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(options: argparse.Namespace) -> int:
    """Find the hot pixels.

    Returns:
        0, also where there are none.

    Raises:
        SpikelaneError: An option is wrong, the bag cannot be read, or the file not be written.
    """
    parameters = HotPixelSearchParameters.from_mapping(parse_parameters(options.param))
    recorded = recorded_events(RecordedDrive(options.bag, options.events))
    counts = count_pixels(recorded.events, recorded.width, recorded.height)
    found = find_hot_pixels(counts, recorded.duration_s, parameters)
    write_hot_pixels(options.out, found)
    x, y = found.pixels.T
    result = {
        'file': str(options.out),
        'width': found.width,
        'height': found.height,
        'duration_s': recorded.duration_s,
        'events': len(recorded.events),
        'hot_pixels': len(found.pixels),
        'events_of_hot_pixels': int(counts[y, x].sum()),
    }
    print(json.dumps(result) if options.json else _summary(result))
    return 0


def _summary(result: dict[str, object]) -> str:
    return (
        f'{result["hot_pixels"]} hot pixels of {result["width"]} x {result["height"]}, with '
        f'{result["events_of_hot_pixels"]} of {result["events"]} events in '
        f'{result["duration_s"]:.2f} s: {result["file"]}'
    )
