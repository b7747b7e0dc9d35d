"""Course files: YAML read into records, every value checked, every refusal with its line.

What a file may say is shown by the shipped ones in `courses/`. Whether it makes a road that can be
driven is for `course.py` to say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import math
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeVar

import yaml

from spikelane_sim.errors import CourseError

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
    try:
        text = path.read_text('utf-8')
        tree = yaml.compose(text, Loader=yaml.SafeLoader)
    except OSError as error:
        raise CourseError(f'{path}: cannot be read: {error.strerror}') from None
    except UnicodeDecodeError:
        raise CourseError(f'{path}: expected a text in UTF-8') from None
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, 'problem_mark', None)
        line = f':{mark.line + 1}' if mark else ''
        problem = getattr(error, 'problem', None) or str(error)
        raise CourseError(f'{path}{line}: not YAML: {problem}') from None
    if tree is None:
        raise CourseError(f'{path}: expected a course, got an empty file')
    return _read_course(_Value(tree, str(path), ''))


class _Value:
    """A value in the file, which knows where it stands."""

    def __init__(self, node: Any, where: str, name: str) -> None:
        self._node = node
        self._where = where
        self._name = name

    def fail(self, expected: str) -> NoReturn:
        """Refuse the value."""
        got = self._node.value
        if not isinstance(self._node, yaml.ScalarNode):
            got = 'a mapping' if isinstance(self._node, yaml.MappingNode) else 'a list'
        else:
            got = repr(got) if got else 'nothing'
        name = f'{self._name}: ' if self._name else ''
        raise CourseError(f'{self._place}: {name}expected {expected}, got {got}')

    @property
    def _place(self) -> str:
        return f'{self._where}:{self._node.start_mark.line + 1}'

    def fields(self, required: str = '', optional: str = '') -> dict[str, _Value]:
        """Return the values of a mapping that has these keys (separated by spaces)."""
        needed, known = required.split(), required.split() + optional.split()
        found = dict(self.entries())
        for name, value in found.items():
            if name not in known:
                of = f' of {self._name}' if self._name else ''
                raise CourseError(
                    f'{value._place}: unknown key {name!r}{of}, expected {", ".join(known)}'
                )
        for name in needed:
            if name not in found:
                self.fail(f'the key {name!r}')
        return found

    def entries(self) -> Iterator[tuple[str, _Value]]:
        """Yield keys and values of a mapping."""
        if not isinstance(self._node, yaml.MappingNode):
            self.fail('a mapping')
        seen = set()
        for key, node in self._node.value:
            name = _Value(key, self._where, f'key of {self._name}').text()
            value = _Value(node, self._where, f'{self._name}.{name}' if self._name else name)
            if name in seen:
                raise CourseError(f'{value._place}: {value._name}: given twice')
            seen.add(name)
            yield name, value

    def items(self) -> list[_Value]:
        """Return the values of a list."""
        if not isinstance(self._node, yaml.SequenceNode):
            self.fail('a list')
        return [
            _Value(node, self._where, f'{self._name}[{i}]')
            for i, node in enumerate(self._node.value)
        ]

    def number(self, low: float, high: float) -> float:
        """Return a number within these limits."""
        expected = f'a number from {low:g} to {high:g}'
        if not isinstance(self._node, yaml.ScalarNode) or self._node.style is not None:
            self.fail(expected)
        try:
            number = float(self._node.value)
        except ValueError:
            self.fail(expected)
        if not low <= number <= high:  # NaN neither
            self.fail(expected)
        return number

    def text(self) -> str:
        """Return a text that is not empty."""
        is_text = isinstance(self._node, yaml.ScalarNode) and self._node.tag.endswith(':str')
        if not is_text or not self._node.value.strip():
            self.fail('a text')
        return str(self._node.value).strip()

    def choice(self, *choices: str) -> str:
        """Return one of these texts."""
        if not isinstance(self._node, yaml.ScalarNode) or self._node.value not in choices:
            self.fail(' or '.join(choices))
        return str(self._node.value)

    def offset(self) -> float:
        return self.number(-LONGEST_M, LONGEST_M)

    def length(self) -> float:
        return self.number(SHORTEST_M, LONGEST_M)


def _read_course(value: _Value) -> CourseRecord:
    fields = value.fields(
        'name road_width lane_width centre_line lanes markings',
        'description floor_intensity marking_intensity',
    )
    centre = fields['centre_line'].fields('start parts')
    return CourseRecord(
        where=value._where,
        name=fields['name'].text(),
        description=_optional(fields, 'description', _Value.text, ''),
        road_width_m=fields['road_width'].length(),
        lane_width_m=fields['lane_width'].length(),
        start=_read_pose(centre['start']),
        parts=tuple(_read_part(item) for item in centre['parts'].items())
        or centre['parts'].fail('at least one part'),
        lanes=tuple(_read_lane(name, lane) for name, lane in fields['lanes'].entries())
        or fields['lanes'].fail('at least one lane'),
        markings=tuple(_read_marking(item) for item in fields['markings'].items()),
        floor_intensity=_optional(fields, 'floor_intensity', _intensity, 0.0),
        marking_intensity=_optional(fields, 'marking_intensity', _intensity, 1.0),
    )


def _read_part(value: _Value) -> Part:
    fields = value.fields('section', 'straight arc')
    if ('straight' in fields) == ('arc' in fields):
        value.fail("either 'straight' or 'arc'")
    section = fields['section'].text()
    if 'straight' in fields:
        return Part(section, fields['straight'].length(), 0.0)
    arc = fields['arc'].fields('radius angle_deg')
    radius, degrees = arc['radius'].length(), arc['angle_deg'].number(-360.0, 360.0)
    if abs(degrees) < 0.01:
        arc['angle_deg'].fail('an angle of at least 0.01 to either side')
    return Part(section, radius * math.radians(abs(degrees)), math.copysign(1 / radius, degrees))


def _read_lane(name: str, value: _Value) -> LaneRecord:
    fields = value.fields('offset direction start', 'first_section')
    return LaneRecord(
        name=name,
        offset_m=fields['offset'].offset(),
        against=fields['direction'].choice('along', 'against') == 'against',
        first_section=_optional(fields, 'first_section', _Value.text, ''),
        start=_read_start(fields['start']),
    )


def _read_start(value: _Value) -> float | tuple[float, float, float]:
    if 'position' in dict(value.entries()):
        return value.fields('position')['position'].number(0.0, 1e6)
    return _read_pose(value)


def _read_pose(value: _Value) -> tuple[float, float, float]:
    fields = value.fields('x y heading_deg')
    heading_deg = fields['heading_deg'].number(-360.0, 360.0)
    return fields['x'].offset(), fields['y'].offset(), math.radians(heading_deg)


def _read_marking(value: _Value) -> Marking:
    fields = value.fields('offset width style', 'dash gap phase ranges')
    dash = gap = math.inf
    phase = 0.0
    if fields['style'].choice('solid', 'dashed') == 'dashed':
        value.fields('offset width style dash gap', 'phase ranges')
        dash, gap = (fields[name].number(0.01, LONGEST_M) for name in ('dash', 'gap'))
        phase = _optional(fields, 'phase', _Value.offset, 0.0)
    else:
        value.fields('offset width style', 'ranges')
    ranges = fields['ranges'].items() if 'ranges' in fields else []
    return Marking(
        offset_m=fields['offset'].offset(),
        width_m=fields['width'].length(),
        dash_m=dash,
        gap_m=gap,
        phase_m=phase,
        ranges=tuple(_read_range(item) for item in ranges),
    )


def _read_range(value: _Value) -> tuple[float, float]:
    ends = value.items()
    if len(ends) != 2:
        value.fail('a list of two arc lengths, from and to')
    begin, end = (item.number(0.0, 1e6) for item in ends)
    if begin == end:
        value.fail('two different arc lengths, from and to')
    return begin, end


def _intensity(value: _Value) -> float:
    return value.number(0.0, 1.0)


def _optional(
    fields: dict[str, _Value], name: str, read: Callable[[_Value], ItemT], default: ItemT
) -> ItemT:
    return read(fields[name]) if name in fields else default
