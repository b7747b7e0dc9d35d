"""`spikelane course`: checks a course, says what it consists of, and draws it."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import json
import math
from pathlib import Path
from typing import Any

from spikelane_sim.course import available_courses, Course, Lane, load_course
from spikelane_sim.curve import length_of
from spikelane_sim.random_course import PREFIX


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        'course',
        metavar='COURSE',
        help=f'a course file, {PREFIX}SEED, or one of {", ".join(available_courses())}',
    )
    parser.add_argument(
        '--figure',
        type=Path,
        metavar='FILE',
        help='draw the course into this file, .png or .svg; without an ending both are written',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(options: argparse.Namespace) -> int:
    """Check a course, describe it and draw it.

    Returns:
        0.

    Raises:
        SpikelaneError: The course cannot be read or driven, or the figure cannot be written.
    """
    course = load_course(options.course)
    result = course_facts(course)
    if options.figure is not None:
        # Here and not above: importing matplotlib takes long.
        from spikelane.figures.course_map import draw_course_figure

        result['figures'] = [str(file) for file in draw_course_figure(course, options.figure)]
    print(json.dumps(result) if options.json else '\n'.join(_lines(result)))
    return 0


def course_facts(course: Course) -> dict[str, Any]:
    """Return a JSON-compatible dict that describes a course; lengths in metres."""
    return {
        'name': course.name,
        'description': course.description,
        'road_width_m': course.road_width_m,
        'lane_width_m': course.lane_width_m,
        'length_m': length_of(course.centre_line),
        'markings': len(course.markings),
        'area_m': list(course.area(0.0)),
        'lanes': {name: _lane_facts(lane) for name, lane in course.lanes.items()},
    }


def _lane_facts(lane: Lane) -> dict[str, Any]:
    return {
        'length_m': lane.length_m,
        'direction': 'against' if lane.against else 'along',
        'start': {
            'x_m': lane.start.x_m,
            'y_m': lane.start.y_m,
            'heading_deg': math.degrees(lane.start.heading_rad),
        },
        'sections': [
            {
                'name': section.name,
                'start_m': section.start_m,
                'length_m': section.end_m - section.start_m,
                'turn': _turn(section.curvature),
                'radius_m': section.radius_m if section.curvature else None,
            }
            for section in lane.sections
        ],
    }


def _turn(curvature: float) -> str:
    if not curvature:
        return 'straight'
    return 'left' if curvature > 0 else 'right'


def _lines(facts: dict[str, Any]) -> Iterator[str]:
    """Yield the lines that describe a course."""
    yield ': '.join(filter(None, (facts['name'], facts['description'])))
    yield (
        f'road: {facts["length_m"]:.3f} m long, {facts["road_width_m"]:g} m wide, lanes '
        f'{facts["lane_width_m"]:g} m wide, markings: {facts["markings"]}'
    )
    for name, lane in facts['lanes'].items():
        start = lane['start']
        yield (
            f'lane {name}: {lane["length_m"]:.3f} m long, driven {lane["direction"]} the chain, '
            f'start ({start["x_m"]:.3f}, {start["y_m"]:.3f}) m, {start["heading_deg"]:.1f} deg'
        )
        for section in lane['sections']:
            line = (
                f'  {section["name"]:<4} {section["turn"]:<8} from {section["start_m"]:8.3f} m, '
                f'{section["length_m"]:8.3f} m long'
            )
            if section['radius_m']:
                line += f', radius {section["radius_m"]:.3f} m'
            yield line
    for figure in facts.get('figures', ()):
        yield f'figure: {figure}'
