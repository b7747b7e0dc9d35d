"""What is shown: the course with the robot on it, its camera, its lane, its controller.

    course/        markings, robot and the path driven [m]
    camera/        events of a step, and the image they make [px]
    lane/          distance from the lane's centre [m], right of it positive
    controller/    spikes of a step and neuron, reward, weights

A picture's y axis points down, the world's up: what lies on the course is drawn at (x, -y).
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any, TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spikelane.figures.course_map import marking_outlines
from spikelane.viewer.pictures import event_colours, FadingImage, in_colour, weights_picture
from spikelane_sim import topic_names
from spikelane_sim.contract import LaneState
from spikelane_sim.events import Events

if TYPE_CHECKING:
    from rerun import RecordingStream

    from spikelane_sim.course import Course

TIMELINE = 'simulation'

_ROAD_RGB, _PAINT_RGB = (104, 114, 125), (255, 255, 255)
_DARK, _BLACK = (32, 38, 45), (0, 0, 0)  # behind the course, where markings are white; the camera
_ROBOT_RGB, _PATH_RGB = (240, 228, 66), (86, 180, 233)
_OUTLINE_STEP_M = 0.05
_MARKING_M, _PATH_M, _ROBOT_M = 0.015, 0.03, 0.06  # radii of lines
_ROBOT_LENGTH_M = 0.45
_LEG_M = 0.25  # of the path, until it is sent again
_STRIDE_M = 0.02  # between the points of the path
_FASTEST_M_S = 0.5  # who moved faster was put somewhere else
_END_S = 2.0


class Scene:
    """Sends records to Rerun, each with its simulation time.

    Sending does not wait for anybody: a thread of Rerun's does it.
    """

    def __init__(self, recording: RecordingStream) -> None:
        """Lay out the views.

        Args:
            recording: Where to send to, see `connect`.
        """
        self._recording = recording
        self._image = FadingImage()
        self._path: list[tuple[float, float]] = []
        self._path_end_ns = 0
        self._sent_at = (math.inf, math.inf)
        self._episode = 0
        self._course: Course | None = None
        recording.send_blueprint(_blueprint())

    def close(self) -> None:
        """Send what is still to be sent."""
        self._recording.flush(timeout_sec=_END_S)
        self._recording.disconnect()

    def show_course(self, course: Course) -> None:
        """Show the course's markings and the edges of its road."""
        import rerun

        self._course = course
        half_m = course.road_width_m / 2
        edges = [course.outline(side * half_m, _OUTLINE_STEP_M) for side in (-1, 1)]
        markings = [np.concatenate([piece, piece[:1]]) for piece in marking_outlines(course)]
        for name, lines, colour in (
            ('road', edges, _ROAD_RGB),
            ('markings', markings, _PAINT_RGB),
        ):
            self._recording.log(
                f'course/{name}',
                rerun.LineStrips2D(
                    [_on_page(line) for line in lines], radii=_MARKING_M, colors=[colour]
                ),
                static=True,
            )

    def show_events(self, stamp_ns: int, events: Events, width: int, height: int) -> None:
        """Show the events of one step, and the image that the latest make.

        Args:
            stamp_ns: Simulation time of the packet [ns].
            events: Within the sensor, (N,).
            width: Columns of the sensor [px].
            height: Rows of the sensor [px].
        """
        import rerun

        # Half a pixel on, to its middle.
        middles = np.stack([events['x'], events['y']], axis=-1) + 0.5
        self._log(
            stamp_ns,
            'camera/events',
            rerun.Points2D(middles, colors=event_colours(events), radii=0.5),
        )
        self._log(stamp_ns, 'camera/image', rerun.Image(self._image.add(events, width, height)))

    def show_robot(self, stamp_ns: int, x_m: float, y_m: float, heading_rad: float) -> None:
        """Show where the robot is, and its path since it was put there.

        Args:
            stamp_ns: Simulation time [ns].
            x_m: x coordinate of its body in the world [m].
            y_m: y coordinate of its body in the world [m].
            heading_rad: Counter-clockwise from the x axis.
        """
        import rerun

        ahead = _ROBOT_LENGTH_M * np.array([math.cos(heading_rad), math.sin(heading_rad)])
        self._log(
            stamp_ns,
            'course/robot',
            rerun.Arrows2D(
                origins=_on_page([(x_m, y_m)]),
                vectors=_on_page([ahead]),
                radii=_ROBOT_M,
                colors=[_ROBOT_RGB],
            ),
        )
        self._extend_path(stamp_ns, (x_m, y_m))

    def show_lane(self, stamp_ns: int, lane: LaneState) -> None:
        """Show the distance from the lane's centre and, on a course that is shown, the robot.

        A new episode begins a new path.

        Raises:
            CourseError: The course has no such lane.
        """
        import rerun

        if lane.episode != self._episode:
            self._episode = lane.episode
            self._path.clear()
        self._log(stamp_ns, topic_names.LANE_DISTANCE, rerun.Scalars(lane.distance_m))
        if self._course is not None:
            self.show_robot(stamp_ns, *place_on_course(self._course, lane))

    def show_controller(
        self, stamp_ns: int, neurons: Sequence[str], spikes: Sequence[int], reward: float
    ) -> None:
        """Show what a controller did in one step.

        Args:
            stamp_ns: Stamp of the observation answered [ns].
            neurons: Names of those observed.
            spikes: What each fired, as many.
            reward: NaN: there is none.
        """
        import rerun

        for neuron, count in zip(neurons, spikes, strict=True):
            self._log(stamp_ns, f'controller/spikes/{neuron}', rerun.Scalars(count))
        if not math.isnan(reward):
            self._log(stamp_ns, 'controller/reward', rerun.Scalars(reward))

    def show_weights(self, stamp_ns: int, name: str, weights: NDArray[np.floating]) -> None:
        """Show an array of weights as a picture, the smallest dark and the largest bright.

        Raises:
            SpikelaneError: There are none.
        """
        import rerun

        picture = in_colour(weights_picture(weights))
        self._log(stamp_ns, f'{topic_names.WEIGHTS}/{name}', rerun.Image(picture))

    def _extend_path(self, stamp_ns: int, place: tuple[float, float]) -> None:
        import rerun

        since_s = (stamp_ns - self._path_end_ns) / 1e9
        self._path_end_ns = stamp_ns
        reach_m = _STRIDE_M + _FASTEST_M_S * since_s
        if self._path and not math.dist(self._path[-1], place) <= reach_m:
            self._path.clear()
        if not self._path or math.dist(self._path[-1], place) >= _STRIDE_M:
            self._path.append(place)
        if len(self._path) == 1 or math.dist(self._sent_at, place) >= _LEG_M:
            self._sent_at = place
            line = rerun.LineStrips2D([_on_page(self._path)], radii=_PATH_M, colors=[_PATH_RGB])
            self._log(stamp_ns, 'course/path', line)

    def _log(self, stamp_ns: int, entity: str, what: Any) -> None:
        self._recording.set_time(TIMELINE, duration=stamp_ns / 1e9)
        self._recording.log(entity, what)


