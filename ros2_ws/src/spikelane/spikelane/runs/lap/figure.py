"""The figure of one lap, as in the paper's comparison of controllers.

Left, the course and the path driven; in the middle, the deviation d from the lane's centre over
the position p along it, with the course's sections; right, how often which deviation occurred,
and the mean error e = mean |d|.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spikelane.figures.course_map import draw_course, draw_path
from spikelane.runs.lap.metrics import lap_metrics
from spikelane.runs.lap.trajectory import Trajectory
from spikelane_sim import figure_style as style
from spikelane_sim.contract import TERMINATED_LANE_LOST
from spikelane_sim.figure_values import tell_values, Value

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from spikelane_sim.course import Course, Lane

Floats = NDArray[np.float64]

_SIZE_IN = (10.6, 4.0)
_LEAST_RANGE_M = 0.02  # of the deviation shown: less is a straight line anyway
_BACKGROUND = {'facecolor': 'white', 'edgecolor': 'none', 'alpha': 0.85, 'pad': 1.5}  # of texts
_FILL_POINTS = 1000  # a line is thinned when it is written, an area is not
_TOLD = 120  # values that a pointer meets along a lane
_TURNS = {0: 'straight', 1: 'left', -1: 'right'}


def draw_lap(
    trajectory: Trajectory, course: Course, path: Path, title: str = ''
) -> tuple[Path, ...]:
    """Draw a lap.

    Args:
        trajectory: Trajectory of one episode.
        course: The course it was driven on.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        TrajectoryError: Not one step was driven.
        SpikelaneError: The course has no such lane, or the path another ending, or it cannot be
            written.
    """
    metrics = lap_metrics(trajectory, trajectory.period_s)
    lane = course.lane(trajectory.lane)
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        map_axes, deviation_axes, histogram_axes = _lay_out(figure)
        draw_course(map_axes, course, lane)
        draw_path(map_axes, trajectory)
        draw_deviation(deviation_axes, trajectory, lane, course.lane_width_m)
        draw_histogram(histogram_axes, trajectory.distance_m[1:], metrics['mean_abs_distance_m'])
        style.write_title(figure, title, _in_words(metrics))
        return style.save(figure, path)


def _lay_out(figure: Figure) -> tuple[Axes, Axes, Axes]:
    """Return the axes of the map, of the deviation and of the histogram, the last two level."""
    bottom, height = 0.135, 0.685
    map_axes = figure.add_axes((0.005, 0.02, 0.325, 0.88))
    deviation_axes = figure.add_axes((0.405, bottom, 0.435, height))
    histogram_axes = figure.add_axes((0.855, bottom, 0.13, height), sharey=deviation_axes)
    return map_axes, deviation_axes, histogram_axes


def _in_words(metrics: dict[str, Any]) -> str:
    if not metrics['completed']:
        return f'lap not completed, {metrics["steps"]:,} steps'
    laps = 'lap of' if metrics['laps'] == 1 else f'{metrics["laps"]} laps of'
    first = '' if metrics['laps'] == 1 else 'the first '
    return f'{laps} {metrics["steps"]:,} steps, {first}{metrics["lap_time_s"]:.1f} s'


def draw_deviation(
    axes: Axes,
    trajectory: Trajectory,
    lane: Lane,
    lane_width_m: float,
    limit_m: float | None = None,
) -> None:
    """Draw the deviation over the position along the lane, with the lane's sections.

    Args:
        axes: To draw in.
        trajectory: Trajectory of one episode of at least one step.
        lane: That it drove on.
        lane_width_m: Its width.
        limit_m: Largest deviation shown [m]; None for one that fits.
    """
    if limit_m is None:
        limit_m = deviation_limit_m(trajectory)
    axes.set_xlim(0, lane.length_m)
    axes.set_ylim(-limit_m, limit_m)
    _draw_sections(axes, lane)
    borders = lane_width_m / 2 < limit_m
    if borders:
        _draw_borders(axes, lane_width_m / 2)
    axes.axhline(0, color=style.PALE_INK, linewidth=0.8)
    position, distance = trajectory.position_m[1:], trajectory.distance_m[1:]
    for stretch in _stretches(position, lane.length_m):
        _draw_stretch(axes, position[stretch], distance[stretch])
    if trajectory.reason == TERMINATED_LANE_LOST:
        axes.plot(position[-1], distance[-1], 'x', color=style.INK, markersize=7, clip_on=False)
    tell_values(axes, _deviation_values(position, distance, lane))
    axes.set_xlabel('position p along the lane [m]' + ', its borders dotted' * borders)
    axes.set_ylabel('deviation d from lane centre [m]')
    _name_sides(axes)


def _deviation_values(position: Floats, distance: Floats, lane: Lane) -> list[Value]:
    """Return the mean and largest deviation of each of some equal parts of a lane."""
    edges = np.linspace(0, lane.length_m, _TOLD + 1)
    parts = np.digitize(position, edges) - 1
    values = []
    for part in np.unique(parts[(parts >= 0) & (parts < _TOLD)]).tolist():
        driven, low, high = distance[parts == part], edges[part], edges[part + 1]
        largest = driven[np.abs(driven).argmax()]
        text = (
            f'p {low:.2f} to {high:.2f} m: d {driven.mean():+.4f} m on average, '
            f'{largest:+.4f} m at most'
        )
        values.append(Value(text, (low, high)))
    return values


def _draw_stretch(axes: Axes, position: Floats, distance: Floats) -> None:
    """Draw a stretch of lane as a line, filled to the lane's centre."""
    axes.plot(position, distance, color=style.INK, linewidth=1.2)
    shown = np.unique(np.linspace(0, len(position) - 1, _FILL_POINTS).astype(int))
    for sign, colour in ((1, style.RIGHT), (-1, style.LEFT)):
        height = sign * np.clip(sign * distance[shown], 0, None)
        axes.fill_between(position[shown], height, color=colour, alpha=0.25, linewidth=0)


