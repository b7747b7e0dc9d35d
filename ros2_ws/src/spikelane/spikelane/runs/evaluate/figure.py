"""The figure of an evaluation on several courses: some from above, with the paths driven."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

from spikelane.figures.course_map import draw_course, draw_path, explain_path
from spikelane.runs.lap.trajectory import Trajectory
from spikelane_sim import figure_style as style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from spikelane_sim.course import Course

#: So many courses are drawn at most.
MOST = 6

_COLUMNS = 3
_WIDTH_IN = 10.6
_ROW_IN = 3.7
_TOP_IN = 0.4  # for the title
_FOOT_IN = 0.35  # for the legend
_TEXT_IN = 0.45  # for a course's name and results


class DrivenCourse(NamedTuple):
    """A course and what was driven on it."""

    name: str
    course: Course
    drives: Sequence[tuple[Trajectory, Mapping[str, Any]]]  # with its metrics, at least one


def draw_courses(
    driven: Sequence[DrivenCourse], path: Path, title: str = '', result: str = ''
) -> tuple[Path, ...]:
    """Draw courses and the paths driven on them.

    Args:
        driven: At least one course; the first MOST are drawn.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.
        result: At the right of the title.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The path has another ending, or it cannot be written.
    """
    shown = driven[:MOST]
    rows = -(-len(shown) // _COLUMNS)
    height_in = _TOP_IN + rows * _ROW_IN + _FOOT_IN
    with style.settings():
        figure = style.new_figure(_WIDTH_IN, height_in)
        style.write_title(figure, title, result)
        for index, each in enumerate(shown):
            row, column = divmod(index, _COLUMNS)
            bottom = (height_in - _TOP_IN - (row + 1) * _ROW_IN) / height_in
            height = (_ROW_IN - _TEXT_IN) / height_in
            width = 1 / _COLUMNS
            axes = figure.add_axes((column * width + 0.01, bottom, width - 0.02, height))
            _draw(axes, each)
        explain_path(figure, [drive for each in shown for drive, _ in each.drives])
        return style.save(figure, path)


def _draw(axes: Axes, driven: DrivenCourse) -> None:
    first, _ = driven.drives[0]
    draw_course(axes, driven.course, driven.course.lane(first.lane))
    for trajectory, _ in driven.drives:
        draw_path(axes, trajectory)
    results = ', '.join(_in_words(trajectory, metrics) for trajectory, metrics in driven.drives)
    axes.set_title(f'{driven.name}\n{results}', fontsize=style.SMALL_PT)


def _in_words(trajectory: Trajectory, metrics: Mapping[str, Any]) -> str:
    if not metrics['completed']:
        return f'{trajectory.lane} lost after {trajectory.progress_m[-1]:.1f} m'
    return f'{trajectory.lane} mean |d| = {metrics["mean_abs_distance_m"]:.3f} m'