def place_on_course(course: Course, lane: LaneState) -> tuple[float, float, float]:
    """Return x, y [m] and heading [rad] of the robot that has a lane state.

    Raises:
        CourseError: The course has no such lane.
    """
    from spikelane_sim.curve import poses_along

    x_m, y_m, heading_rad = poses_along(course.lane(lane.lane).centre, lane.position_m).tolist()
    right = math.sin(heading_rad), -math.cos(heading_rad)
    return (
        x_m + lane.distance_m * right[0],
        y_m + lane.distance_m * right[1],
        heading_rad + lane.heading_error_rad,
    )


def connect(address: str) -> RecordingStream:
    """Return a connection to a server, under the one name that keeps the user's own layout.

    Args:
        address: Address of a `ViewerServer`.
    """
    import rerun

    recording = rerun.RecordingStream('spikelane')
    recording.connect_grpc(address)
    return recording


def _blueprint() -> Any:
    """Return which views there are and where."""
    import rerun.blueprint as views

    return views.Blueprint(
        views.Horizontal(
            views.Vertical(
                views.Spatial2DView(origin='course', name='Course', background=_DARK),
                views.TimeSeriesView(origin='lane', name='Distance from the lane centre [m]'),
                row_shares=[2, 1],
            ),
            views.Vertical(
                views.Spatial2DView(origin='camera/image', name='Camera image', background=_BLACK),
                views.Spatial2DView(
                    origin='camera/events', name='Events of a step', background=_BLACK
                ),
            ),
            views.Vertical(
                views.TimeSeriesView(origin='controller/spikes', name='Spikes of a step'),
                views.Spatial2DView(origin=topic_names.WEIGHTS, name='Weights'),
                views.TimeSeriesView(
                    origin='controller', contents='$origin/reward', name='Reward'
                ),
            ),
            column_shares=[5, 3, 3],
        ),
        views.TimePanel(state='collapsed', timeline=TIMELINE, play_state='following'),
        collapse_panels=True,
    )


def _on_page(points: ArrayLike) -> NDArray[np.float64]:
    """Return points or directions of the world as those of a picture, (n, 2)."""
    page: NDArray[np.float64] = np.asarray(points, np.float64) * (1.0, -1.0)
    return page
