"""The course: a closed road with lanes and markings, read from a file.

This is the one place for geometry: where a robot is on its lane, how far it has come, and what is
painted on the ground. Positions are in the world frame, x right and y up; distances across a lane
or the road are positive to the right (`contract.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
import contextlib
import dataclasses
import functools
import math
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spikelane_sim import curve as curves
from spikelane_sim.course_check import check_course, refuse
from spikelane_sim.course_file import CourseRecord, LaneRecord, Marking, read_course_file
from spikelane_sim.curve import Curve
from spikelane_sim.errors import CourseError
from spikelane_sim.ground import Ground, make_ground
from spikelane_sim.random_course import draw_records, is_random, PREFIX
from spikelane_sim.raster import are_painted

_AREA_STEP_M = 0.1
_COURSES = Path(__file__).parent / 'courses'


class Section(NamedTuple):
    """A straight or a turn of a lane."""

    name: str
    start_m: float  # position along the lane where it begins
    end_m: float  # where the next one begins; the lane's length for the last
    curvature: float  # [1/m], left positive, 0 on a straight

    @property
    def radius_m(self) -> float:
        """Radius of the lane's centre [m], infinite on a straight."""
        return math.inf if self.curvature == 0.0 else 1.0 / abs(self.curvature)


class Pose(NamedTuple):
    """Where a robot stands."""

    x_m: float
    y_m: float
    heading_rad: float  # from the x axis, left positive, [-pi, pi)


class Area(NamedTuple):
    """A rectangle in the world frame."""

    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float

    def contains(self, x_m: float, y_m: float) -> bool:
        """Return whether a point is in it; none that is not finite is."""
        return self.x_min_m <= x_m <= self.x_max_m and self.y_min_m <= y_m <= self.y_max_m


class LanePoint(NamedTuple):
    """Where a robot is on a lane."""

    distance_m: float  # from the lane's centre, right of it positive
    heading_error_rad: float  # robot's heading less the lane's, left positive, [-pi, pi)
    position_m: float  # along the lane's centre, [0, length)
    section: int  # index in the lane's sections


class LanePoints(NamedTuple):
    """The same for many poses; all arrays have the poses' shape."""

    distance_m: NDArray[np.float64]
    heading_error_rad: NDArray[np.float64]
    position_m: NDArray[np.float64]
    section: NDArray[np.int64]


@dataclasses.dataclass(frozen=True, eq=False)
class Lane:
    """A lane, driven in one direction.

    Attributes:
        name: Its name in the course's file.
        offset_m: Distance of its centre from the road's centre line [m]; right of it is positive,
            seen along the chain.
        against: Whether it is driven against the chain's direction.
        centre: The curve along its centre, in its direction, from position 0.
        sections: The sections in the order they are driven.
        start: Where robots start.
    """

    name: str
    offset_m: float
    against: bool
    centre: Curve
    sections: tuple[Section, ...]
    start: Pose

    @property
    def length_m(self) -> float:
        """Length of one lap along the lane's centre [m]."""
        return curves.length_of(self.centre)


