"""Where a real robot is on a known course: from its pose, whoever measures that.

Odometry begins anywhere: where the robot is placed on the start of its lane, somebody has to say
so, and the frame of the poses is moved there. A system that knows the course's frame, as motion
capture or tags on the floor, needs that only where its frame is another.
"""

from __future__ import annotations

import math

from spikelane_sim.contract import LaneState
from spikelane_sim.course import Course, Pose
from spikelane_sim.episode_rules import advance
from spikelane_sim.errors import SpikelaneError


class LaneTracker:
    """Follows a robot along one lane of a course.

    Attributes:
        is_placed: Whether it is known how the frame of the poses lies in that of the course.
    """

    def __init__(self, course: Course, lane: str, *, is_placed: bool) -> None:
        """Begin.

        Args:
            course: The course.
            lane: Name of the lane; empty for the course's first.
            is_placed: Whether poses are in the frame of the course from the beginning.

        Raises:
            CourseError: No such lane.
        """
        self._course = course
        self._lane = course.lane(lane or next(iter(course.lanes)))
        self.is_placed = is_placed
        self._origin = Pose(0.0, 0.0, 0.0)  # of the poses' frame, in the course's
        self._position_m: float | None = None
        self._progress_m = 0.0

    def place(self, pose: Pose) -> None:
        """Take it that a robot with this pose stands at the start of the lane.

        Args:
            pose: In the frame of the poses.

        Raises:
            SpikelaneError: A number is not finite.
        """
        _check(pose)
        start = self._lane.start
        turn_rad = start.heading_rad - pose.heading_rad
        x_m, y_m = _turned(pose.x_m, pose.y_m, turn_rad)
        self._origin = Pose(start.x_m - x_m, start.y_m - y_m, turn_rad)
        self.is_placed = True
        self._position_m, self._progress_m = None, 0.0

    def locate(self, pose: Pose) -> LaneState | None:
        """Return where a robot is on the lane; None before it is placed.

        Episode and step are 0, since nobody counts them here.

        Args:
            pose: In the frame of the poses.

        Raises:
            SpikelaneError: A number is not finite.
        """
        _check(pose)
        if not self.is_placed:
            return None
        x_m, y_m = _turned(pose.x_m, pose.y_m, self._origin.heading_rad)
        point = self._course.locate(
            self._lane.name,
            x_m + self._origin.x_m,
            y_m + self._origin.y_m,
            pose.heading_rad + self._origin.heading_rad,
        )
        if self._position_m is not None:
            self._progress_m = advance(
                self._lane.length_m, self._position_m, point.position_m, self._progress_m
            )
        self._position_m = point.position_m
        return LaneState(
            lane=self._lane.name,
            distance_m=point.distance_m,
            heading_error_rad=point.heading_error_rad,
            position_m=point.position_m,
            section=self._course.section_name(self._lane.name, point.section),
            progress_m=self._progress_m,
            laps=max(0, math.floor(self._progress_m / self._lane.length_m)),
            episode=0,
            step=0,
            terminated=False,
            reason='',
        )


def _check(pose: Pose) -> None:
    if not all(map(math.isfinite, pose)):
        raise SpikelaneError(f'pose: expected finite numbers, got {tuple(pose)}')


def _turned(x_m: float, y_m: float, turn_rad: float) -> tuple[float, float]:
    cosine, sine = math.cos(turn_rad), math.sin(turn_rad)
    return cosine * x_m - sine * y_m, sine * x_m + cosine * y_m
