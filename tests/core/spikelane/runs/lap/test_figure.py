"""The figures: what they say, and that they are files of their own."""

import os
from pathlib import Path
import re
import subprocess
import sys

import numpy as np
from numpy.typing import NDArray
import pytest

from spikelane.figures.course_map import marking_outlines
from spikelane.runs.lap.figure import draw_lap
from spikelane.runs.lap.trajectory import Trajectory
from spikelane_sim.course import Course, load_course
from spikelane_sim.curve import poses_along
from spikelane_sim.errors import SpikelaneError


@pytest.fixture(scope='module')
def course() -> Course:
    """Return the course of scenario 1."""
    return load_course('scenario_1')


def drive(course: Course, lane_name: str, distance_m: float, part: float = 1.0) -> Trajectory:
    """Return a drive along a lane, always this far right of its centre."""
    lane = course.lanes[lane_name]
    progress: NDArray[np.float64] = np.linspace(0.0, part * lane.length_m, 401, dtype=np.float64)
    position: NDArray[np.float64] = (0.5 + progress) % lane.length_m
    x, y, heading = poses_along(lane.centre, position).T
    starts = [section.start_m for section in lane.sections]
    indices = np.searchsorted(starts, position, 'right') - 1
    zeros = np.zeros(401)
    return Trajectory(
        lane=lane_name,
        reason='laps_complete' if part >= 1.0 else 'lane_lost',
        stamp_ns=np.arange(1, 402) * 50_000_000,
        step=np.arange(401),
        distance_m=zeros + distance_m,
        heading_error_rad=zeros,
        position_m=position,
        progress_m=progress,
        section=np.array([lane.sections[index].name for index in indices]),
        laps=np.floor(progress / lane.length_m + 1e-9).astype(np.int64),
        x_m=x + distance_m * np.sin(heading),
        y_m=y - distance_m * np.cos(heading),
        heading_rad=heading,
        left_rad_s=zeros,
        right_rad_s=zeros,
        events=np.arange(401),
    )


def texts(svg: Path) -> list[str]:
    """Return the texts of a figure, which SVG keeps as comments next to their outlines."""
    return re.findall(r'<!-- (.*?) -->', svg.read_text())


def test_a_lap_says_what_the_papers_figure_says(course: Course, tmp_path: Path) -> None:
    """Title, sections in the order driven, mean error, axes with units and the sign's meaning."""
    draw_lap(drive(course, 'outer', 0.04), course, tmp_path / 'lap.svg', 'Braitenberg')
    said = texts(tmp_path / 'lap.svg')
    for text in (
        'Braitenberg',
        'e = 0.040 m',
        'lap of 400 steps, 20.0 s',
        'position p along the lane [m]',
        'deviation d from lane centre [m]',
        'right of centre (+)',
        'left of centre (\u2212)',
    ):
        assert text in said
    heads = [text for text in said if text in 'ABCDEF']
    assert heads == list('ABCDEF') * 2  # on the map and over the deviation
    assert 'position p along the lane [m], its borders dotted' not in said


def test_the_inner_lane_has_its_own_order(course: Course, tmp_path: Path) -> None:
    """It is driven the other way round, its left turns are right turns."""
    draw_lap(drive(course, 'inner', -0.04), course, tmp_path / 'lap.svg')
    said = texts(tmp_path / 'lap.svg')
    assert [text for text in said if text in tuple('ABCDEF')] == list('CBAFED') * 2
    turns = [text for text in said if text in ('straight', 'left', 'right')]
    assert turns == ['straight', 'right', 'straight', 'right', 'left', 'right']


def test_the_lanes_borders_are_shown_where_the_robot_came_near(
    course: Course, tmp_path: Path
) -> None:
    """And a drive that left the lane is called what it is."""
    draw_lap(drive(course, 'outer', 0.3, part=0.5), course, tmp_path / 'lap.svg')
    said = texts(tmp_path / 'lap.svg')
    assert 'position p along the lane [m], its borders dotted' in said
    assert 'lap not completed, 400 steps' in said


def test_a_drive_without_any_deviation_can_be_drawn(course: Course, tmp_path: Path) -> None:
    """The robot stays exactly in the centre, so that no deviation is the largest."""
    draw_lap(drive(course, 'outer', 0.0), course, tmp_path / 'lap.svg')
    assert 'e = 0.000 m' in texts(tmp_path / 'lap.svg')


def test_two_laps_are_called_two(course: Course, tmp_path: Path) -> None:
    """The time is the first one's."""
    draw_lap(drive(course, 'outer', 0.01, part=2.0), course, tmp_path / 'lap.svg')
    assert '2 laps of 400 steps, the first 10.0 s' in texts(tmp_path / 'lap.svg')


def test_a_name_without_ending_gives_both_files(course: Course, tmp_path: Path) -> None:
    """No other file is left in the folder."""
    files = draw_lap(drive(course, 'outer', 0.04), course, tmp_path / 'figures' / 'lap')
    assert [file.name for file in files] == ['lap.svg', 'lap.png']
    assert sorted((tmp_path / 'figures').iterdir()) == sorted(files)
    assert files[1].read_bytes().startswith(b'\x89PNG\r\n')


@pytest.mark.parametrize('suffix', ['.svg', '.png'])
def test_the_same_lap_gives_the_same_bytes(course: Course, tmp_path: Path, suffix: str) -> None:
    """No dates, no random names, nothing of the user's own settings."""
    import matplotlib

    lap = drive(course, 'outer', 0.04)
    [first] = draw_lap(lap, course, tmp_path / f'first{suffix}')
    with matplotlib.rc_context({'font.size': 30.0, 'axes.facecolor': 'black'}):
        [second] = draw_lap(lap, course, tmp_path / f'second{suffix}')
        assert matplotlib.rcParams['font.size'] == 30.0
    assert first.read_bytes() == second.read_bytes()


def test_another_ending_is_refused(course: Course, tmp_path: Path) -> None:
    """The message has those there are."""
    with pytest.raises(
        SpikelaneError, match=r'lap\.pdf: expected a name ending in \.svg or \.png'
    ):
        draw_lap(drive(course, 'outer', 0.04), course, tmp_path / 'lap.pdf')


@pytest.mark.parametrize(
    ('scenario', 'area_m2'),
    [
        # Two solid edges of 2 x 30.42 m (what the offset adds inside it takes outside), and
        # half of 30.42 m in dashes of 0.3 m: 50 whole ones and 0.3 m of the last 0.42 m.
        ('scenario_1', 0.04 * (2 * 30.4203 + 51 * 0.3)),
        ('scenario_2', 0.04 * 51 * 0.3),
    ],
)
def test_the_maps_markings_have_the_area_of_the_paint(scenario: str, area_m2: float) -> None:
    """The outlines are those of the exact pieces, arcs included."""
    area = 0.0
    for outline in marking_outlines(load_course(scenario)):
        x, y = outline.T
        area += abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))) / 2
    assert area == pytest.approx(area_m2, rel=2e-3)


def test_importing_the_figures_is_quick() -> None:
    """Neither matplotlib nor numba comes before something is drawn."""
    code = (
        'import spikelane.runs.lap.figure, sys; '
        'sys.exit(bool({"matplotlib", "numba"} & {*sys.modules}))'
    )
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)}
    assert subprocess.run([sys.executable, '-c', code], env=environment).returncode == 0
