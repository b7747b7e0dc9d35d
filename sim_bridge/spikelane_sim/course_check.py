"""What a course must fulfil to be driven: closed, wide enough in its turns, apart from itself."""

from __future__ import annotations

import math
from typing import NoReturn

import numpy as np

from spikelane_sim import curve as curves
from spikelane_sim.course_file import CourseRecord
from spikelane_sim.curve import Curve
from spikelane_sim.errors import CourseError

#: A chain is closed if its end meets its start to within this [m], [rad].
CLOSED_M = CLOSED_RAD = 1e-6


def check_course(record: CourseRecord, centre_line: Curve) -> None:
    """Check a course whose centre line is this curve.

    Raises:
        CourseError: It cannot be driven; the message says why.
    """
    _check_closed(record, centre_line)
    _check_room(record)
    _check_apart(record, centre_line)
    _check_ranges(record, curves.length_of(centre_line))


def refuse(record: CourseRecord, thing: str, expected: str, got: str) -> NoReturn:
    """Refuse a thing in a course file."""
    raise CourseError(f'{record.where}: {thing}: expected {expected}, got {got}')


def _check_closed(record: CourseRecord, centre_line: Curve) -> None:
    x, y, heading = curves.end_pose(centre_line)
    gap = math.hypot(x - record.start[0], y - record.start[1])
    turn = abs(curves.wrap_angle(heading - record.start[2]))
    if gap > CLOSED_M or turn > CLOSED_RAD:
        end = f'({x:.6f}, {y:.6f}) m, {math.degrees(heading):.6f} deg'
        refuse(
            record,
            'centre_line',
            f'an end that meets its start to {CLOSED_M:g} m and rad',
            f'a gap of {gap:.3g} m and {turn:.3g} rad (the chain ends at {end})',
        )


def _check_room(record: CourseRecord) -> None:
    """Check that the lanes and markings are on the road, and that it can turn so tightly."""
    half = record.road_width_m / 2
    for lane in record.lanes:
        if abs(lane.offset_m) + record.lane_width_m / 2 > half + CLOSED_M:
            expected = f'a lane within the road ({half:g} m to either side)'
            got = f'{record.lane_width_m:g} m of width at {lane.offset_m:g} m'
            refuse(record, f'lanes.{lane.name}.offset', expected, got)
    for i, marking in enumerate(record.markings):
        if abs(marking.offset_m) > half + CLOSED_M:
            expected = f'at most {half:g} m to either side, half of road_width'
            refuse(record, f'markings[{i}].offset', expected, f'{marking.offset_m:g} m')
    for i, part in enumerate(record.parts):
        if part.curvature:
            _check_turn(record, f'centre_line.parts[{i}] (section {part.section})', part.curvature)


def _check_turn(record: CourseRecord, thing: str, curvature: float) -> None:
    for lane in record.lanes:
        radius = math.copysign(1.0, curvature) * (1.0 / curvature + lane.offset_m)
        if radius <= record.lane_width_m / 2:
            expected = f'lane {lane.name!r} to turn with more than {record.lane_width_m / 2:g} m'
            refuse(record, thing, expected, f'a radius of {radius:.3g} m: too tight')
    widest = max((m.width_m / 2 for m in record.markings), default=0.0)
    needed = record.road_width_m / 2 + widest
    if 1.0 / abs(curvature) <= needed:
        expected = f'a radius of more than {needed:g} m, half of the road and its markings'
        refuse(record, thing, expected, f'{1.0 / abs(curvature):g} m: too tight')


def _check_apart(record: CourseRecord, centre_line: Curve) -> None:
    width = record.road_width_m
    distance, s_1, s_2 = curves.closest_approach(centre_line, min(width / 10, 0.1))
    if distance < width - CLOSED_M:
        starts = centre_line[:, curves.START]
        names = [record.parts[int(np.searchsorted(starts, s, 'right')) - 1] for s in (s_1, s_2)]
        refuse(
            record,
            'centre_line',
            f'parts of the road at least its width of {width:g} m apart',
            f'an overlap: sections {names[0].section} and {names[1].section} come within '
            f'{distance:.3f} m (at {s_1:.2f} and {s_2:.2f} m along the chain)',
        )


def _check_ranges(record: CourseRecord, total: float) -> None:
    for i, marking in enumerate(record.markings):
        for begin, end in marking.ranges:
            if max(begin, end) > total + CLOSED_M:
                expected = f'arc lengths from 0 to {total:.6g} m'
                refuse(record, f'markings[{i}].ranges', expected, f'[{begin:g}, {end:g}]')
