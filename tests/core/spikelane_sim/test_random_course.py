"""Random courses: every seed makes a road that can be driven, the same one always."""

from __future__ import annotations

import math

import numpy as np
import pytest

from spikelane_sim import curve as curves
from spikelane_sim.course import Course, course_label, load_course
from spikelane_sim.errors import CourseError
from spikelane_sim.random_course import draw_records, expand_courses

N = 200
#: What random:7 has: widths of lane and dash, intensities, the first straight and the next turn.
PINNED = (
    0.534,
    0.29,
    0.026,
    0.938,
    3.707065611,
    2.505967298,
    0.6480881399870383,
)


@pytest.fixture(scope='module')
def courses() -> list[Course]:
    """200 random courses; that they load says that they passed every check of a course file."""
    return [load_course(f'random:{seed}') for seed in range(N)]


def test_each_closes_after_one_turn_to_the_left(courses: list[Course]) -> None:
    """Points and headings, found by adding up chords of a millimetre."""
    for course in courses[:20]:
        length = curves.length_of(course.centre_line)
        n = math.ceil(length / 0.001)
        poses = curves.poses_along(course.centre_line, np.arange(n) * (length / n))
        steps = length / n * np.exp(1j * poses[:, 2])
        assert abs(steps.sum()) < 1e-3
    for course in courses:
        curvature, length = (course.centre_line[:, i] for i in (curves.CURVATURE, curves.LENGTH))
        assert curvature @ length == pytest.approx(math.tau, abs=1e-7)
        assert curves.end_pose(course.centre_line)[:2] == pytest.approx((0.0, 0.0), abs=1e-7)


def test_no_road_overlaps_itself(courses: list[Course]) -> None:
    """Points of the centre line a quarter of the road or more apart keep the road's width."""
    for course in courses[:50]:
        points = course.outline(0.0, 0.1)[:-1]
        n, length = len(points), curves.length_of(course.centre_line)
        along = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) * (length / n)
        far = np.minimum(along, length - along) > length / 4
        apart = np.hypot(*np.moveaxis(points[:, None] - points[None], -1, 0))
        assert apart[far].min() >= course.road_width_m - 0.1


def test_what_is_drawn_stays_within_its_bounds(courses: list[Course]) -> None:
    """Radii of 1.5 to 4 m, lanes of 0.4 to 0.6 m, dashes and gaps of 0.2 to 0.5 m, light."""
    for course in courses:
        curvature = course.centre_line[:, curves.CURVATURE]
        radii = 1 / np.abs(curvature[curvature != 0])
        assert radii.min() >= 1.5 - 1e-9
        assert radii.max() <= 4.0 + 1e-9
        assert 0.4 <= course.lane_width_m <= 0.6
        assert course.road_width_m == 2 * course.lane_width_m
        left, dashed, right = course.markings
        assert (left.offset_m, dashed.offset_m, right.offset_m) == (
            course.lane_width_m,
            0.0,
            -course.lane_width_m,
        )
        assert 0.2 <= dashed.dash_m <= 0.5
        assert 0.2 <= dashed.gap_m <= 0.5
        assert math.isinf(left.dash_m)
        assert 0.0 <= course.ground.floor_intensity <= 0.2
        assert 0.6 <= course.ground.marking_intensity <= 1.0
        assert 15 < course.lanes['inner'].length_m < course.lanes['outer'].length_m < 60


def test_they_differ_and_many_turn_to_the_right_too(courses: list[Course]) -> None:
    """No two have the same length, width or dashes; of three in four a turn goes right."""
    assert len({curves.length_of(course.centre_line) for course in courses}) == N
    assert len({(course.lane_width_m, course.markings[1].dash_m) for course in courses}) == N
    right = [(course.centre_line[:, curves.CURVATURE] < 0).any() for course in courses]
    assert 130 <= sum(right) <= 170


def test_a_seed_makes_the_same_course_always() -> None:
    """Numbers that were written down once: other machines must find them, too."""
    record = next(draw_records('random:7'))
    assert record == next(draw_records('random:7'))
    assert record.name == 'random:7'
    assert [part.section for part in record.parts] == list('ABCDEFGHIJKLMNOPQR')
    assert (
        record.lane_width_m,
        record.markings[1].dash_m,
        record.floor_intensity,
        record.marking_intensity,
        record.parts[0].length_m,
        record.parts[1].length_m,
        record.parts[1].curvature,
    ) == PINNED


def test_a_list_of_courses_may_name_many() -> None:
    """So many from seed 0, or a range of seeds; others stand for themselves."""
    assert expand_courses('random:3') == ('random:0', 'random:1', 'random:2')
    assert expand_courses('random:7-8') == ('random:7', 'random:8')
    assert expand_courses('scenario_1') == ('scenario_1',)
    assert course_label('random:7') == 'random-7'


@pytest.mark.parametrize('name', ['random:', 'random:x', 'random:-1', 'random:1.5', 'random:²'])
def test_another_name_is_refused(name: str) -> None:
    """One course, or several."""
    with pytest.raises(CourseError, match=r'course: expected random:SEED with whole numbers'):
        load_course(name)
    with pytest.raises(CourseError, match=r'course: expected random:.* with whole numbers'):
        expand_courses(name)


@pytest.mark.parametrize('name', ['random:0', 'random:8-7', f'random:{2**32}'])
def test_no_course_and_too_large_seeds_are_refused(name: str) -> None:
    """Nothing would be driven."""
    with pytest.raises(CourseError, match='course: expected'):
        expand_courses(name)