def _draw_sections(axes: Axes, lane: Lane) -> None:
    """Mark where sections begin, and name those that have room for it."""
    for section in lane.sections:
        if section.start_m > 0:
            axes.axvline(
                section.start_m, color=style.PALE_INK, linewidth=0.8, linestyle=(0, (4, 3))
            )
        if section.end_m - section.start_m < 0.05 * lane.length_m:
            continue
        middle = (section.start_m + section.end_m) / 2 / lane.length_m
        _write_above(axes, middle, section.name, _TURNS[int(np.sign(section.curvature))])


def _write_above(axes: Axes, x: float, head: str, explanation: str) -> None:
    """Write two lines above the axes, at x in parts of its width."""
    for y, text, look in (
        (1.09, head, {'weight': 'bold'}),
        (1.03, explanation, {'fontsize': style.SMALL_PT, 'color': style.PALE_INK}),
    ):
        axes.text(x, y, text, transform=axes.transAxes, ha='center', va='center', **look)


def _draw_borders(axes: Axes, half_m: float) -> None:
    for border_m in (-half_m, half_m):
        axes.axhline(border_m, color=style.INK, linewidth=1.0, linestyle=(0, (1, 1.5)))


def _name_sides(axes: Axes) -> None:
    for text, y, colour, va in (
        ('right of centre (+)', 0.985, style.RIGHT, 'top'),
        ('left of centre (\u2212)', 0.015, style.LEFT, 'bottom'),
    ):
        axes.text(
            0.012,
            y,
            text,
            transform=axes.transAxes,
            fontsize=style.SMALL_PT,
            weight='bold',
            color=colour,
            va=va,
            bbox=_BACKGROUND,
        )


def deviation_limit_m(trajectory: Trajectory) -> float:
    """Return a limit of the deviation shown that all of an episode fits in."""
    return _round_limit(float(np.abs(trajectory.distance_m[1:]).max()))


def draw_histogram(axes: Axes, distances: Floats, error_m: float) -> None:
    """Draw how large a part of the steps ended at which deviation."""
    low, high = axes.get_ylim()
    edges = np.linspace(low, high, 61)  # an edge at zero: no bar has two sides
    counts, _ = np.histogram(distances, edges)
    middles = (edges[:-1] + edges[1:]) / 2
    axes.barh(
        middles,
        100 * counts / len(distances),
        height=edges[1] - edges[0],
        color=np.where(middles > 0, style.RIGHT, style.LEFT).tolist(),
        linewidth=0,
        alpha=0.85,
    )
    tell_values(
        axes,
        [
            Value(f'd {a:+.4f} to {b:+.4f} m: {share:.1f} % of the steps', (0, share), (a, b))
            for a, b, share in zip(
                edges, edges[1:], 100 * counts / max(len(distances), 1), strict=False
            )
            if share
        ],
    )
    axes.axhline(0, color=style.PALE_INK, linewidth=0.8)
    axes.tick_params(labelleft=False)
    axes.set_xlabel('steps [%]')
    axes.locator_params(axis='x', nbins=3, integer=True)
    _write_above(axes, 0.5, f'e = {error_m:.3f} m', 'mean of |d|')


def _stretches(position: Floats, length_m: float) -> list[slice]:
    """Cut where the position jumps from the lane's end to its beginning, or back."""
    jumps = (np.flatnonzero(np.abs(np.diff(position)) > length_m / 2) + 1).tolist()
    return [slice(*ends) for ends in zip([0, *jumps], [*jumps, len(position)], strict=True)]


def _round_limit(largest_m: float) -> float:
    """Return a limit a little above, a number of two digits."""
    wanted = max(1.2 * largest_m, _LEAST_RANGE_M)
    unit = 10.0 ** (math.floor(math.log10(wanted)) - 1)
    return math.ceil(wanted / unit) * unit
