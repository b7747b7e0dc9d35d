"""The markings painted on the ground, as pieces that a renderer can test quickly and exactly.

Every solid line and every dash is cut into pieces of at most `PIECE_M` and 45 degrees. A piece is
what four lines enclose on a straight, and two lines and two circles in a turn, so that neither
testing a point nor intersecting a ray needs an angle.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.course_file import Marking
from spikelane_sim.curve import CURVATURE, Curve, LENGTH, length_of, pose_on_segment, START
from spikelane_sim.raster import ARC, AROUND, CORNERS, HALF_PLANES, IS_ARC, N_COLUMNS

__all__ = [  # the first six are the columns of a piece
    'ARC',
    'AROUND',
    'CORNERS',
    'HALF_PLANES',
    'IS_ARC',
    'N_COLUMNS',
    'Ground',
    'make_ground',
    'painted_stretches',
]

PIECE_M = 1.0
PIECE_RAD = math.pi / 4

# Pieces of one line overlap by this, so that rounding leaves no gap between them [m].
_OVERLAP_M = 1e-9


class Ground(NamedTuple):
    """What lies on the ground plane.

    Attributes:
        pieces: The markings' pieces, (n_pieces, 26), with the columns of `raster.py`.
        floor_intensity: Linear intensity of the floor, from 0 to 1.
        marking_intensity: Linear intensity of the markings, from 0 to 1.
    """

    pieces: NDArray[np.float64]
    floor_intensity: float
    marking_intensity: float


def make_ground(
    centre_line: Curve, markings: Iterable[Marking], floor: float, marking: float
) -> Ground:
    """Cut the markings along a road into pieces."""
    rows = [
        _piece(row, begin, end, line)
        for line in markings
        for begin, end in painted_stretches(line, length_of(centre_line))
        for row, begin, end in _cut(centre_line, begin, end)
    ]
    pieces = np.array(rows, np.float64).reshape(-1, N_COLUMNS)
    pieces.flags.writeable = False
    return Ground(pieces, floor, marking)


def painted_stretches(marking: Marking, total_m: float) -> Iterator[tuple[float, float]]:
    """Yield the stretches, in arc length of the road's centre line, where paint is.

    Dashes begin at the marking's phase and every period from there, both ways, on the chain from
    0 to total_m; they do not run over the chain's end.
    """
    for begin, end in marking.ranges or ((0.0, total_m),):
        unwrapped = [(begin, end)] if begin < end else [(begin, total_m), (0.0, end)]
        for low, high in unwrapped:
            yield from _dashes(marking, low, high)


def _dashes(marking: Marking, low: float, high: float) -> Iterator[tuple[float, float]]:
    if math.isinf(marking.dash_m):
        yield low, high
        return
    period = marking.dash_m + marking.gap_m
    first = math.floor((low - marking.phase_m) / period)
    last = math.ceil((high - marking.phase_m) / period)
    for i in range(first, last + 1):
        begin = marking.phase_m + i * period
        end = min(begin + marking.dash_m, high)
        begin = max(begin, low)
        if end > begin:
            yield begin, end


def _cut(curve: Curve, begin: float, end: float) -> Iterator[tuple[list[float], float, float]]:
    """Cut a stretch at segments' ends and into short pieces; yield each, in its segment."""
    for row in curve.tolist():
        low, high = max(begin - row[START], 0.0), min(end - row[START], row[LENGTH])
        length = high - low
        if length <= _OVERLAP_M:
            continue
        n = math.ceil(max(length / PIECE_M, length * abs(row[CURVATURE]) / PIECE_RAD) - 1e-9)
        ends = np.linspace(low, high, max(n, 1) + 1).tolist()
        yield from ((row, ends[i], ends[i + 1]) for i in range(len(ends) - 1))


def _piece(row: list[float], begin: float, end: float, line: Marking) -> NDArray[np.float64]:
    """Return the piece of a marking between two arc lengths from the start of a segment."""
    first, last = pose_on_segment(row, begin), pose_on_segment(row, end)
    curvature = row[CURVATURE]
    inner, outer = line.offset_m - line.width_m / 2, line.offset_m + line.width_m / 2
    piece = np.zeros(N_COLUMNS)
    piece[IS_ARC] = curvature != 0.0
    piece[HALF_PLANES : HALF_PLANES + 6] = _ends(first, last)
    if curvature:
        piece[ARC : ARC + 4] = _circles(first, curvature, inner, outer)
    else:
        piece[ARC : ARC + 6] = _sides(first, inner, outer)
    corners = _corners(np.array([first, last]), curvature, inner, outer)
    middle = corners.mean(axis=0)
    piece[AROUND : AROUND + 2] = middle
    piece[AROUND + 2] = np.max(np.hypot(*(corners - middle).T)) + _OVERLAP_M
    piece[CORNERS:] = corners.ravel()
    return piece


def _ends(*poses: tuple[float, float, float]) -> list[float]:
    """Half-planes ahead of the first pose and behind the last."""
    planes: list[float] = []
    for sign, (x, y, heading) in zip((1.0, -1.0), poses, strict=True):
        a, b = sign * math.cos(heading), sign * math.sin(heading)
        planes += [a, b, _OVERLAP_M - a * x - b * y]
    return planes


def _sides(pose: tuple[float, float, float], inner: float, outer: float) -> list[float]:
    """Half-planes to the right of offset `inner` and to the left of offset `outer`."""
    x, y, heading = pose
    a, b = math.sin(heading), -math.cos(heading)
    at = a * x + b * y
    return [a, b, -at - inner, -a, -b, at + outer]


def _circles(
    pose: tuple[float, float, float], curvature: float, inner: float, outer: float
) -> list[float]:
    """Centre of the turn, inner and outer radius."""
    x, y, heading = pose
    x -= math.sin(heading) / curvature
    y += math.cos(heading) / curvature
    radii = sorted(abs(1.0 / curvature + offset) for offset in (inner, outer))
    return [x, y, *radii]


def _corners(
    poses: NDArray[np.float64], curvature: float, inner: float, outer: float
) -> NDArray[np.float64]:
    """Return a convex polygon around the piece, (5, 2)."""
    right = np.stack([np.sin(poses[:, 2]), -np.cos(poses[:, 2])], axis=-1)
    low, high = poses[:, :2] + inner * right, poses[:, :2] + outer * right
    if curvature == 0.0:
        return np.array([low[0], low[1], high[1], high[0], high[0]])
    # The tangents at the ends of the circle that is farther from the turn's centre meet here.
    wide, narrow = (high, low) if curvature > 0.0 else (low, high)
    half = (poses[1, 2] - poses[0, 2]) / 2
    radius = abs(1.0 / curvature + (outer if curvature > 0.0 else inner))
    ahead = np.array([math.cos(poses[0, 2]), math.sin(poses[0, 2])])
    tip = wide[0] + radius * abs(math.tan(half)) * ahead
    return np.array([narrow[0], wide[0], tip, wide[1], narrow[1]])
