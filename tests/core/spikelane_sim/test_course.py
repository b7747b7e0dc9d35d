"""Geometry of the shipped courses against values computed by hand from the paper's figure."""

from __future__ import annotations

import math
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from spikelane_sim import course as course_module
from spikelane_sim.course import available_courses, Course, load_course
from spikelane_sim.episode_rules import advance
from spikelane_sim.errors import CourseError

PI = math.pi
OUTER_M = 10.0 + 2.5 * PI * 2.25 + 0.5 * PI * 2.75
INNER_M = 10.0 + 2.5 * PI * 1.75 + 0.5 * PI * 3.25
ROOT_HALF = math.sqrt(0.5)


@pytest.fixture(scope='module')
def course() -> Course:
    """Scenario 1, whose geometry the other two share."""
    return load_course('scenario_1')


@pytest.mark.parametrize('name', ['scenario_2', 'random:3'])
def test_a_course_is_made_once(name: str) -> None:
    """Loading it again gives the same object."""
    assert load_course(name) is load_course(name)


def test_a_changed_course_file_is_read_again(tmp_path: Path) -> None:
    """A course is known by what its file says, not by its name."""
    file, shipped = tmp_path / 'mine.yaml', Path(course_module.__file__).parent / 'courses'
    file.write_bytes((shipped / 'scenario_1.yaml').read_bytes())
    before = load_course(str(file))
    file.write_bytes((shipped / 'scenario_3.yaml').read_bytes())
    assert (before.name, load_course(str(file)).name) == ('scenario_1', 'scenario_3')


def test_the_paper_s_three_scenarios_are_shipped() -> None:
    """Their names are what the commands offer."""
    assert available_courses() == ('scenario_1', 'scenario_2', 'scenario_3')


@pytest.mark.parametrize('name', ['scenario_1', 'scenario_2', 'scenario_3'])
def test_lanes_have_the_paper_s_lengths_and_start_poses(name: str) -> None:
    """31.99 m and 28.85 m; starts half a metre into the first section."""
    course = load_course(name)
    assert list(course.lanes) == ['outer', 'inner']
    assert course.lanes['outer'].length_m == pytest.approx(31.991148575128552, abs=1e-12)
    assert course.lanes['inner'].length_m == pytest.approx(28.84955592153876, abs=1e-12)
    assert course.lanes['outer'].start == pytest.approx((3.0, 0.25, 0.0), abs=1e-12)
    assert course.lanes['inner'].start == pytest.approx((9.25, 7.0, -PI / 2), abs=1e-12)


def test_sections_come_in_the_order_they_are_driven(course: Course) -> None:
    """A to F on the outer lane; C, B, A, F, E, D on the inner one, with the paper's radii."""
    outer, inner = course.lanes['outer'].sections, course.lanes['inner'].sections
    assert [s.name for s in outer] == list('ABCDEF')
    assert [s.name for s in inner] == list('CBAFED')
    assert [s.radius_m for s in outer] == pytest.approx(
        [math.inf, 2.25, math.inf, 2.25, 2.75, 2.25]
    )
    assert [s.radius_m for s in inner] == pytest.approx(
        [math.inf, 1.75, math.inf, 1.75, 3.25, 1.75]
    )
    assert [np.sign(s.curvature) for s in outer] == [0, 1, 0, 1, -1, 1]
    assert [np.sign(s.curvature) for s in inner] == [0, -1, 0, -1, 1, -1]
    assert [s.start_m for s in outer] == pytest.approx(
        [0, 5, 8.534291735, 13.534291735, 20.602875205, 24.922565104], abs=1e-8
    )
    assert outer[-1].end_m == course.lanes['outer'].length_m
    assert course.section_name('inner', 3) == 'F'


