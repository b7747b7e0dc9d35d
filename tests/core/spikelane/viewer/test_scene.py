"""What is sent to Rerun, read back from a recording with Rerun's own reader."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun
from rerun.recording import load_recording

from spikelane.viewer.scene import place_on_course, Scene
from spikelane_sim.contract import LaneState
from spikelane_sim.course import load_course
from spikelane_sim.events import make_events

STEP_NS = 50_000_000


class Shown:
    """A scene that goes to a file, and what is in it."""

    def __init__(self, folder: Path, *, is_recorded: bool = False) -> None:
        self._file = folder / 'scene.rrd'
        self.recording = rerun.RecordingStream('spikelane', recording_id='test')
        self.recording.save(self._file)
        self.scene = Scene(self.recording, is_recorded=is_recorded)

    def read(self, entity: str, component: str) -> dict[float | None, Any]:
        """Return the values of a component by simulation time [s], None for all times."""
        self.recording.flush()
        found: dict[float | None, Any] = {}
        for chunk in load_recording(self._file).chunks():
            batch = chunk.to_record_batch()
            if chunk.entity_path == entity and component in batch.schema.names:
                values = batch.column(component).to_pylist()
                times: list[float | None] = [None] * len(values)
                if not chunk.is_static:
                    ns = batch.column('simulation').to_numpy(zero_copy_only=False)
                    times = (ns.astype('int64') / 1e9).tolist()
                found |= {t: v for t, v in zip(times, values, strict=True) if v is not None}
        return found


@pytest.fixture
def shown(tmp_path: Path) -> Shown:
    """Give an empty scene."""
    return Shown(tmp_path)


def lane(distance_m: float, episode: int) -> LaneState:
    """Return a lane state."""
    return LaneState('outer', distance_m, 0.0, 1.0, 'A', 1.0, 0, episode, 3, False, '')


def test_the_world_s_up_is_up(shown: Shown) -> None:
    """The robot at (3, 0.25) that looks up the y axis; pictures count y downwards."""
    shown.scene.show_robot(STEP_NS, 3.0, 0.25, math.pi / 2)
    assert shown.read('/course/robot', 'Arrows2D:origins') == {0.05: [[3.0, -0.25]]}
    [[vector]] = shown.read('/course/robot', 'Arrows2D:vectors').values()
    assert vector == pytest.approx([0.0, -0.45], abs=1e-6)


def test_all_of_the_course_is_there_for_all_times(shown: Shown) -> None:
    """Two edges of the road; in scenario 2 half of 30.42 m are dashes of 0.3 m."""
    shown.scene.show_course(load_course('scenario_2'))
    [edges] = shown.read('/course/road', 'LineStrips2D:strips').values()
    assert len(edges) == 2
    points = np.concatenate(edges)
    assert points.min(axis=0) == pytest.approx([0.0, -10.0], abs=0.01)
    assert points.max(axis=0) == pytest.approx([10.0, 0.0], abs=0.01)
    [(time, dashes)] = shown.read('/course/markings', 'LineStrips2D:strips').items()
    assert time is None
    assert 50 <= len(dashes) <= 60


def test_events_and_their_image_are_shown(shown: Shown) -> None:
    """Points in the middle of their pixels; an image of the sensor's size."""
    events = make_events([1, 1], [2, 3], [1, 0], [1, -1])
    shown.scene.show_events(2 * STEP_NS, events, 4, 3)
    assert shown.read('/camera/events', 'Points2D:positions') == {0.1: [[2.5, 1.5], [3.5, 0.5]]}
    [[image]] = shown.read('/camera/image', 'Image:format').values()
    assert (image['width'], image['height']) == (4, 3)


def test_the_path_grows_and_begins_again_elsewhere(shown: Shown) -> None:
    """With a new episode, and where the robot jumps further than it could drive."""
    for k, x_m in enumerate((3.0, 3.3, 3.6, 7.0)):
        shown.scene.show_robot((k + 1) * 20 * STEP_NS, x_m, 0.25, 0.0)
    shown.scene.show_lane(81 * STEP_NS, lane(0.0, episode=2))
    shown.scene.show_robot(81 * STEP_NS, 7.01, 0.25, 0.0)
    lines = shown.read('/course/path', 'LineStrips2D:strips')
    points = {time: np.round(line[0], 2).tolist() for time, line in lines.items()}
    assert points == {
        1.0: [[3.0, -0.25]],
        2.0: [[3.0, -0.25], [3.3, -0.25]],
        3.0: [[3.0, -0.25], [3.3, -0.25], [3.6, -0.25]],
        4.0: [[7.0, -0.25]],
        4.05: [[7.01, -0.25]],
    }


