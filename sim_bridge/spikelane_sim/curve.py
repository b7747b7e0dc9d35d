"""Closed plane curves of straights and arcs: what roads and lanes are made of.

A curve is an array with one row per segment; the columns are named below. Curvature is positive
where the curve turns left. Distances across a curve are positive to its right, like everywhere
in Spikelane (see `contract.py`).
"""

from __future__ import annotations

from collections.abc import Iterable
import math

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from spikelane_sim.compiled import uncounted

#: A curve, (n_segments, 8).
Curve = NDArray[np.float64]

# Columns: start point [m], heading there [rad] with its cosine and sine, curvature [1/m],
# length [m], arc length of the curve up to here [m].
X, Y, HEADING, COSINE, SINE, CURVATURE, LENGTH, START = range(8)

_TURN = 2.0 * math.pi


def make_curve(start: tuple[float, float, float], parts: Iterable[tuple[float, float]]) -> Curve:
    """Chain straights and arcs.

    Args:
        start: x, y [m] and heading [rad] where the curve begins.
        parts: Length [m] and curvature [1/m] (0 for a straight) of each segment.
    """
    x, y, heading = start
    rows, position = [], 0.0
    for length, curvature in parts:
        rows.append(_row(x, y, heading, length, curvature, position))
        x, y, heading = pose_on_segment(rows[-1], length)
        position += length
    return _frozen(np.array(rows))


def end_pose(curve: Curve) -> tuple[float, float, float]:
    """Return x, y [m] and heading [rad] where the last segment ends."""
    last = curve[-1].tolist()
    return pose_on_segment(last, last[LENGTH])


def pose_on_segment(row: list[float], s: float) -> tuple[float, float, float]:
    """Return x, y [m] and heading [rad] at arc length s [m] from a segment's start."""
    k, heading = row[CURVATURE], row[HEADING] + row[CURVATURE] * s
    if k == 0.0:
        return row[X] + s * row[COSINE], row[Y] + s * row[SINE], heading
    x = row[X] + (math.sin(heading) - row[SINE]) / k
    y = row[Y] - (math.cos(heading) - row[COSINE]) / k
    return x, y, heading


def length_of(curve: Curve) -> float:
    """Return the whole length [m]."""
    return float(curve[-1, START] + curve[-1, LENGTH])


def offset_curve(curve: Curve, offset_m: float) -> Curve:
    """Return the parallel curve that runs offset_m to the right."""
    rows, position = [], 0.0
    for row in curve.tolist():
        stretch = 1.0 + row[CURVATURE] * offset_m
        x = row[X] + offset_m * row[SINE]
        y = row[Y] - offset_m * row[COSINE]
        length = row[LENGTH] * stretch
        rows.append(_row(x, y, row[HEADING], length, row[CURVATURE] / stretch, position))
        position += length
    return _frozen(np.array(rows))


def reverse_curve(curve: Curve) -> Curve:
    """Return the same curve driven the other way, its last segment first."""
    rows, position = [], 0.0
    for row in curve[::-1].tolist():
        x, y, heading = pose_on_segment(row, row[LENGTH])
        heading = wrap_angle(heading + math.pi)
        rows.append(_row(x, y, heading, row[LENGTH], 0.0 - row[CURVATURE], position))
        position += row[LENGTH]
    return _frozen(np.array(rows))


def begin_at(curve: Curve, index: int) -> Curve:
    """Return the same closed curve with segment `index` first."""
    turned = np.roll(curve, -index, axis=0)
    turned[:, START] = np.concatenate(([0.0], np.cumsum(turned[:-1, LENGTH])))
    return _frozen(turned)


def poses_along(curve: Curve, position_m: ArrayLike) -> NDArray[np.float64]:
    """Return x, y [m] and heading [rad] at arc lengths along the closed curve, (..., 3)."""
    position = np.mod(np.asarray(position_m, np.float64), length_of(curve))
    index = np.searchsorted(curve[:, START], position, side='right') - 1
    row = np.moveaxis(curve[index], -1, 0)
    s = position - row[START]
    turned = row[CURVATURE] * s
    heading = row[HEADING] + turned
    # The chord of an arc of length s: s sinc(turned / 2), at half the angle; a straight's too.
    chord = s * np.sinc(turned / _TURN)
    x = row[X] + chord * np.cos(row[HEADING] + turned / 2)
    y = row[Y] + chord * np.sin(row[HEADING] + turned / 2)
    return np.stack([x, y, heading], axis=-1)


def wrap_angle(angle_rad: float) -> float:
    """Return the same angle in [-pi, pi)."""
    if -math.pi <= angle_rad < math.pi:
        return angle_rad
    return (angle_rad + math.pi) % _TURN - math.pi


def _row(x: float, y: float, heading: float, length: float, k: float, s: float) -> list[float]:
    return [x, y, heading, math.cos(heading), math.sin(heading), k, length, s]


def _frozen(curve: Curve) -> Curve:
    curve = np.ascontiguousarray(curve, np.float64)
    curve.flags.writeable = False
    return curve


