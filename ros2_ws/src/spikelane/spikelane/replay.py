"""Replay: a recorded drive goes through a controller once more, open loop.

The controller is given the recorded observations, whatever it answers; its answers are compared
with the recorded ones. A controller that drove is reset where it was then, so that with its seed
and parameters every answer is the same, bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import dataclasses
import itertools
from pathlib import Path
import time
from typing import Any, NamedTuple

from spikelane.answer_comparison import Answer, compare, drive_metrics, write_answers
from spikelane.bag.drive import DrivePacket, RecordedDrive
from spikelane.configuration import (
    check_seed,
    configured_controller,
    parameter_groups,
    RunConfig,
)
from spikelane.interruption import check
from spikelane.lap import default_weights
from spikelane.run_folder import RunFolder
from spikelane_controllers.controller_host import ControllerHost, image_size
from spikelane_controllers.registry import controller_class
from spikelane_sim import topic_names
from spikelane_sim.binning import SensorParameters
from spikelane_sim.contract import (
    controller_rng,
    Observation,
    sensors_of,
    STEP_NS,
    STEP_S,
    WheelEncoders,
)
from spikelane_sim.course import load_course, scenario_course
from spikelane_sim.errors import BagError
from spikelane_sim.events import no_events
from spikelane_sim.parameters import Parameters
from spikelane_sim.sensor import Sensor


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplayConfig(RunConfig):
    """What determines a replay.

    Attributes:
        bag: Folder or file.
        events_topic: Where the events are from; None for the usual topic.
        controller: Name in the controllers' registry.
        scenario: Whose shipped weights a controller has that learns.
        seed: Seed of the controller's randomness.
        use_lane_state: Whether the controller is given lane states, and reset by them.
        controller_parameters: Parameters of the controller's own class.
        sensor: How event packets become steps.
    """

    bag: Path
    events_topic: str | None
    controller: str
    scenario: str
    seed: int
    use_lane_state: bool
    controller_parameters: Parameters
    sensor: SensorParameters

    @property
    def usual_name(self) -> str:
        """As in `run_folder.Run`."""
        return f'replay-{self.controller}-seed{self.seed}'

    def check(self) -> None:
        """Make sure that there is what answers.

        Raises:
            SpikelaneError: The controller cannot be made.
        """
        configured_controller(self)


class Replayed(NamedTuple):
    """What came of a replay."""

    answers: list[Answer]
    sensor: Sensor
    processing_s: float  # of decoding and answering all packets
    slowest_packet_s: float


def make_config(
    bag: Path,
    controller: str,
    parameters: Mapping[str, Any],
    *,
    scenario: str = '1',
    seed: int = 0,
    events_topic: str | None = None,
    use_lane_state: bool = True,
) -> ReplayConfig:
    """Make the configuration of a replay.

    Args:
        bag: Folder or file.
        controller: Name in the controllers' registry.
        parameters: Others than the defaults, as `braitenberg.poisson.max_rate_hz` and
            `sensor.crop_left`.
        scenario: Whose shipped weights a controller has that learns.
        seed: Seed of the controller's randomness.
        events_topic: Where the events are from; None for the usual topic.
        use_lane_state: Whether the controller is given lane states.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    load_course(scenario_course(scenario))  # refuses one that is not there
    cls = controller_class(controller).parameters_class
    groups = parameter_groups(
        {**default_weights(scenario, controller), **parameters}, {controller: {}, 'sensor': {}}
    )
    check_seed(seed)
    return ReplayConfig(
        given=parameters,
        bag=Path(bag),
        events_topic=events_topic,
        controller=controller,
        scenario=scenario,
        seed=seed,
        use_lane_state=use_lane_state,
        controller_parameters=cls.from_mapping(groups[controller], controller),
        sensor=SensorParameters.from_mapping(groups['sensor'], 'sensor'),
    )


def replay(
    config: ReplayConfig,
    drive: RecordedDrive,
    show: Callable[[int, float], None] = lambda step, progress_m: None,
) -> Replayed:
    """Let a controller answer a recorded drive.

    A controller that is learning begins with the weights that a training with its seed begins
    with.

    Args:
        config: Controller and seed.
        drive: The recording.
        show: Called after each observation with their number and the way along the lane [m].

    Raises:
        SpikelaneError: The controller cannot be made, or the sensor's parameters do not go with
            the recording.
    """
    host, sensor = _prepare(config, drive)
    _load_kernels(config, drive)
    has_lane = drive.has_lane and config.use_lane_state
    has_encoders = uses_encoders(config)
    answers: list[Answer] = []
    total_s = slowest_s = 0.0
    for recorded in drive.packets():
        if has_encoders and recorded.encoders is None:
            raise BagError(lacks_encoders(config.bag, config.controller, recorded))
        encoders = recorded.encoders if has_encoders else None
        start_s = time.perf_counter()
        new = []
        for step in sensor.add(recorded.packet):
            lane = recorded.lane if has_lane else None
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


