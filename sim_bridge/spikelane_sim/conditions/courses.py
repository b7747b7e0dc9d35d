"""The courses that episodes of one simulator are on, checked for whether they can follow."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from spikelane_sim.conditions.schedule import Schedule
from spikelane_sim.course import Course, load_course
from spikelane_sim.errors import ParameterError


def load_courses(schedule: Schedule) -> Mapping[str, Course]:
    """Return all courses of a schedule by name, the simulator's own first.

    Raises:
        SpikelaneError: There is no such course, courses of different episodes have other lanes,
            or markings belong to another road.
    """
    found = {name: load_course(name) for name in schedule.courses}
    first = next(iter(found.values()))
    for name in schedule.markings:
        if schedule.is_on_several_courses or not _is_same_road(found[name], first):
            raise ParameterError(
                f'markings: expected a course with the lanes of {first.name}, on which all '
                f'episodes are, got {name}'
            )
    for name, course in found.items():
        if tuple(course.lanes) != tuple(first.lanes):
            raise ParameterError(
                f'randomisation.courses: expected courses with lanes {", ".join(first.lanes)}, '
                f'got {name} with {", ".join(course.lanes)}'
            )
    return found


def _is_same_road(one: Course, other: Course) -> bool:
    return tuple(one.lanes) == tuple(other.lanes) and all(
        np.array_equal(lane.centre, other.lanes[name].centre) for name, lane in one.lanes.items()
    )
