"""What is shown: the course with the robot on it, its camera, its lane, its controller.

    course/        markings, robot and the path driven [m]
    camera/        events of a step, and the image they make [px]
    lane/          distance from the lane's centre [m], right of it positive
    controller/    spikes of a step and neuron, reward, weights

A picture's y axis points down, the world's up: what lies on the course is drawn at (x, -y).
Curves and the path break where samples lack, and where an episode begins: no line says what
nobody measured.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any, TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spikelane.figures.course_map import marking_outlines
from spikelane.viewer.layout import blueprint, TIMELINE
from spikelane.viewer.pictures import (
    block_middles,
    event_colours,
    FadingImage,
    in_colour,
    png,
    weights_picture,
)
from spikelane_sim import topic_names
from spikelane_sim.contract import LaneState
from spikelane_sim.events import Events
from spikelane_sim.period import PERIOD_NS

if TYPE_CHECKING:
    from rerun import RecordingStream

    from spikelane_sim.course import Course

_ROAD_RGB, _PAINT_RGB = (104, 114, 125), (255, 255, 255)
_CURVES_RGB = ((0, 130, 200), (213, 94, 0), (0, 158, 115), (204, 121, 167))
_NAME_RGB = (0, 130, 200)  # reads on white and on black
_ROBOT_RGB, _PATH_RGB = (240, 228, 66), (86, 180, 233)
_OUTLINE_STEP_M = 0.05
_MARKING_M, _PATH_M, _ROBOT_M = 0.015, 0.03, 0.06  # radii of lines
_ROBOT_LENGTH_M = 0.45
_LEG_M = 0.25  # of the path, until it is sent again
_STRIDE_M = 0.02  # between the points of the path
_FASTEST_M_S = 0.5  # who moved faster was put somewhere else
_LONGEST_M = 1.0  # between points of the path that a line connects
_LONGEST_GAP_NS = 20 * PERIOD_NS  # between samples of a curve; live ones are taken now and then
_MOST_POINTS = 10_000  # events of a step that are shown as points
_END_S = 2.0
_ABOVE = -1.3  # row of names above a picture of weights


class Scene:
    """Sends records to Rerun, each with its simulation time.

    Sending does not wait for anybody: a thread of Rerun's does it.
    """

    def __init__(self, recording: RecordingStream, *, is_recorded: bool = False) -> None:
        """Lay out the views.

        Args:
            recording: Where to send to, see `connect`.
            is_recorded: Whether every step of a recorded drive is sent, to be played and sought
                in: a step that lacks breaks the curves, and pictures are sent as PNG.
        """
        self._recording = recording
        self._is_recorded = is_recorded
        self._longest_gap_ns = PERIOD_NS if is_recorded else _LONGEST_GAP_NS
        self._sampled_ns: dict[str, int] = {}  # time of the last sample of each curve
        self._neurons: tuple[str, ...] = ()
        self._middles: dict[str, list[float]] = {}  # of the weights of neurons, by array
        self._image = FadingImage()
        self._path: list[list[tuple[float, float]]] = []  # pieces of it
        self._path_end_ns = 0
        self._sent_at = (math.inf, math.inf)
        self._episode = 0
        self._course: Course | None = None
        recording.send_blueprint(blueprint(None, is_recorded=is_recorded))

    def close(self, wait_s: float = _END_S) -> None:
        """Send what is still to be sent, for as long at most."""
        self._recording.flush(timeout_sec=wait_s)
        self._recording.disconnect()

    def show_course(self, course: Course) -> None:
        """Show the course's markings and the edges of its road."""
        import rerun

        self._course = course
        half_m = course.road_width_m / 2
        edges = [course.outline(side * half_m, _OUTLINE_STEP_M) for side in (-1, 1)]
        markings = [np.concatenate([piece, piece[:1]]) for piece in marking_outlines(course)]
        around = np.concatenate([_on_page(line) for line in edges])
        self._recording.send_blueprint(blueprint(around, is_recorded=self._is_recorded))
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

    def show_events(self, stamp_ns: int, events: Events, width: int, height: int) -> int:
        """Show the events of one step, and the image that the latest make.

        Where a step has very many events, an even selection is drawn as points; the image
        shows all.

        Args:
            stamp_ns: Simulation time of the packet [ns].
            events: Within the sensor, (N,).
            width: Columns of the sensor [px].
            height: Rows of the sensor [px].

        Returns:
            How many bytes that is, about.
        """
        import rerun

        image = self._image.add(events, width, height)
        picture = png(image) if self._is_recorded else b''
        shown = rerun.EncodedImage(contents=picture, media_type='image/png') if picture else None
        self._log(stamp_ns, 'camera/image', shown or rerun.Image(image))
        points = events[:: math.ceil(len(events) / _MOST_POINTS) or 1]
        # Half a pixel on, to its middle.
        middles = np.stack([points['x'], points['y']], axis=-1) + 0.5
        self._log(
            stamp_ns,
            'camera/events',
            rerun.Points2D(middles, colors=event_colours(points), radii=0.5),
        )
        return (len(picture) or image.nbytes) + 16 * len(points)

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
        if lane.episode != self._episode:
            self._episode = lane.episode
            self._path.clear()
            self._break_curves()
        self._sample(stamp_ns, topic_names.LANE_DISTANCE, lane.distance_m)
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
        if self._neurons != tuple(neurons):
            self._neurons = tuple(neurons)
            for name, middles in self._middles.items():
                self._name_neurons(stamp_ns, name, middles)
        for neuron, count in zip(neurons, spikes, strict=True):
            self._sample(stamp_ns, f'controller/spikes/{neuron}', count)
        if not math.isnan(reward):
            self._sample(stamp_ns, 'controller/reward', reward)

    def show_weights(self, stamp_ns: int, name: str, weights: NDArray[np.floating]) -> None:
        """Show an array of weights as a picture, the smallest dark and the largest bright.

        Above the weights of each neuron stands its name, where as many neurons are known.

        Raises:
            SpikelaneError: There are none.
        """
        import rerun

        picture = weights_picture(weights)
        self._log(stamp_ns, f'{topic_names.WEIGHTS}/{name}', rerun.Image(in_colour(picture)))
        self._middles[name] = block_middles(weights)
        self._name_neurons(stamp_ns, name, self._middles[name])

    def _name_neurons(self, stamp_ns: int, name: str, middles: Sequence[float]) -> None:
        import rerun

        if not middles or len(middles) != len(self._neurons):
            return
        labels = rerun.Points2D(
            [(x, _ABOVE) for x in middles],
            labels=[f'{neuron} neuron' for neuron in self._neurons],
            radii=0.0,
            colors=[_NAME_RGB],
            show_labels=True,
        )
        self._log(stamp_ns, f'{topic_names.WEIGHTS}/{name}/neurons', labels)

    def _extend_path(self, stamp_ns: int, place: tuple[float, float]) -> None:
        import rerun

        since_s = (stamp_ns - self._path_end_ns) / 1e9
        self._path_end_ns = stamp_ns
        reach_m = _STRIDE_M + _FASTEST_M_S * since_s
        since_m = math.dist(self._path[-1][-1], place) if self._path else math.inf
        if not since_m <= reach_m:
            self._path.clear()
        if not self._path or since_m > _LONGEST_M:
            self._path.append([place])
        elif since_m >= _STRIDE_M:
            self._path[-1].append(place)
        is_first = self._path == [[place]]
        if is_first or math.dist(self._sent_at, place) >= _LEG_M:
            self._sent_at = place
            lines = rerun.LineStrips2D(
                [_on_page(piece) for piece in self._path], radii=_PATH_M, colors=[_PATH_RGB]
            )
            self._log(stamp_ns, 'course/path', lines)

    def _sample(self, stamp_ns: int, curve: str, value: float) -> None:
        """Add a sample to a curve; one that comes too long after the last begins a new line."""
        import rerun

        if curve not in self._sampled_ns:
            # Points, too, so that a sample between two that lack is seen.
            colour = _CURVES_RGB[len(self._sampled_ns) % len(_CURVES_RGB)]
            points = rerun.SeriesPoints(colors=[colour], marker_sizes=[1.5])
            lines = rerun.SeriesLines(colors=[colour], widths=[1.0])
            self._recording.log(curve, lines, points, static=True)
        elif stamp_ns - self._sampled_ns[curve] > self._longest_gap_ns:
            self._break(curve)
        self._sampled_ns[curve] = stamp_ns
        self._log(stamp_ns, curve, rerun.Scalars(value))

    def _break_curves(self) -> None:
        for curve in self._sampled_ns:
            self._break(curve)

    def _break(self, curve: str) -> None:
        import rerun

        self._log(self._sampled_ns[curve] + PERIOD_NS // 2, curve, rerun.Clear(recursive=False))

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


def _on_page(points: ArrayLike) -> NDArray[np.float64]:
    """Return points or directions of the world as those of a picture, (n, 2)."""
    page: NDArray[np.float64] = np.asarray(points, np.float64) * (1.0, -1.0)
    return page