def test_numbers_are_shown_over_simulation_time(shown: Shown) -> None:
    """Distance; the spikes of each neuron; no reward where there is none."""
    shown.scene.show_lane(STEP_NS, lane(0.125, episode=1))
    shown.scene.show_lane(2 * STEP_NS, lane(-0.25, episode=1))
    shown.scene.show_controller(STEP_NS, ['left', 'right'], [3, 5], math.nan)
    shown.scene.show_controller(2 * STEP_NS, ['left', 'right'], [4, 6], 0.5)
    scalars = 'Scalars:scalars'
    assert shown.read('/lane/distance', scalars) == {0.05: [0.125], 0.1: [-0.25]}
    assert shown.read('/controller/spikes/left', scalars) == {0.05: [3], 0.1: [4]}
    assert shown.read('/controller/spikes/right', scalars) == {0.05: [5], 0.1: [6]}
    assert shown.read('/controller/reward', scalars) == {0.1: [0.5]}


def cleared(shown: Shown, entity: str) -> list[float | None]:
    """Return when a curve breaks [s]."""
    return [round(time or 0.0, 6) for time in shown.read(entity, 'Clear:is_recursive')]


def test_curves_break_where_samples_lack(shown: Shown) -> None:
    """After a second without any, and with each new episode, half a step after the last sample."""
    for step, episode in ((1, 1), (21, 1), (42, 1), (43, 2)):
        shown.scene.show_lane(step * STEP_NS, lane(0.1, episode))
    shown.scene.show_controller(STEP_NS, ['left'], [3], math.nan)
    shown.scene.show_controller(60 * STEP_NS, ['left'], [4], math.nan)
    assert cleared(shown, '/lane/distance') == [1.075, 2.125]
    assert cleared(shown, '/controller/spikes/left') == [0.075]


def test_one_lacking_step_breaks_the_curves_of_a_recording(tmp_path: Path) -> None:
    """There every step is sent."""
    shown = Shown(tmp_path, is_recorded=True)
    for step in (1, 2, 4):
        shown.scene.show_lane(step * STEP_NS, lane(0.1, 1))
    assert cleared(shown, '/lane/distance') == [0.125]


def test_the_path_has_no_line_where_nobody_looked(shown: Shown) -> None:
    """A metre and more of it is missing: a piece of its own begins."""
    for second, x_m in ((1, 3.0), (2, 3.3), (20, 5.0), (21, 5.3)):
        shown.scene.show_robot(second * 20 * STEP_NS, x_m, 0.25, 0.0)
    [*_, pieces] = shown.read('/course/path', 'LineStrips2D:strips').values()
    assert [np.round(piece, 2)[:, 0].tolist() for piece in pieces] == [[3.0, 3.3], [5.0, 5.3]]


@pytest.mark.parametrize('first', ['weights', 'names'])
def test_the_weights_of_each_neuron_have_its_name(shown: Shown, first: str) -> None:
    """Above the middle of its half, whichever is known first."""

    def name() -> None:
        shown.scene.show_controller(STEP_NS, ['left', 'right'], [3, 5], math.nan)

    if first == 'names':
        name()
    shown.scene.show_weights(STEP_NS, 'weights', np.arange(64.0).reshape(2, 32))
    if first == 'weights':
        name()
    entity = '/controller/weights/weights/neurons'
    [labels] = shown.read(entity, 'Points2D:labels').values()
    [places] = shown.read(entity, 'Points2D:positions').values()
    assert labels == ['left neuron', 'right neuron']
    assert [x for x, _ in places] == [4.0, 13.0]
    assert all(y < 0 for _, y in places)


def test_weights_are_a_picture(shown: Shown) -> None:
    """It has the 4 by 8 cells of both neurons and the gap between them."""
    shown.scene.show_weights(STEP_NS, 'weights', np.arange(64.0).reshape(2, 32))
    [[image]] = shown.read('/controller/weights/weights', 'Image:format').values()
    assert (image['width'], image['height']) == (17, 4)


@pytest.mark.parametrize(
    ('name', 'place'),
    [('outer', (3.0, 0.3, 0.1)), ('outer', (9.6, 4.0, 1.6)), ('inner', (2.6, 7.4, -2.0))],
)
def test_the_robot_s_place_follows_from_its_lane_state(
    name: str, place: tuple[float, float, float]
) -> None:
    """It is what the course locates at this lane state, on straights and arcs of both lanes."""
    course = load_course('scenario_1')
    point = course.locate(name, *place)
    state = lane(point.distance_m, 1)._replace(
        lane=name, position_m=point.position_m, heading_error_rad=point.heading_error_rad
    )
    x_m, y_m, heading_rad = place_on_course(course, state)
    assert (x_m, y_m) == pytest.approx(place[:2], abs=1e-9)
    assert math.remainder(heading_rad - place[2], math.tau) == pytest.approx(0, abs=1e-9)
