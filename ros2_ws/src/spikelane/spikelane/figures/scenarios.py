"""The figure of the course in the paper's three scenarios: its markings, sections and starts."""

from __future__ import annotations

from pathlib import Path

from spikelane.figures.course_map import draw_course, draw_starts
from spikelane_sim import figure_style as style
from spikelane_sim.course import load_course

_SIZE_IN = (10.6, 4.0)
_SCENARIOS = {
    'scenario_1': 'scenario 1: all lines',
    'scenario_2': 'scenario 2: the dashed line only',
    'scenario_3': 'scenario 3: two patterns',
}


def draw_scenarios(path: Path, title: str = '') -> tuple[Path, ...]:
    """Draw the three scenarios side by side, with the sections of the outer lane.

    Args:
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The path has another ending, or it cannot be written.
    """
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        style.write_title(figure, title, 'triangles: starts of the lanes')
        for index, (name, words) in enumerate(_SCENARIOS.items()):
            axes = figure.add_axes((index / 3 + 0.005, 0.01, 0.323, 0.83))
            course = load_course(name)
            draw_course(axes, course, next(iter(course.lanes.values())))
            axes.set_title(words, fontsize=style.NORMAL_PT, weight='bold')
            draw_starts(axes, course)
        return style.save(figure, path)
