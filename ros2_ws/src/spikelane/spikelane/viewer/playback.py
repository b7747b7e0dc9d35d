"""A recorded bag in the viewer: all of its steps are sent at once, to be played and sought in."""

from __future__ import annotations

import collections
from collections.abc import Callable, Iterator
import contextlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from spikelane.bag.drive import DrivePacket, RecordedDrive
from spikelane.bag.source import Faults
from spikelane.interruption import check
from spikelane.viewer.scene import Scene
from spikelane_sim import topic_names
from spikelane_sim.binning import SensorStep
from spikelane_sim.course import load_course, scenario_course
from spikelane_sim.errors import BagError, MessageError, SpikelaneError
from spikelane_sim.messages import to_stamp_ns
from spikelane_sim.period import PERIOD_MS, PERIOD_NS
from spikelane_sim.sensor import Sensor

_STATE = 'spikelane_msgs/msg/ControllerState'
_WEIGHTS = 'spikelane_msgs/msg/Weights'

#: About how much is sent; a server keeps it all.
MOST_BYTES = 1 << 30


class Played(NamedTuple):
    """What of a bag is shown.

    Attributes:
        steps: Steps with events.
        duration_s: From the first step shown to the last.
        notes: What is not shown, missing or damaged, a sentence each.
    """

    steps: int
    duration_s: float
    notes: tuple[str, ...]


class _Said(NamedTuple):
    """A message of a controller."""

    log_ns: int
    fields: Any


class _Controller(NamedTuple):
    """What a controller said."""

    states: dict[int, list[_Said]]  # by stamp [ns]
    weights: collections.deque[_Said]


def bag_of(path: Path) -> Path:
    """Return the bag of a run's folder, or the path itself."""
    inside = path / 'bag'
    return inside if (path / 'config.yaml').exists() and inside.is_dir() else path


def play(
    drive: RecordedDrive,
    scene: Scene,
    *,
    scenario: str | None = None,
    start_s: float = 0.0,
    show: Callable[[float], None] = lambda time_s: None,
    most_bytes: int = MOST_BYTES,
) -> Played:
    """Send a recorded drive.

    Times are those of the simulation. Where these go back, as at a reset, or for a real camera,
    whose clock began anywhere, they count on from what was shown before.

    Args:
        drive: The recording.
        scene: Where it is sent.
        scenario: What it was driven on; None for what the bag says.
        start_s: What is before is not shown [s], counted from the first step.
        show: Called with the time of each step that was sent [s].
        most_bytes: About how many bytes are sent at most.

    Raises:
        BagError: There is no step to show.
    """
    notes = list(drive.notes)
    _show_course(drive, scene, scenario, notes)
    said = _controller_messages(drive, notes)
    clock = _Clock()
    first_ns: int | None = None
    steps = sent = 0
    for step, recorded, (width, height) in _steps(drive, notes):
        time_ns = clock.shown_ns(step.stamp_ns, is_simulated=recorded.lane is not None)
        first_ns = time_ns if first_ns is None else first_ns
        since_s = (time_ns - first_ns) / 1e9
        if since_s < start_s:
            continue
        sent += scene.show_events(time_ns, step.events, width, height)
        if recorded.lane is not None:
            with _noting(notes):
                scene.show_lane(time_ns, recorded.lane)
        with _noting(notes):
            _show_controller(scene, time_ns, step.stamp_ns, recorded.log_ns, said)
        steps += 1
        show(since_s)
        check()
        if sent > most_bytes:
            notes.append(
                f'shown until {since_s:.1f} s, as more would not fit; --start shows later parts'
            )
            break
    if not steps:
        raise BagError(f'{drive.source.path}: expected steps after {start_s:g} s, got none')
    return Played(steps, since_s - start_s, tuple(dict.fromkeys(notes)))