@numba.njit(cache=True, error_model='numpy')
def nearest_on_curve(
    curve: Curve, x: float, y: float, heading: float
) -> tuple[float, float, float, int]:
    """Find the nearest point of a closed curve without kinks.

    A segment owns its start and not its end. Where several points are nearest (the centre of an
    arc), the first along the curve counts.

    Returns:
        Distance to the right of the curve [m], heading relative to the curve's in [-pi, pi),
        arc length of the nearest point [m] and the index of its segment.
    """
    best, index, s, right = np.inf, 0, 0.0, 0.0
    for i in range(curve.shape[0]):
        s_i, right_i, squared = _nearest_on_segment(curve[i], x, y)
        if squared < best:
            best, index, s, right = squared, i, s_i, right_i
    error = heading - (curve[index, HEADING] + curve[index, CURVATURE] * s)
    if not -np.pi <= error < np.pi:
        error = (error + np.pi) % _TURN - np.pi
    position = curve[index, START] + s
    last = curve.shape[0] - 1
    if position >= curve[last, START] + curve[last, LENGTH]:
        return right, error, 0.0, 0  # rounded up to the end, which is the start
    return right, error, position, index


@uncounted(error_model='numpy')
def _nearest_on_segment(row: Curve, x: float, y: float) -> tuple[float, float, float]:
    """Return arc length from the segment's start, distance to the right, squared distance.

    Where the nearest point would be past the end, the squared distance is infinite: the next
    segment begins there and has it too.
    """
    dx, dy = x - row[X], y - row[Y]
    sine, cosine, k = row[SINE], row[COSINE], row[CURVATURE]
    if k == 0.0:
        s = dx * cosine + dy * sine
        right = dx * sine - dy * cosine
        squared = right * right
    else:
        side = 1.0 if k > 0.0 else -1.0
        radius = side / k
        # From the centre: `out` towards the segment's start, `along` in its direction there.
        out = side * (dx * sine - dy * cosine) + radius
        along = dx * cosine + dy * sine
        angle = math.atan2(along, out)
        s = angle * radius
        if s < 0.0 and (angle + _TURN) * radius < row[LENGTH]:
            s = (angle + _TURN) * radius
        right = side * (math.sqrt(out * out + along * along) - radius)
        squared = right * right
    if s >= row[LENGTH]:
        return 0.0, right, np.inf
    if s < 0.0:
        return 0.0, right, dx * dx + dy * dy
    return s, right, squared


@numba.njit(cache=True, error_model='numpy')
def nearest_on_curve_many(
    curve: Curve, x: NDArray[np.float64], y: NDArray[np.float64], heading: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Do what `nearest_on_curve` does for each of N poses; all arrays are (N,)."""
    n = x.shape[0]
    right, error, position = np.empty(n), np.empty(n), np.empty(n)
    index = np.empty(n, np.int64)
    for i in range(n):
        right[i], error[i], position[i], index[i] = nearest_on_curve(curve, x[i], y[i], heading[i])
    return right, error, position, index


def closest_approach(curve: Curve, step_m: float) -> tuple[float, float, float]:
    """Find where a closed curve comes closest to itself, the near neighbourhood left out.

    Two points less than half a circle of the tightest radius apart along the curve are
    neighbours: Schur's theorem bounds their distance from below.

    Args:
        curve: The curve.
        step_m: Step of the points that are compared.

    Returns:
        The distance [m] (infinite for a circle) and the arc lengths of both points [m].
    """
    total = length_of(curve)
    tightest = float(np.max(np.abs(curve[:, CURVATURE])))
    apart = math.pi / tightest if tightest else total
    s = np.linspace(0.0, total, max(8, math.ceil(total / step_m)), endpoint=False)
    points = poses_along(curve, s)[:, :2]
    best = (math.inf, 0.0, 0.0)
    for i in range(len(s) - 1):
        along = s[i + 1 :] - s[i]
        far = np.minimum(along, total - along) >= apart
        squared = np.where(far, np.sum((points[i + 1 :] - points[i]) ** 2, axis=1), np.inf)
        j = int(np.argmin(squared))
        if squared[j] < best[0]:
            best = (float(squared[j]), float(s[i]), float(s[i + 1 + j]))
    return best if math.isinf(best[0]) else _closest_pair(curve, best[1], best[2], step_m)


def _closest_pair(
    curve: Curve, s_1: float, s_2: float, step_m: float
) -> tuple[float, float, float]:
    """Return the closest pair of points within a step of these two, and their distance."""
    around = np.linspace(-step_m, step_m, 101)
    one = poses_along(curve, s_1 + around)[:, np.newaxis, :2]
    two = poses_along(curve, s_2 + around)[np.newaxis, :, :2]
    distance = np.hypot(*np.moveaxis(one - two, -1, 0))
    i, j = np.unravel_index(np.argmin(distance), distance.shape)
    return float(distance[i, j]), s_1 + float(around[i]), s_2 + float(around[j])
