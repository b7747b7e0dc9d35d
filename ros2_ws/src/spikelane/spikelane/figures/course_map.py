"""The course from above, and the path driven on it.

What takes long to import (matplotlib, and numba with the geometry) is imported when it is used.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import itertools
import math
import pathlib
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spikelane.runs.lap.trajectory import Trajectory
from spikelane_sim import figure_style as style
from spikelane_sim.contract import TERMINATED_LANE_LOST

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    from spikelane_sim.course import Course, Lane

Floats = NDArray[np.float64]

_STEP_M = 0.05  # between the points of curves and paths
_SHOULDER_M = 0.06  # of the road beyond its width, so that white edges show
_NAME_M = 0.31  # from the road's edge to the middle of a section's name
_CLOSE = 0.1  # of the largest deviation: close to the centre
_LANE_COLOURS = (style.RIGHT, style.LEFT)
_SIZE_IN = (7.0, 5.6)
_SIDE_COLOURS = {1: style.RIGHT, 0: style.INK, -1: style.LEFT}


def draw_course(axes: Axes, course: Course, lane: Lane) -> None:
    """Draw the road, its markings, and the sections of a lane with their names."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    left, right = _sides(course)
    # One side the other way round, so that what they enclose is the road and not what is inside.
    ring = Path.make_compound_path(Path(left, closed=True), Path(right[::-1], closed=True))
    axes.add_patch(PathPatch(ring, facecolor=style.ROAD, linewidth=0, zorder=1))
    pieces = marking_outlines(course)
    paint = PolyCollection(pieces, facecolor=style.PAINT, edgecolor=style.PAINT, linewidth=0.2)
    axes.add_collection(paint)
    _draw_sections(axes, course, lane)
    _draw_scale(axes, np.concatenate([left, right]))
    axes.set_aspect('equal')
    axes.autoscale_view()
    axes.margins(0.03)
    axes.set_axis_off()


def draw_starts(axes: Axes, course: Course) -> list[Line2D]:
    """Draw where each lane's robots start, as triangles that point in the direction of driving.

    Returns:
        The triangles, with the lanes' names as their labels.
    """
    return [
        _draw_triangle(axes, lane.start, colour, size=8, label=lane.name)
        for lane, colour in zip(course.lanes.values(), itertools.cycle(_LANE_COLOURS))
    ]


def draw_course_figure(course: Course, path: pathlib.Path) -> tuple[pathlib.Path, ...]:
    """Draw a course, the sections of its first lane, and where the robots start on each lane.

    Args:
        course: The course.
        path: Ending in .svg or .png; without an ending both are written.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The path has another ending, or it cannot be written.
    """
    lane = next(iter(course.lanes.values()))
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        explanation = f'{lane.name} lane: {lane.length_m:.2f} m'
        style.write_title(figure, course.name, explanation)
        axes = figure.add_axes((0.01, 0.08, 0.98, 0.84))
        draw_course(axes, course, lane)
        starts = draw_starts(axes, course)
        for start in starts:
            start.set(linestyle='none', label=f'start of lane {start.get_label()}')
        style.write_legend(figure, list(starts))
        return style.save(figure, path)


def draw_path(axes: Axes, trajectory: Trajectory) -> None:
    """Draw where the robot drove, in the colour of the side of the lane's centre it was on."""
    from matplotlib.collections import LineCollection

    shown = _thin(trajectory)
    points = np.stack([trajectory.x_m[shown], trajectory.y_m[shown]], axis=-1)
    sides = _which_side(trajectory.distance_m[shown])[1:]  # of the line that ends at each point
    runs = list(_runs(sides))
    lines = [points[first : last + 2] for first, last in runs]
    colours = [_SIDE_COLOURS[int(sides[first])] for first, _ in runs]
    axes.add_collection(
        LineCollection(lines, colors=colours, linewidths=2.2, capstyle='round', zorder=4)
    )
    _draw_start(axes, trajectory)
    if trajectory.reason == TERMINATED_LANE_LOST:
        axes.plot(*points[-1], 'x', color=style.INK, markersize=8, markeredgewidth=2, zorder=6)


def explain_path(figure: Figure, drives: Sequence[Trajectory]) -> None:
    """Explain at a figure's foot what `draw_path` draws of some drives."""
    from matplotlib.lines import Line2D

    close = f'close to it (within {_CLOSE:.0%} of the largest |d| of the drive)'
    sides = ((1, "right of the lane's centre"), (-1, 'left of it'), (0, close))
    handles = [
        Line2D([], [], color=_SIDE_COLOURS[side], linewidth=2.2, label=words)
        for side, words in sides
    ]
    marks = [('>', 'start')]
    if any(drive.reason == TERMINATED_LANE_LOST for drive in drives):
        marks.append(('x', 'lane lost'))
    handles += [
        Line2D([], [], linestyle='', marker=marker, color=style.INK, markersize=8, label=words)
        for marker, words in marks
    ]
    style.write_legend(figure, list(handles))