class _Clock:
    """Puts the times of a recording in a row."""

    def __init__(self) -> None:
        self._offset_ns: int | None = None
        self._last_ns = 0

    def shown_ns(self, stamp_ns: int, *, is_simulated: bool) -> int:
        """Return when a step is shown [ns]; a camera's first is at 50 ms."""
        if self._offset_ns is None:
            self._offset_ns = 0 if is_simulated else PERIOD_NS - stamp_ns
        elif stamp_ns + self._offset_ns <= self._last_ns:
            self._offset_ns = self._last_ns + PERIOD_NS - stamp_ns
        self._last_ns = stamp_ns + self._offset_ns
        return self._last_ns


@contextlib.contextmanager
def _noting(notes: list[str]) -> Iterator[None]:
    """Let what cannot be shown be a note: it must not cost what can."""
    try:
        yield
    except (SpikelaneError, ValueError) as error:
        notes.append(f'not shown: {error}')


def _show_course(
    drive: RecordedDrive, scene: Scene, scenario: str | None, notes: list[str]
) -> None:
    """Show the course where it is known which it was."""
    said = scenario or drive.source.custom_data.get('scenario')
    if said:
        with _noting(notes):
            scene.show_course(load_course(scenario_course(said)))
    elif drive.has_lane:
        notes.append('the bag does not say which course it was: --scenario shows one')


def _steps(
    drive: RecordedDrive, notes: list[str]
) -> Iterator[tuple[SensorStep, DrivePacket, tuple[int, int]]]:
    """Yield the steps with the packets that complete them and the camera's size."""
    sensor: Sensor | None = None
    size = 0, 0
    for recorded in drive.packets():
        packet = recorded.packet
        if sensor is None or (size != (packet.width, packet.height) and packet.width):
            size = packet.width, packet.height
            sensor = Sensor(
                width=size[0],
                height=size[1],
                period_ns=(drive.period_ms or PERIOD_MS) * 1_000_000,
                has_lane=drive.has_lane,
                any_size=True,
            )
        for step in sensor.add(packet, recorded.lane):
            yield step, recorded, size
    if sensor is not None:
        notes += sensor.notes.values()


def _controller_messages(drive: RecordedDrive, notes: list[str]) -> _Controller:
    """Read what the controller published about itself, in addition to its answers."""
    prefix = drive.events_topic.removesuffix(topic_names.EVENTS)
    prefix = prefix if prefix != drive.events_topic else '/'
    said = _Controller({}, collections.deque())
    faults = Faults()
    for message in drive.source.messages((_STATE, _WEIGHTS)):
        if message.topic not in (
            prefix + topic_names.CONTROLLER_STATE,
            prefix + topic_names.WEIGHTS,
        ):
            continue
        try:
            fields = drive.source.read(message)
            if message.type_name == _WEIGHTS:
                said.weights.append(_Said(message.log_ns, fields))
            else:
                stamp_ns = to_stamp_ns(fields.header.stamp)
                said.states.setdefault(stamp_ns, []).append(_Said(message.log_ns, fields))
        except (BagError, MessageError) as error:
            faults.add(message.topic, str(error))
    notes += faults.notes('messages cannot be read')
    return said


def _show_controller(
    scene: Scene, time_ns: int, stamp_ns: int, log_ns: int, said: _Controller
) -> None:
    """Show the answer to a step, and the weights that were recorded until then.

    Where a stamp comes again, as simulation time was reset, the answer recorded next to the step
    is the one.
    """
    if states := said.states.get(stamp_ns):
        nearest = min(states, key=lambda each: abs(each.log_ns - log_ns))
        states.remove(nearest)
        fields = nearest.fields
        scene.show_controller(
            time_ns, fields.neurons, [int(count) for count in fields.spikes], fields.reward
        )
    while said.weights and said.weights[0].log_ns <= log_ns:
        fields = said.weights.popleft().fields
        weights = np.asarray(fields.data).reshape(tuple(fields.shape))
        scene.show_weights(time_ns, fields.name, weights)