@dataclasses.dataclass(frozen=True, eq=False)
class Course:
    """A closed road; made by `load_course`.

    Attributes:
        name: As its file says.
        description: As its file says, one sentence.
        road_width_m: Width of the road.
        lane_width_m: Width of a lane.
        centre_line: The curve along the road's centre.
        lanes: By name; the first is the default.
        markings: The painted lines, as the course's file describes them.
        ground: The markings, for renderers.
    """

    name: str
    description: str
    road_width_m: float
    lane_width_m: float
    centre_line: Curve
    lanes: Mapping[str, Lane]
    markings: tuple[Marking, ...]
    ground: Ground

    def __deepcopy__(self, memo: dict[int, Any]) -> Course:
        """Return itself, as nothing in it changes."""
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what pickle needs, which takes no read-only mapping."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return _course_of, (values | {'lanes': dict(self.lanes)},)

    def lane(self, name: str) -> Lane:
        """Return a lane by name.

        Raises:
            CourseError: There is no such lane.
        """
        try:
            return self.lanes[name]
        except KeyError:
            expected = ' or '.join(self.lanes)
            raise CourseError(f'lane: expected {expected}, got {name!r}') from None

    @overload
    def locate(  # type: ignore[overload-overlap]  # a float is an ArrayLike too
        self, lane: str, x_m: float, y_m: float, heading_rad: float
    ) -> LanePoint: ...
    @overload
    def locate(
        self, lane: str, x_m: ArrayLike, y_m: ArrayLike, heading_rad: ArrayLike
    ) -> LanePoints: ...
    def locate(
        self, lane: str, x_m: ArrayLike, y_m: ArrayLike, heading_rad: ArrayLike
    ) -> LanePoint | LanePoints:
        """Find where robots are on a lane: at the nearest point of its centre.

        Args:
            lane: Name of the lane.
            x_m: Position [m]; numbers for one pose, arrays of one shape for many.
            y_m: Position [m].
            heading_rad: Heading [rad].

        Raises:
            CourseError: There is no such lane.
        """
        centre = self.lane(lane).centre
        if isinstance(x_m, float) and isinstance(y_m, float) and isinstance(heading_rad, float):
            return LanePoint(*curves.nearest_on_curve(centre, x_m, y_m, heading_rad))
        columns = [np.asarray(column, np.float64) for column in (x_m, y_m, heading_rad)]
        x, y, heading = np.broadcast_arrays(*columns)
        if not x.shape:
            return LanePoint(*curves.nearest_on_curve(centre, *(c.item() for c in columns)))
        found = curves.nearest_on_curve_many(centre, x.ravel(), y.ravel(), heading.ravel())
        return LanePoints(*(column.reshape(x.shape) for column in found))

    def area(self, margin_m: float) -> Area:
        """Return the rectangle around the road, with a margin on all sides.

        Args:
            margin_m: Between the road's edge and the rectangle.
        """
        points = self.outline(0.0, _AREA_STEP_M)
        # Between two points the road's centre line is at most half their distance farther out.
        beyond_m = self.road_width_m / 2 + _AREA_STEP_M / 2 + margin_m
        low, high = points.min(axis=0) - beyond_m, points.max(axis=0) + beyond_m
        return Area(*low.tolist(), *high.tolist())

    def section_name(self, lane: str, index: int) -> str:
        """Return the name of a lane's section, 'A' to 'F' on the paper's course."""
        return self.lane(lane).sections[index].name

    def intensity(self, x_m: ArrayLike, y_m: ArrayLike) -> NDArray[np.float64]:
        """Return the linear intensity of points on the ground, from 0 to 1, exactly."""
        x, y = np.broadcast_arrays(np.asarray(x_m, np.float64), np.asarray(y_m, np.float64))
        painted = are_painted(self.ground.pieces, x.ravel(), y.ravel()).reshape(x.shape)
        return np.where(painted, self.ground.marking_intensity, self.ground.floor_intensity)

    def outline(self, line: str | float, step_m: float) -> NDArray[np.float64]:
        """Return points along a lane's centre, or along a parallel to the road's centre line.

        Args:
            line: Name of a lane, or an offset to the right of the road's centre line [m].
            step_m: Largest distance between points.

        Returns:
            Points (N, 2) in metres, the last the same as the first.
        """
        if isinstance(line, str):
            along = self.lane(line).centre
        else:
            along = curves.offset_curve(self.centre_line, line)
        length = curves.length_of(along)
        n = math.ceil(length / step_m)
        return curves.poses_along(along, np.arange(n + 1) * (length / n) % length)[:, :2]


def available_courses() -> tuple[str, ...]:
    """Return the names of the shipped courses."""
    return tuple(sorted(path.stem for path in _COURSES.glob('*.yaml')))


def scenario_course(scenario: str | int) -> str:
    """Return the course of a scenario: the paper's 1, 2 and 3 by number, others as they are."""
    return f'scenario_{scenario}' if str(scenario).isdigit() else str(scenario)


def course_label(scenario: str) -> str:
    """Return what a course is called in names of folders and files."""
    return scenario.replace(':', '-') if is_random(scenario) else Path(scenario).stem