# lane, x, y, heading, then distance, heading error, position, section
HAND_COMPUTED = [
    # Straights: A along y = 0.25 and C along x = 9.75 (outer), C along x = 9.25 down (inner).
    ('outer', 3.0, 0.25, 0.0, 0.0, 0.0, 0.5, 'A'),
    ('outer', 4.0, 0.15, 0.1, 0.1, 0.1, 1.5, 'A'),
    ('outer', 4.0, 0.45, -0.2, -0.2, -0.2, 1.5, 'A'),
    ('outer', 9.85, 4.0, PI / 2, 0.1, 0.0, 5 + PI * 1.125 + 1.5, 'C'),
    ('inner', 9.25, 7.0, -PI / 2, 0.0, 0.0, 0.5, 'C'),
    ('inner', 9.15, 7.0, 1.5 * PI, 0.1, 0.0, 0.5, 'C'),
    ('inner', 9.45, 3.5, -PI / 2 + 0.3, -0.2, 0.3, 4.0, 'C'),
    ('inner', 5.0, 0.85, PI, 0.1, 0.0, 5 + PI * 0.875 + 2.5, 'A'),
    # Turns at their middle: B about (7.5, 2.5), D about (7.5, 7.5), E about (2.5, 7.5), F.
    (
        'outer',
        7.5 + 2.35 * ROOT_HALF,
        2.5 - 2.35 * ROOT_HALF,
        PI / 4,
        0.1,
        0,
        5 + PI * 0.5625,
        'B',
    ),
    ('outer', 7.5, 9.65, PI, -0.1, 0.0, 10 + PI * 1.125 + PI * 1.125, 'D'),
    (
        'outer',
        2.5 + 2.65 * ROOT_HALF,
        7.5 - 2.65 * ROOT_HALF,
        -0.75 * PI,
        0.1,
        0.0,
        10 + PI * 3.375 + PI * 2.75 / 4,
        'E',
    ),
    ('outer', 0.3, 2.5, -PI / 2 + 0.25, -0.05, 0.25, 10 + PI * 4.75 + PI * 1.125, 'F'),
    (
        'inner',
        7.5 + 1.7 * ROOT_HALF,
        2.5 - 1.7 * ROOT_HALF,
        -0.75 * PI - 0.5,
        0.05,
        -0.5,
        5 + PI * 0.4375,
        'B',
    ),
    ('inner', 0.75, 2.5, PI / 2, 0.0, 0.0, 10 + PI * 0.875 + PI * 0.875, 'F'),
    ('inner', 7.5, 9.4, 0.0, -0.15, 0.0, INNER_M - PI * 0.875, 'D'),
    (
        'inner',
        2.5 + 3.35 * ROOT_HALF,
        7.5 - 3.35 * ROOT_HALF,
        PI / 4,
        0.1,
        0.0,
        10 + PI * 2.625 + PI * 3.25 / 4,
        'E',
    ),
    # Seams: a section owns its beginning.
    ('outer', 2.5, 0.25, 0.0, 0.0, 0.0, 0.0, 'A'),
    ('outer', 7.5, 0.25, 0.0, 0.0, 0.0, 5.0, 'B'),
    ('outer', 7.5, 0.15, 0.0, 0.1, 0.0, 5.0, 'B'),
    ('outer', 9.75, 2.5, PI / 2, 0.0, 0.0, 5 + PI * 1.125, 'C'),
    ('outer', 9.75, 7.5, PI / 2, 0.0, 0.0, 10 + PI * 1.125, 'D'),
    ('inner', 9.25, 7.5, -PI / 2, 0.0, 0.0, 0.0, 'C'),
    ('inner', 9.25, 2.5, -PI / 2, 0.0, 0.0, 5.0, 'B'),
    # Headings come round at -pi.
    ('outer', 4.0, 0.25, PI, 0.0, -PI, 1.5, 'A'),
    ('outer', 4.0, 0.25, 4 * PI - 0.1, 0.0, -0.1, 1.5, 'A'),
    # Far off the lane its nearest point counts: outside the road, and in the course's middle.
    ('outer', 5.0, -3.0, 0.0, 3.25, 0.0, 2.5, 'A'),
    ('outer', 12.0, 4.0, PI / 2, 2.25, 0.0, 5 + PI * 1.125 + 1.5, 'C'),
    ('inner', 6.0, 2.0, PI, 1.25, 0.0, 5 + PI * 0.875 + 1.5, 'A'),
]


@pytest.mark.parametrize('case', HAND_COMPUTED, ids=lambda c: f'{c[0]}-{c[7]}-{c[6]:.2f}')
def test_poses_are_located_as_computed_by_hand(
    course: Course, case: tuple[str, float, float, float, float, float, float, str]
) -> None:
    """Straights, turns and seams of both lanes; the same for one pose and for arrays."""
    lane, x, y, heading, distance, error, position, section = case
    point = course.locate(lane, x, y, heading)
    assert point[:3] == pytest.approx((distance, error, position), abs=1e-9)
    assert course.section_name(lane, point.section) == section
    many = course.locate(lane, np.full((2, 3), x), y, [heading])
    assert many.position_m.shape == (2, 3)
    assert tuple(column[1, 2] for column in many) == tuple(point)


