"""Where a robot is on its lane, from poses in a frame that lies anywhere."""

import math

import pytest

from spikelane_sim.course import load_course, Pose
from spikelane_sim.errors import CourseError, SpikelaneError
from spikelane_sim.lane_tracker import LaneTracker

COURSE = load_course('scenario_1')


def test_poses_in_the_courses_frame_need_no_placing() -> None:
    """The outer lane's first straight is along y = 0.25; right of it is positive."""
    tracker = LaneTracker(COURSE, '', is_placed=True)
    state = tracker.locate(Pose(4.0, 0.2, 0.1))
    assert state is not None
    assert (state.lane, state.section) == ('outer', 'A')
    assert state.distance_m == pytest.approx(0.05)
    assert state.heading_error_rad == pytest.approx(0.1)
    assert state.position_m == pytest.approx(1.5)


def test_odometry_tells_nothing_before_the_robot_is_placed() -> None:
    """It may begin anywhere."""
    tracker = LaneTracker(COURSE, 'outer', is_placed=False)
    assert tracker.locate(Pose(4.0, 0.25, 0.0)) is None


@pytest.mark.parametrize('lane', ['outer', 'inner'])
def test_odometry_counts_from_where_the_robot_was_placed(lane: str) -> None:
    """1 m ahead and 0.1 m to the left of the start, in a frame that is turned by 60 degrees."""
    tracker = LaneTracker(COURSE, lane, is_placed=False)
    start = Pose(-7.0, 3.0, math.pi / 3)
    tracker.place(start)
    first = tracker.locate(start)
    assert first is not None
    assert first.distance_m == pytest.approx(0.0, abs=1e-9)
    cosine, sine = math.cos(start.heading_rad), math.sin(start.heading_rad)
    ahead = Pose(start.x_m + cosine - 0.1 * sine, start.y_m + sine + 0.1 * cosine, math.pi / 3)
    state = tracker.locate(ahead)
    assert state is not None
    assert state.distance_m == pytest.approx(-0.1)
    assert state.progress_m == pytest.approx(1.0)
    assert state.position_m == pytest.approx(first.position_m + 1.0)
    assert state.heading_error_rad == pytest.approx(0.0, abs=1e-9)
    tracker.place(ahead)
    again = tracker.locate(ahead)
    assert again is not None
    assert (again.distance_m, again.progress_m) == (pytest.approx(0.0, abs=1e-9), 0.0)


def test_a_pose_that_is_not_finite_and_an_unknown_lane_are_refused() -> None:
    """By name."""
    tracker = LaneTracker(COURSE, 'outer', is_placed=True)
    for use in (tracker.locate, tracker.place):
        with pytest.raises(SpikelaneError, match='pose: expected finite numbers, got '):
            use(Pose(math.nan, 0.0, 0.0))
    with pytest.raises(CourseError, match='lane: expected outer or inner'):
        LaneTracker(COURSE, 'middle', is_placed=True)