def marking_outlines(course: Course) -> list[Floats]:
    """Return the outlines of all pieces of the markings, (n, 2) in metres each."""
    return [_piece_outline(piece) for piece in course.ground.pieces]


def _draw_sections(axes: Axes, course: Course, lane: Lane) -> None:
    """Mark the sections' beginnings across the road and write their names next to it."""
    half_m = course.road_width_m / 2
    round_about = sum(part.curvature * (part.end_m - part.start_m) for part in lane.sections)
    for section in lane.sections:
        border = _across(lane, section.start_m, [-half_m, half_m])
        axes.plot(*border.T, color=style.PALE_INK, linewidth=0.9, linestyle=(0, (4, 3)), zorder=3)
        # A turn's name is on the side it turns to, a straight's inside the whole round.
        side = -math.copysign(_NAME_M + half_m, section.curvature or round_about)
        [(x, y)] = _across(lane, (section.start_m + section.end_m) / 2, [side])
        axes.text(x, y, section.name, weight='bold', ha='center', va='center')


def _across(lane: Lane, position_m: float, distances_m: list[float]) -> Floats:
    """Return points across the road, distances to the right of its centre line, (n, 2)."""
    from spikelane_sim.curve import poses_along

    x, y, heading = poses_along(lane.centre, position_m).tolist()
    right = np.array([math.sin(heading), -math.cos(heading)])
    of_lane = -lane.offset_m if lane.against else lane.offset_m
    points: Floats = np.array([x, y]) + np.outer(np.array(distances_m) - of_lane, right)
    return points


def _draw_scale(axes: Axes, outside: Floats) -> None:
    """Draw a bar of a length in round metres below the course."""
    (left, low), (right, _) = outside.min(axis=0), outside.max(axis=0)
    length = 10.0 ** math.floor(math.log10((right - left) / 3))
    length *= max(n for n in (1, 2, 5) if n * length <= (right - left) / 3)
    y = low - 0.05 * (right - left)
    axes.plot([right - length, right], [y, y], color=style.INK, linewidth=2, solid_capstyle='butt')
    axes.text(
        right - 1.1 * length, y, f'{length:g} m', fontsize=style.SMALL_PT, ha='right', va='center'
    )


def _draw_start(axes: Axes, trajectory: Trajectory) -> None:
    """Draw a triangle that points where the robot set out to."""
    pose = trajectory.x_m[0], trajectory.y_m[0], trajectory.heading_rad[0]
    _draw_triangle(axes, pose, style.INK, size=9)


def _draw_triangle(
    axes: Axes, pose: tuple[float, float, float], colour: str, *, size: float, label: str = ''
) -> Line2D:
    """Draw a triangle at x, y [m] that points along the heading [rad]."""
    x, y, heading_rad = pose
    marker = (3, 0, math.degrees(heading_rad) - 90)
    [triangle] = axes.plot(
        x, y, marker=marker, color=colour, markersize=size, zorder=5, label=label
    )
    return triangle


def _sides(course: Course) -> tuple[Floats, Floats]:
    """Return the two edges of the road's surface, which shows a little beyond its markings."""
    half_m = course.road_width_m / 2 + _SHOULDER_M
    return course.outline(-half_m, _STEP_M), course.outline(half_m, _STEP_M)


def _piece_outline(piece: Floats) -> Floats:
    """Return the outline of a piece of marking, (n, 2) in metres."""
    from spikelane_sim.ground import ARC, CORNERS, IS_ARC

    corners = piece[CORNERS:].reshape(-1, 2)
    if not piece[IS_ARC]:
        return corners[:4]
    centre, radii = piece[ARC : ARC + 2], piece[ARC + 2 : ARC + 4]
    first, last = (math.atan2(*(corner - centre)[::-1]) for corner in (corners[0], corners[-1]))
    turn = math.remainder(last - first, math.tau)
    n = math.ceil(radii[1] * abs(turn) / _STEP_M) + 1
    angles = first + np.linspace(0, turn, n)
    arc = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return np.concatenate([centre + radii[0] * arc, centre + radii[1] * arc[::-1]])


def _thin(trajectory: Trajectory) -> NDArray[np.intp]:
    """Return rows a few centimetres apart, the first and the last included."""
    moved = np.hypot(np.diff(trajectory.x_m), np.diff(trajectory.y_m))
    cells = np.concatenate([[0.0], np.cumsum(moved)]) // _STEP_M
    rows = np.flatnonzero(np.diff(cells, prepend=-1.0)).tolist()
    return np.array(sorted({*rows, len(trajectory) - 1}), np.intp)


def _which_side(distances: Floats) -> NDArray[np.int64]:
    """Return 1 for right, -1 for left, 0 for close to the centre, by what this drive calls far."""
    close_m = _CLOSE * float(np.abs(distances).max())
    sides: Floats = np.where(np.abs(distances) > close_m, np.sign(distances), 0.0)
    return sides.astype(np.int64)


def _runs(values: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """Yield first and last index of every run of equal values."""
    ends = np.append(np.flatnonzero(np.diff(values)), len(values) - 1)
    first = 0
    for last in ends.tolist():
        yield first, last
        first = last + 1