@pytest.mark.parametrize('lane', ['outer', 'inner'])
@given(lap=st.floats(0, 1, exclude_max=True), right=st.floats(-0.5, 0.5), turn=st.floats(-3, 3))
@settings(deadline=None)
def test_a_pose_next_to_the_lane_is_located_where_it_was_put(
    course: Course, lane: str, lap: float, right: float, turn: float
) -> None:
    """Points of the lane's outline, shifted at a right angle, give back the shift."""
    centre, length = course.lanes[lane], course.lanes[lane].length_m
    x, y, heading = _pose_by_hand(lane, lap * length)
    point = course.locate(
        lane, x + right * math.sin(heading), y - right * math.cos(heading), heading + turn
    )
    assert point.distance_m == pytest.approx(right, abs=1e-9)
    assert point.heading_error_rad == pytest.approx(turn, abs=1e-9)
    moved = advance(length, lap * length, point.position_m, 0.0)
    assert moved == pytest.approx(0.0, abs=1e-8)
    section = centre.sections[point.section]
    assert section.start_m <= point.position_m < section.end_m


@pytest.mark.parametrize('lane', ['outer', 'inner'])
@given(seam=st.integers(0, 5), right=st.floats(-0.5, 0.5), step=st.floats(-1e-7, 1e-7))
@settings(deadline=None)
def test_nothing_jumps_at_a_seam(
    course: Course, lane: str, seam: int, right: float, step: float
) -> None:
    """A tenth of a micrometre across a seam moves distance, error and position as little."""
    length, at = course.lanes[lane].length_m, course.lanes[lane].sections[seam].start_m
    x, y, heading = _pose_by_hand(lane, at)
    x, y = x + right * math.sin(heading), y - right * math.cos(heading)
    here = course.locate(lane, x, y, heading)
    there = course.locate(
        lane, x + step * math.cos(heading), y + step * math.sin(heading), heading
    )
    assert there.distance_m == pytest.approx(here.distance_m, abs=1e-9)
    assert there.heading_error_rad == pytest.approx(here.heading_error_rad, abs=1e-6)
    assert abs(advance(length, here.position_m, there.position_m, 0.0)) < 1e-6


@given(x=st.floats(-5, 15), y=st.floats(-5, 15))
@settings(deadline=None, max_examples=50)
def test_the_nearest_point_of_the_lane_counts_everywhere(
    course: Course, x: float, y: float
) -> None:
    """No point of a fine outline is nearer than the distance found, from anywhere."""
    outline = course.outline('outer', 0.001)
    nearest = float(np.min(np.hypot(outline[:, 0] - x, outline[:, 1] - y)))
    assert abs(course.locate('outer', x, y, 0.0).distance_m) == pytest.approx(nearest, abs=1e-4)


def test_an_unknown_lane_is_refused(course: Course) -> None:
    """The message lists the lanes."""
    with pytest.raises(CourseError, match="expected outer or inner, got 'middle'"):
        course.locate('middle', 0.0, 0.0, 0.0)


def test_progress_counts_laps_and_not_crossings_of_the_start() -> None:
    """Round the course forwards, and to and fro over the start."""
    progress, last = 0.0, 0.5
    for position in [10.5, 20.5, 30.0, 0.2, 0.6]:
        progress, last = advance(32.0, last, position, progress), position
    assert progress == pytest.approx(32.1)
    progress, last = 0.0, 0.5
    for position in [31.5, 0.5, 31.5, 0.5, 31.0]:
        progress, last = advance(32.0, last, position, progress), position
    assert progress == pytest.approx(-1.5)


def test_outlines_run_round_at_their_offset(course: Course) -> None:
    """Lengths of the polylines approach the circumference; they end where they begin."""
    for line, length in [('outer', OUTER_M), ('inner', INNER_M), (0.0, 10 + 6.5 * PI)]:
        outline = course.outline(line, 0.01)
        steps = np.hypot(*np.diff(outline, axis=0).T)
        assert steps.max() <= 0.01
        assert steps.sum() == pytest.approx(length, abs=1e-4)
        assert outline[0] == pytest.approx(outline[-1])
    assert course.outline(0.0, 0.5)[0] == pytest.approx((2.5, 0.5))
    assert course.outline('inner', 0.5)[0] == pytest.approx((9.25, 7.5))


