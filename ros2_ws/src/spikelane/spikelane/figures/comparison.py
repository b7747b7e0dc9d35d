"""The figure that compares controllers, one below the other, as the paper's does by scenario.

Left, the deviation d from the lane's centre over the position p along it; right, how often which
deviation occurred, and the mean error. All drives have the same scales.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from spikelane.runs.lap.figure import deviation_limit_m, draw_deviation, draw_histogram
from spikelane.runs.lap.metrics import lap_metrics
from spikelane.runs.lap.trajectory import Trajectory
from spikelane_sim import figure_style as style
from spikelane_sim.course import Course

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDTH_IN = 10.6
_ROW_IN = 2.6
_ABOVE_IN, _BELOW_IN, _GAP_IN = 1.05, 0.5, 0.95
_NAME_IN = 0.5  # of a row's name, above its axes


def draw_comparison(
    drives: Mapping[str, Trajectory], course: Course, path: Path, title: str = ''
) -> tuple[Path, ...]:
    """Draw drives on one lane, one below the other.

    Args:
        drives: By what drove, in words; at least one, each of one episode on the same lane.
        course: What they were driven on.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        TrajectoryError: One has not one step.
        SpikelaneError: The course has no such lane, or the path another ending, or it cannot be
            written.
    """
    height_in = _ABOVE_IN + _BELOW_IN + len(drives) * _ROW_IN + (len(drives) - 1) * _GAP_IN
    limit_m = max(deviation_limit_m(each) for each in drives.values())
    with style.settings():
        figure = style.new_figure(_WIDTH_IN, height_in)
        style.write_title(
            figure, title, 'dot: the lap begins here; d: right of the centre is positive'
        )
        histograms: list[Axes] = []
        for row, (name, drive) in enumerate(drives.items()):
            top_in = height_in - _ABOVE_IN - row * (_ROW_IN + _GAP_IN)
            bottom, height = (top_in - _ROW_IN) / height_in, _ROW_IN / height_in
            deviation = figure.add_axes((0.075, bottom, 0.735, height))
            histogram = figure.add_axes((0.83, bottom, 0.155, height), sharey=deviation)
            lane = course.lane(drive.lane)
            draw_deviation(deviation, drive, lane, course.lane_width_m, limit_m)
            # The lap ends there, too, at another deviation: a curve that jumps needs a reason.
            begin = drive.position_m[0], drive.distance_m[0]
            deviation.plot(*begin, 'o', color=style.INK, markersize=5)
            metrics = lap_metrics(drive, drive.period_s)
            draw_histogram(histogram, drive.distance_m[1:], metrics['mean_abs_distance_m'])
            deviation.set_ylabel('d [m]')
            histograms.append(histogram)
            if row < len(drives) - 1:
                deviation.set_xlabel('')
                histogram.set_xlabel('')
            lost = '' if metrics['completed'] else ', lap not completed'
            y = (top_in + _NAME_IN) / height_in
            figure.text(0.012, y, f'{name}{lost}', weight='bold', va='center')
        most = max(axes.get_xlim()[1] for axes in histograms)
        for axes in histograms:
            axes.set_xlim(0, most)
        return style.save(figure, path)
