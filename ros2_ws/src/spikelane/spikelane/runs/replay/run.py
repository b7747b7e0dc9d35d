"""Replay: a recorded drive goes through a controller once more, open loop.

The controller receives the recorded observations, whatever it answers; its answers are compared
with the recorded ones. A controller that drove is reset where it was then, so that with its seed
and parameters every answer is the same, bit for bit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
import itertools
from pathlib import Path
import time
from typing import Any, NamedTuple

from spikelane.bag.changes import RecordedChange
from spikelane.bag.drive import DrivePacket, RecordedDrive
from spikelane.interruption import check
from spikelane.runs.configuration import (
    configured_controller,
)
from spikelane.runs.folder import RunFolder
from spikelane.runs.replay.config import ReplayConfig, uses_encoders
from spikelane.runs.replay.metrics import Answer, summarise, write_answers
from spikelane_controllers.controller_host import (
    ControllerHost,
    image_size,
    period_ms_of,
    period_ns_of,
)
from spikelane_controllers.registry import title as controller_title
from spikelane_sim import topic_names
from spikelane_sim.contract import (
    controller_rng,
    Observation,
    WheelEncoders,
)
from spikelane_sim.errors import BagError
from spikelane_sim.events import no_events
from spikelane_sim.sensor import Sensor


class Replayed(NamedTuple):
    """What came of a replay."""

    answers: list[Answer]
    sensor: Sensor
    processing_s: float  # of decoding and answering all packets
    slowest_packet_s: float


def replay(
    config: ReplayConfig,
    drive: RecordedDrive,
    show: Callable[[int, float], None] = lambda step, progress_m: None,
    changes: Sequence[RecordedChange] = (),
) -> Replayed:
    """Let a controller answer a recorded drive.

    A controller that is learning begins with the weights that a training with its seed begins
    with.

    Args:
        config: Controller and seed.
        drive: The recording.
        show: Called after each observation with their number and the way along the lane [m].
        changes: Changes of the controller's parameters; each is made again where it took effect.

    Raises:
        SpikelaneError: The controller cannot be made, or the sensor's parameters do not go with
            the recording.
    """
    host, sensor = _prepare(config, drive)
    _load_kernels(config, drive)
    has_lane = drive.has_lane and config.use_lane_state
    has_encoders = uses_encoders(config)
    answers: list[Answer] = []
    changing = ChangesAgain(host, changes)
    total_s = slowest_s = 0.0
    for recorded in drive.packets():
        if has_encoders and recorded.encoders is None:
            raise BagError(lacks_encoders(config.bag, config.controller, recorded))
        encoders = recorded.encoders if has_encoders else None
        start_s = time.perf_counter()
        new = []
        lane = recorded.lane if has_lane else None
        for step in sensor.add(recorded.packet, lane):
            changing.make(step.stamp_ns, recorded.log_ns)
            wheels = host.step(Observation(step.stamp_ns, step.events, lane, encoders))
            new.append((step, wheels))
        seconds = time.perf_counter() - start_s
        total_s, slowest_s = total_s + seconds, max(slowest_s, seconds)
        for step, wheels in new:
            answers.append(
                Answer(
                    step.stamp_ns,
                    None if sensor.is_camera else recorded.lane,
                    len(step.events),
                    drive.answer(step.stamp_ns, recorded),
                    wheels,
                )
            )
            show(len(answers), recorded.lane.progress_m if recorded.lane else 0.0)
        check()
    return Replayed(answers, sensor, total_s, slowest_s)


class ChangesAgain:
    """Makes the changes of a recorded drive again, each before the observation it began with."""

    def __init__(self, host: ControllerHost, changes: Sequence[RecordedChange]) -> None:
        """Begin before the first change.

        Args:
            host: The host of the controller.
            changes: In the order of recording.
        """
        self._host = host
        self._left = deque(changes)

    def make(self, stamp_ns: int, log_ns: int) -> None:
        """Make the changes that are due.

        Where the observation that a change began with is missing, it is due with the next one.

        Args:
            stamp_ns: Stamp of the next observation.
            log_ns: When its packet was recorded.

        Raises:
            ParameterError: A change is not allowed: the bag is of another version.
        """
        while self._left:
            begin_ns = self._left[0].change.stamp_ns
            is_late = stamp_ns > begin_ns and log_ns > self._left[0].log_ns
            if not (stamp_ns == begin_ns or is_late):
                return
            assert self._host.changing is not None  # the controller has parameters that change
            self._host.changing.change(self._left.popleft().change.values)


def lacks_encoders(bag: Path, controller: str, recorded: DrivePacket) -> str:
    """Return what a bag lacks for a controller that uses encoders, at a packet without any."""
    return (
        f'{bag}: expected {topic_names.JOINT_STATES} of the wheels with the stamp '
        f'{recorded.packet.stamp_ns} ns, since {controller} uses wheel encoders, got none; a lap '
        'records them where its controller uses them'
    )


def make_sensor(config: ReplayConfig, drive: RecordedDrive) -> Sensor:
    """Return what makes steps of a recording's packets for a controller.

    Raises:
        ParameterError: The sensor's parameters do not go with the recording.
    """
    width, height = image_size(config.controller_parameters)
    has_lane = drive.has_lane and config.use_lane_state
    return Sensor(
        config.sensor,
        config.filter,
        width=width,
        height=height,
        period_ns=period_ns_of(config.controller_parameters),
        has_lane=has_lane,
        sums_events=True,
    )


def report_replay(
    config: ReplayConfig, drive: RecordedDrive, replayed: Replayed, folder: RunFolder
) -> dict[str, Any]:
    """Write the answers, metrics and figure of a replay.

    Returns:
        The metrics and where everything is, ready for JSON.
    """
    from spikelane.runs.replay.figure import draw_replay

    answers, sensor = replayed.answers, replayed.sensor
    bag = config.bag.absolute()
    name = bag.parent.name if bag.name == folder.bag.name else bag.name  # of its run, if it can
    title = f'{controller_title(config.controller)}, seed {config.seed}, on {name}'
    write_answers(answers, folder.path / 'answers.csv')
    figures = draw_replay(answers, folder.figures / 'replay', title, sensor.period_ns / 1e9)
    result = {
        'bag': str(config.bag),
        'controller': config.controller,
        'scenario': config.scenario,
        'seed': config.seed,
        **summarise(drive, answers, sensor),
        'processing_s': replayed.processing_s,
        'slowest_packet_s': replayed.slowest_packet_s,
        'folder': str(folder.path),
        'figure': str(figures[0]) if figures else None,
    }
    folder.write_metrics(result)
    return result


def _prepare(config: ReplayConfig, drive: RecordedDrive) -> tuple[ControllerHost, Sensor]:
    controller: Any = configured_controller(config)
    if getattr(controller, 'learning', False):
        controller.initialise(controller_rng(config.seed, 0))
    parameters = config.controller_parameters
    host = ControllerHost(controller, config.seed, parameters, period_ms_of(parameters))
    return host, make_sensor(config, drive)


def _load_kernels(config: ReplayConfig, drive: RecordedDrive) -> None:
    """Load what is compiled before anything is timed, with a controller and a sensor to spare."""
    host, sensor = _prepare(config, drive)
    for recorded in itertools.islice(drive.packets(), 1):
        sensor.add(recorded.packet)
        still = WheelEncoders((0.0, 0.0), (0.0, 0.0)) if uses_encoders(config) else None
        host.step(Observation(recorded.packet.stamp_ns, no_events(), None, still))