# x, y, and whether a marking is there in scenarios 1, 2, 3
PAINT = [
    (5.0, 0.0, '1-3'),  # the outer edge next to A, before 4.16 m
    (5.0, 0.019, '1-3'),
    (5.0, 0.021, '---'),
    (5.0, -0.019, '1-3'),
    (5.0, -0.021, '---'),
    (2.51, 0.5, '12-'),  # the first dash, and its end
    (2.799, 0.5, '12-'),
    (2.801, 0.5, '---'),
    (3.099, 0.519, '---'),
    (3.101, 0.519, '12-'),
    (3.101, 0.521, '---'),
    (6.659, 0.0, '1-3'),  # the pattern changes 4.16 m along A
    (6.661, 0.0, '1--'),
    (6.65, 1.0, '1-3'),
    (6.67, 1.0, '1--'),
    (6.75, 0.5, '123'),  # a dash from 4.2 to 4.5 m
    (10.0, 5.0, '1--'),  # next to C
    (9.0, 5.0, '1--'),
    (7.5, 10.0, '1--'),  # the top of D
    (7.5 - 2.5 * ROOT_HALF, 7.5 + 2.5 * ROOT_HALF, '1--'),
    (0.0, 2.5, '1-3'),  # F
    (1.0, 2.5, '1-3'),
    (5.0, 0.75, '---'),  # the lanes' centres are bare
    (0.25, 2.5, '---'),
    (20.0, 20.0, '---'),
]


@pytest.mark.parametrize('number', [1, 2, 3])
def test_markings_are_where_the_paper_s_scenes_have_them(number: int) -> None:
    """Edges, dashes and the places where scenario 3 changes its pattern."""
    course = load_course(f'scenario_{number}')
    x, y, painted = zip(*PAINT, strict=True)
    assert course.intensity(x, y).tolist() == [float(str(number) in where) for where in painted]


def test_dashes_on_a_turn_are_measured_along_the_road_s_centre() -> None:
    """B begins at 5 m: dashes from 5.4 to 5.7 m and from 6.0 to 6.3 m, at 2 m of radius."""
    course = load_course('scenario_2')
    arc_m = np.array([0.399, 0.401, 0.699, 0.701, 0.999, 1.001, 1.299, 1.301])
    x, y = 7.5 + 2.0 * np.sin(arc_m / 2.0), 2.5 - 2.0 * np.cos(arc_m / 2.0)
    assert course.intensity(x, y).tolist() == [0, 1, 1, 0, 0, 1, 1, 0]
    out = np.array([1.981, 1.979, 2.019, 2.021])
    x, y = 7.5 + out * np.sin(0.25), 2.5 - out * np.cos(0.25)
    assert course.intensity(x, y).tolist() == [1, 0, 1, 0]


def test_edges_change_half_way_through_turn_e_in_scenario_3() -> None:
    """E begins at 10 + 3 pi, so 21.7 m is 2.2752 m into it, at 3 m of radius."""
    course = load_course('scenario_3')
    for radius in (2.5, 3.5):
        angle = -(21.7 + np.array([-0.001, 0.001]) - 10 - 3 * PI) / 3.0
        x, y = 2.5 + radius * np.cos(angle), 7.5 + radius * np.sin(angle)
        assert course.intensity(x, y).tolist() == [0, 1]


def test_painted_areas_are_those_of_the_strips(course: Course) -> None:
    """Bright points of a grid of centimetres add up to width times length of edges and dashes."""
    grid = np.arange(-0.495, 10.5, 0.01)
    painted_m2 = np.count_nonzero(course.intensity(grid, grid[:, np.newaxis])) * 0.01**2
    # 50 whole dashes and one that the chain's end leaves whole as well; both edges.
    expected = 0.04 * (51 * 0.3 + 2 * (10 + 6.5 * PI))
    assert painted_m2 == pytest.approx(expected, rel=0.01)


def _pose_by_hand(lane: str, position: float) -> tuple[float, float, float]:
    """Return x, y and heading on the paper's lanes, section by section from its figure."""
    radius, wide = (2.25, 2.75) if lane == 'outer' else (1.75, 3.25)
    quarter, half, bend = PI * radius / 2, PI * radius, PI * wide / 2
    if lane == 'inner':  # the other way round from the end of C
        total = 10 + quarter + 2 * half + bend
        s = (5 + quarter + 5 - position) % total
    else:
        s = position
    turned = 0.0 if lane == 'outer' else PI
    if s < 5:
        return 2.5 + s, 2.5 - radius, turned
    s -= 5
    if s < quarter:
        return _on_circle(7.5, 2.5, radius, -PI / 2 + s / radius, PI / 2 + turned)
    s -= quarter
    if s < 5:
        return 7.5 + radius, 2.5 + s, PI / 2 + turned
    s -= 5
    if s < half:
        return _on_circle(7.5, 7.5, radius, s / radius, PI / 2 + turned)
    s -= half
    if s < bend:
        return _on_circle(2.5, 7.5, wide, -s / wide, -PI / 2 + turned)
    s -= bend
    return _on_circle(2.5, 2.5, radius, PI / 2 + s / radius, PI / 2 + turned)


def _on_circle(
    x: float, y: float, radius: float, angle: float, turn: float
) -> tuple[float, float, float]:
    return x + radius * math.cos(angle), y + radius * math.sin(angle), angle + turn
