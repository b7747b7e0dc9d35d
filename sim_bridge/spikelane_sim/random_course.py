"""Random courses: a seed makes a closed road that can be driven, the same one everywhere.

The centre line is a polygon driven counter-clockwise whose corners are rounded, so that it closes
whatever is drawn. The polygon's corners lie at about equal angles around a centre, at random
distances from it. What is drawn anew: what `course_check.py` refuses; what has a corner too sharp
or an edge too short; and, for three courses in four, what turns to the left only.

As in the paper's scenario 1, the road has two lanes, two solid edges and a dashed centre line.
Drawn are its curvature, the width of its lanes, its dashes, and how bright floor and markings
are. Noise of the sensor is a parameter of the simulator's pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
import itertools
import math
from typing import NamedTuple

import numpy as np

from spikelane_sim.course_file import CourseRecord, LaneRecord, Marking, Part
from spikelane_sim.errors import CourseError

#: Random courses that one name stands for.
MOST_COURSES = 100_000

PREFIX = 'random:'

#: Seeds are below this.
SEEDS = 2**32

# From what is drawn, uniformly. Metres; the paper's road has turns of 2 and 3 m, lanes of 0.5 m,
# dashes and gaps of 0.3 m, a floor of intensity 0 and markings of 1.
_CORNERS = (5, 9)
_SIZE_M = (6.0, 9.0)  # largest distance of a corner from the centre
_INDENT = (0.4, 1.0)  # of a corner's distance, in parts of the largest
_SHIFT = 0.3  # of a corner's angle to either side, in parts of the angle between two
RADIUS_M = (1.5, 4.0)  # of a turn of the centre line
LANE_WIDTH_M = (0.4, 0.6)
DASH_M = (0.2, 0.5)
GAP_M = (0.2, 0.5)
FLOOR_INTENSITY = (0.0, 0.2)
MARKING_INTENSITY = (0.6, 1.0)

_LINE_M = 0.04  # width of a marking
_STRAIGHT_M = 0.4  # at least this long
_FIRST_STRAIGHT_M = 1.0  # the one that robots start on
_TURN_RAD = math.radians(15.0)  # of a corner, at least
_START_M = 0.5
_BOTH_WAYS = 0.75  # share of courses that turn to the right, too
_TRIES = 10_000
# Coarser than what mathematical libraries differ by, finer than what a chain must close to.
_DECIMALS = 9


class _Corner(NamedTuple):
    """A rounded corner of the polygon, and the straight that leads to it."""

    straight_m: float
    radius_m: float
    turn_rad: float  # left positive


def is_random(name: str) -> bool:
    """Return whether a name is that of a random course, well-formed or not."""
    return name.startswith(PREFIX)


def draw_records(name: str) -> Iterator[CourseRecord]:
    """Draw roads until one can be driven, which is for the caller to find out.

    The first that `check_course` accepts is the random course of the name.

    Args:
        name: 'random:SEED', as in random:7.

    Raises:
        CourseError: The name is another.
    """
    rng = np.random.default_rng(_number(name, name.removeprefix(PREFIX), 'SEED'))
    both_ways = rng.random() < _BOTH_WAYS
    for _ in range(_TRIES):
        corners = _draw_corners(rng)
        if corners is None or both_ways == all(corner.turn_rad > 0 for corner in corners):
            continue
        yield _draw_record(name, corners, rng)
    raise AssertionError(f'{name}: no road in {_TRIES} tries')  # one in about forty is one


def expand_courses(name: str) -> tuple[str, ...]:
    """Return the courses that a name stands for in a list of courses.

    Args:
        name: 'random:N', the random courses of seeds 0 to N - 1; 'random:FIRST-LAST', those of
            these seeds; or the name of a course, which stands for itself.

    Raises:
        CourseError: It begins like random courses, and is no such name.
    """
    if not is_random(name):
        return (name,)
    first, dash, last = name.removeprefix(PREFIX).partition('-')
    begin = _number(name, first, 'FIRST-LAST') if dash else 0
    end = _number(name, last, 'FIRST-LAST') + 1 if dash else _number(name, first, 'N')
    if not 0 < end - begin <= MOST_COURSES:
        raise CourseError(f'course: expected 1 to {MOST_COURSES} random courses, got {name!r}')
    return tuple(f'{PREFIX}{seed}' for seed in range(begin, end))


def _number(name: str, text: str, form: str) -> int:
    is_number = text.isascii() and text.isdigit() and len(text) <= len(str(SEEDS))
    if not is_number or int(text) >= SEEDS:
        expected = f'{PREFIX}{form} with whole numbers below 2^32'
        raise CourseError(f'course: expected {expected}, got {name!r}')
    return int(text)


def _between(rng: np.random.Generator, bounds: tuple[float, float], decimals: int) -> float:
    low, high = bounds
    return round(low + (high - low) * rng.random(), decimals)


def _draw_corners(rng: np.random.Generator) -> list[_Corner] | None:
    """Draw a polygon and round its corners; None where one is too sharp or an edge too short."""
    low, high = _CORNERS
    n = low + int((high - low + 1) * rng.random())
    size = _between(rng, _SIZE_M, 3)
    radii = [size * _between(rng, _INDENT, 3) for _ in range(n)]
    angles = [(i + _between(rng, (-_SHIFT, _SHIFT), 3)) * math.tau / n for i in range(n)]
    points = [
        complex(r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angles, strict=True)
    ]
    edges = [after - point for point, after in itertools.pairwise([*points, points[0]])]
    corners = _round_corners(edges, rng)
    if corners is None:
        return None
    # The longest straight comes first.
    first = max(range(n), key=lambda i: corners[i].straight_m)
    return corners[first:] + corners[:first]


def _round_corners(edges: list[complex], rng: np.random.Generator) -> list[_Corner] | None:
    """Round the corner at the end of each edge; None where that cannot be."""
    turns, radii = [], []
    for edge, after in itertools.pairwise([*edges, edges[0]]):
        turn = _angle_between(edge, after)
        # A corner takes at most half of either edge.
        room = (min(abs(edge), abs(after)) - _STRAIGHT_M) / 2
        largest = min(RADIUS_M[1], room / math.tan(abs(turn) / 2)) if turn else 0.0
        if abs(turn) < _TURN_RAD or largest < RADIUS_M[0]:
            return None
        turns.append(turn)
        radii.append(_between(rng, (RADIUS_M[0], largest), 3))
    tangents = [r * math.tan(abs(turn) / 2) for r, turn in zip(radii, turns, strict=True)]
    straights = [abs(edge) - tangents[i - 1] - tangents[i] for i, edge in enumerate(edges)]
    if max(straights) < _FIRST_STRAIGHT_M:
        return None
    return [_Corner(*values) for values in zip(straights, radii, turns, strict=True)]


def _angle_between(edge: complex, after: complex) -> float:
    turned = after * edge.conjugate()
    return math.atan2(turned.imag, turned.real)


def _draw_record(name: str, corners: list[_Corner], rng: np.random.Generator) -> CourseRecord:
    lane = _between(rng, LANE_WIDTH_M, 3)
    dash, gap = _between(rng, DASH_M, 3), _between(rng, GAP_M, 3)
    everywhere: tuple[tuple[float, float], ...] = ()
    solid = (_LINE_M, math.inf, math.inf, 0.0, everywhere)
    phase = _between(rng, (0.0, dash + gap), 3)
    return CourseRecord(
        where=name,
        name=name,
        description='A random road with two solid edges and a dashed centre line',
        road_width_m=2 * lane,
        lane_width_m=lane,
        start=(0.0, 0.0, 0.0),
        parts=tuple(_parts(corners)),
        lanes=(
            LaneRecord('outer', lane / 2, False, 'A', _START_M),
            LaneRecord('inner', -lane / 2, True, 'A', _START_M),
        ),
        markings=(
            Marking(lane, *solid),
            Marking(0.0, _LINE_M, dash, gap, phase, everywhere),
            Marking(-lane, *solid),
        ),
        floor_intensity=_between(rng, FLOOR_INTENSITY, 3),
        marking_intensity=_between(rng, MARKING_INTENSITY, 3),
    )


def _parts(corners: list[_Corner]) -> list[Part]:
    """Return the chain, sections A, B, C and so on: a straight and a turn by turns."""
    parts = []
    for i, corner in enumerate(corners):
        straight, turn = chr(ord('A') + 2 * i), chr(ord('B') + 2 * i)
        length = round(corner.radius_m * abs(corner.turn_rad), _DECIMALS)
        curvature = math.copysign(1 / corner.radius_m, corner.turn_rad)
        parts.append(Part(straight, round(corner.straight_m, _DECIMALS), 0.0))
        parts.append(Part(turn, length, curvature))
    return parts
