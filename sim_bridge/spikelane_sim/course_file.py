"""Course files: YAML read into records, every value checked, every refusal with its line.

What a file may say is shown by the shipped ones in `courses/`. Whether it makes a road that can be
driven is for `course.py` to say.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from pathlib import Path
from typing import NamedTuple, TypeVar

from spikelane_sim.errors import CourseError
from spikelane_sim.yaml_file import read_yaml, YamlValue

ItemT = TypeVar('ItemT')

LONGEST_M = 1000.0  # of any length or coordinate in a file
SHORTEST_M = 0.001  # of any length


class Part(NamedTuple):
    """One straight or arc of the road's centre line."""

    section: str
    length_m: float
    curvature: float  # [1/m], left positive, 0 for a straight


class LaneRecord(NamedTuple):
    """A lane as its file describes it."""

    name: str
    offset_m: float  # of its centre, to the right of the road's centre line along the chain
    against: bool  # driven against the chain's direction
    first_section: str  # the one whose beginning is position 0; '' for the first of the chain
    start: (
        float | tuple[float, float, float]
    )  # position on the lane [m], or x, y [m], heading [rad]


class Marking(NamedTuple):
    """A painted line along the road."""

    offset_m: float  # of its middle, to the right of the road's centre line along the chain
    width_m: float
    dash_m: float  # infinite for a solid line
    gap_m: float
    phase_m: float  # a dash begins at this arc length of the road's centre line
    ranges: tuple[tuple[float, float], ...]  # arc lengths where it is painted; empty: everywhere


class CourseRecord(NamedTuple):
    """A course as its file describes it."""

    where: str  # the file, for messages
    name: str
    description: str
    road_width_m: float
    lane_width_m: float
    start: tuple[float, float, float]  # x, y [m], heading [rad] of the chain
    parts: tuple[Part, ...]
    lanes: tuple[LaneRecord, ...]
    markings: tuple[Marking, ...]
    floor_intensity: float
    marking_intensity: float


def read_course_file(path: Path) -> CourseRecord:
    """Read a course file.

    Raises:
        CourseError: It cannot be read, is not YAML, or a value is missing, unknown, of the wrong
            type or out of range; the message says where, what was expected and what came.
    """
    return _read_course(read_yaml(path, 'a course', CourseError))


def _read_course(value: YamlValue) -> CourseRecord:
    fields = value.fields(
        'name road_width lane_width centre_line lanes markings',
        'description floor_intensity marking_intensity',
    )
    centre = fields['centre_line'].fields('start parts')
    return CourseRecord(
        where=value.where,
        name=fields['name'].text(),
        description=_optional(fields, 'description', YamlValue.text, ''),
        road_width_m=_length(fields['road_width']),
        lane_width_m=_length(fields['lane_width']),
        start=_read_pose(centre['start']),
        parts=tuple(_read_part(item) for item in centre['parts'].items())
        or centre['parts'].fail('at least one part'),
        lanes=tuple(_read_lane(name, lane) for name, lane in fields['lanes'].entries())
        or fields['lanes'].fail('at least one lane'),
        markings=tuple(_read_marking(item) for item in fields['markings'].items()),
        floor_intensity=_optional(fields, 'floor_intensity', _intensity, 0.0),
        marking_intensity=_optional(fields, 'marking_intensity', _intensity, 1.0),
    )


def _read_part(value: YamlValue) -> Part:
    fields = value.fields('section', 'straight arc')
    if ('straight' in fields) == ('arc' in fields):
        value.fail("either 'straight' or 'arc'")
    section = fields['section'].text()
    if 'straight' in fields:
        return Part(section, _length(fields['straight']), 0.0)
    arc = fields['arc'].fields('radius angle_deg')
    radius, degrees = _length(arc['radius']), arc['angle_deg'].number(-360.0, 360.0)
    if abs(degrees) < 0.01:
        arc['angle_deg'].fail('an angle of at least 0.01 to either side')
    return Part(section, radius * math.radians(abs(degrees)), math.copysign(1 / radius, degrees))


def _read_lane(name: str, value: YamlValue) -> LaneRecord:
    fields = value.fields('offset direction start', 'first_section')
    return LaneRecord(
        name=name,
        offset_m=_offset(fields['offset']),
        against=fields['direction'].choice('along', 'against') == 'against',
        first_section=_optional(fields, 'first_section', YamlValue.text, ''),
        start=_read_start(fields['start']),
    )


def _read_start(value: YamlValue) -> float | tuple[float, float, float]:
    if 'position' in dict(value.entries()):
        return value.fields('position')['position'].number(0.0, 1e6)
    return _read_pose(value)


def _read_pose(value: YamlValue) -> tuple[float, float, float]:
    fields = value.fields('x y heading_deg')
    heading_deg = fields['heading_deg'].number(-360.0, 360.0)
    return _offset(fields['x']), _offset(fields['y']), math.radians(heading_deg)


def _read_marking(value: YamlValue) -> Marking:
    fields = value.fields('offset width style', 'dash gap phase ranges')
    dash = gap = math.inf
    phase = 0.0
    if fields['style'].choice('solid', 'dashed') == 'dashed':
        value.fields('offset width style dash gap', 'phase ranges')
        dash, gap = (fields[name].number(0.01, LONGEST_M) for name in ('dash', 'gap'))
        phase = _optional(fields, 'phase', _offset, 0.0)
    else:
        value.fields('offset width style', 'ranges')
    ranges = fields['ranges'].items() if 'ranges' in fields else []
    return Marking(
        offset_m=_offset(fields['offset']),
        width_m=_length(fields['width']),
        dash_m=dash,
        gap_m=gap,
        phase_m=phase,
        ranges=tuple(_read_range(item) for item in ranges),
    )


def _read_range(value: YamlValue) -> tuple[float, float]:
    ends = value.items()
    if len(ends) != 2:
        value.fail('a list of two arc lengths, from and to')
    begin, end = (item.number(0.0, 1e6) for item in ends)
    if begin == end:
        value.fail('two different arc lengths, from and to')
    return begin, end


def _offset(value: YamlValue) -> float:
    return value.number(-LONGEST_M, LONGEST_M)


def _length(value: YamlValue) -> float:
    return value.number(SHORTEST_M, LONGEST_M)


def _intensity(value: YamlValue) -> float:
    return value.number(0.0, 1.0)


def _optional(
    fields: dict[str, YamlValue], name: str, read: Callable[[YamlValue], ItemT], default: ItemT
) -> ItemT:
    return read(fields[name]) if name in fields else default