def load_course(name_or_path: str) -> Course:
    """Load a shipped course by name, a course file by path, or a random course by its seed.

    Args:
        name_or_path: A name of `available_courses`, a path, or 'random:SEED' (`random_course.py`).

    Raises:
        CourseError: There is no such course, the file cannot be read, or what it describes
            cannot be driven; the message says why.
    """
    if is_random(name_or_path):
        return _random_course(name_or_path)
    if name_or_path in available_courses():
        return _shipped_course(name_or_path)
    if not Path(name_or_path).is_file():
        known = ', '.join(available_courses())
        raise CourseError(
            f'course: expected {known}, {PREFIX}SEED or the path of a course file, '
            f'got {name_or_path!r}'
        )
    return make_course(read_course_file(Path(name_or_path)))


@functools.cache  # experiments ask for the same few again and again
def _shipped_course(name: str) -> Course:
    return make_course(read_course_file(_COURSES / f'{name}.yaml'))


@functools.lru_cache(maxsize=64)
def _random_course(name: str) -> Course:
    for record in draw_records(name):
        with contextlib.suppress(CourseError):
            return make_course(record)
    raise AssertionError('drawing never ends')


@functools.lru_cache(maxsize=64)
def make_course(record: CourseRecord) -> Course:
    """Make a course from what its file says; the same record gives the same object again.

    Raises:
        CourseError: It cannot be driven; the message says why.
    """
    parts = [(part.length_m, part.curvature) for part in record.parts]
    centre_line = curves.make_curve(record.start, parts)
    check_course(record, centre_line)
    lanes = {lane.name: _make_lane(record, centre_line, lane) for lane in record.lanes}
    return Course(
        name=record.name,
        description=record.description,
        road_width_m=record.road_width_m,
        lane_width_m=record.lane_width_m,
        centre_line=centre_line,
        lanes=MappingProxyType(lanes),
        markings=record.markings,
        ground=make_ground(
            centre_line, record.markings, record.floor_intensity, record.marking_intensity
        ),
    )


def _make_lane(record: CourseRecord, centre_line: Curve, lane: LaneRecord) -> Lane:
    centre = curves.offset_curve(centre_line, lane.offset_m)
    names = [part.section for part in record.parts]
    if lane.against:
        centre, names = curves.reverse_curve(centre), names[::-1]
    if lane.first_section and lane.first_section not in names:
        expected = ', '.join(names)
        refuse(record, f'lanes.{lane.name}.first_section', expected, repr(lane.first_section))
    first = names.index(lane.first_section) if lane.first_section else 0
    centre, names = curves.begin_at(centre, first), names[first:] + names[:first]
    starts = centre[:, curves.START].tolist()
    ends = starts[1:] + [curves.length_of(centre)]
    curvatures = centre[:, curves.CURVATURE].tolist()
    sections = tuple(map(Section, names, starts, ends, curvatures))
    start = _start_pose(record, lane, centre)
    return Lane(lane.name, lane.offset_m, lane.against, centre, sections, start)


def _start_pose(record: CourseRecord, lane: LaneRecord, centre: Curve) -> Pose:
    thing, length = f'lanes.{lane.name}.start', curves.length_of(centre)
    if isinstance(lane.start, float):
        if lane.start >= length:
            refuse(record, thing, f'a position below {length:.3f} m', f'{lane.start:g} m')
        x, y, heading = curves.poses_along(centre, lane.start).tolist()
        return Pose(x, y, curves.wrap_angle(heading))
    x, y, heading = lane.start
    distance, error, _, _ = curves.nearest_on_curve(centre, x, y, heading)
    if abs(distance) > record.lane_width_m / 2 or abs(error) > math.pi / 2:
        got = f'one {abs(distance):.3f} m from its centre, turned {math.degrees(error):.0f} deg'
        refuse(record, thing, 'a pose on the lane, facing along it', got)
    return Pose(x, y, curves.wrap_angle(heading))


def _course_of(values: dict[str, Any]) -> Course:
    """Return the course that was pickled."""
    return Course(**values | {'lanes': MappingProxyType(values['lanes'])})