def uses_encoders(config: ReplayConfig) -> bool:
    """Return whether the controller uses wheel encoders."""
    return 'encoders' in sensors_of(controller_class(config.controller))


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
    return Sensor(config.sensor, width=width, height=height, has_lane=has_lane, sums_events=True)


def report_replay(
    config: ReplayConfig, drive: RecordedDrive, replayed: Replayed, folder: RunFolder
) -> dict[str, Any]:
    """Write the answers, metrics and figure of a replay.

    Returns:
        The metrics and where everything is, ready for JSON.
    """
    from spikelane.figures.replay import draw_replay

    answers, sensor = replayed.answers, replayed.sensor
    bag = config.bag.absolute()
    name = bag.parent.name if bag.name == folder.bag.name else bag.name  # of its run, if it can
    title = f'{config.controller}, seed {config.seed}, on {name}'
    write_answers(answers, folder.path / 'answers.csv')
    figures = draw_replay(answers, folder.figures / 'replay', title)
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


def summarise(drive: RecordedDrive, answers: Sequence[Answer], sensor: Sensor) -> dict[str, Any]:
    """Return all that is measured of a replay, in-process or over ROS.

    Returns:
        What `drive_metrics` and `compare` give, and
        observations: Steps that the controller was given.
        duration_s: Their duration [s].
        source: 'simulator' or 'camera', as the packets were taken.
        packets, lost_packets, faulty_packets: Event packets read, missing, not decodable.
        reserved_words, events_outside, events_mistimed, restarts: As `Sensor` counts them.
        events: Events decoded: on, off, sum_x and sum_y of their coordinates; kept: those that
            are left after cropping.
        unfinished: packets after the one that completed the last step, and events after that
            step; nothing answers them.
        notes: What is missing, damaged or out of order.
    """
    notes = [*drive.notes, *sensor.notes.values()]
    if failure := unmeasured(answers, sensor):
        notes.append(failure)
    elif sensor.unfinished_events or sensor.unfinished_packets:
        notes.append(
            f'the recording ends within a step: {sensor.unfinished_events} events and '
            f'{sensor.unfinished_packets} whole event packets after the last complete step are '
            'not answered'
        )
    counts = {name: getattr(sensor, name) for name in ('on', 'off', 'sum_x', 'sum_y')}
    return {
        **drive_metrics(answers),
        **compare(answers),
        'observations': len(answers),
        'duration_s': len(answers) * STEP_S,
        'source': 'camera' if sensor.is_camera else 'simulator',
        'packets': sensor.packets,
        'lost_packets': sensor.lost,
        'faulty_packets': sensor.faulty,
        'reserved_words': sensor.reserved,
        'events_outside': sensor.outside,
        'events_mistimed': sensor.mistimed,
        'restarts': sensor.restarts,
        'unfinished': {
            'packets': sensor.unfinished_packets,
            'events': sensor.unfinished_events,
        },
        'events': {**counts, 'kept': sensor.events_in_steps},
        'notes': notes,
    }


def unmeasured(answers: Sequence[Answer], sensor: Sensor) -> str:
    """Return why nothing could be measured of a replay, '' where something could."""
    if sensor.faulty and sensor.faulty == sensor.packets:
        return (
            f'nothing was measured: none of the {sensor.packets} event packets can be decoded: '
            f'{sensor.first_fault}'
        )
    if not answers:
        ms = STEP_NS // 10**6
        return (
            f'nothing was measured: the {sensor.packets} event packets make no complete step of '
            f'{ms} ms'
        )
    return ''


def _prepare(config: ReplayConfig, drive: RecordedDrive) -> tuple[ControllerHost, Sensor]:
    controller: Any = configured_controller(config)
    if getattr(controller, 'learning', False):
        controller.initialise(controller_rng(config.seed, 0))
    return ControllerHost(controller, config.seed), make_sensor(config, drive)


def _load_kernels(config: ReplayConfig, drive: RecordedDrive) -> None:
    """Load what is compiled before anything is timed, with a controller and a sensor to spare."""
    host, sensor = _prepare(config, drive)
    for recorded in itertools.islice(drive.packets(), 1):
        sensor.add(recorded.packet)
        still = WheelEncoders((0.0, 0.0), (0.0, 0.0)) if uses_encoders(config) else None
        host.step(Observation(recorded.packet.stamp_ns, no_events(), None, still))
