"""Replay: a recorded drive goes through a controller once more, open loop.

The controller is given the recorded observations, whatever it answers; its answers are compared
with the recorded ones. A controller that drove is reset where it was then, so that with its seed
and parameters every answer is the same, bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import csv
import dataclasses
import io
import itertools
import math
from pathlib import Path
import time
from typing import Any, NamedTuple

from spikelane.bag.drive import RecordedDrive
from spikelane.lap import default_weights
from spikelane.metrics import lap_metrics
from spikelane.run_folder import RunFolder
from spikelane.trajectory import Trajectory, TrajectoryRecorder
from spikelane_controllers.hosting import Host, image_size
from spikelane_controllers.registry import controller_class, make_controller
from spikelane_sim.contract import (
    controller_rng,
    LaneState,
    Observation,
    RobotState,
    STEP_S,
    WheelVelocities,
)
from spikelane_sim.course import load_course, scenario_course
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import no_events
from spikelane_sim.files import write_text_atomically
from spikelane_sim.parameters import Parameters
from spikelane_sim.sensor import Sensor, SensorParameters

_NAN3 = (math.nan,) * 3
#: Nobody recorded where the robot was in the world.
_UNKNOWN = RobotState(_NAN3, (math.nan,) * 4, _NAN3, _NAN3, (math.nan,) * 2, (math.nan,) * 2)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplayConfig:
    """What determines a replay.

    Attributes:
        bag: Folder or file.
        events_topic: Where the events are from; None for the usual topic.
        controller: Name in the controllers' registry.
        scenario: Whose shipped weights a controller has that learns.
        seed: Of the controller's randomness.
        use_lane_state: Whether the controller is given lane states, and reset by them.
        controller_parameters: Of the controller's own class.
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

    def to_dict(self) -> dict[str, Any]:
        """Return all of it under names, ready for YAML."""
        return {
            'bag': str(self.bag),
            'events_topic': self.events_topic,
            'controller': self.controller,
            'scenario': self.scenario,
            'seed': self.seed,
            'use_lane_state': self.use_lane_state,
            self.controller: self.controller_parameters.to_dict(),
            'sensor': self.sensor.to_dict(),
        }


class Answer(NamedTuple):
    """An observation and what was answered to it, then and now."""

    stamp_ns: int
    lane: LaneState | None
    events: int
    recorded: WheelVelocities | None  # None where it is not in the bag
    replayed: WheelVelocities | None  # None where there was no answer

    @property
    def is_compared(self) -> bool:
        """Whether there are two answers."""
        return self.recorded is not None and self.replayed is not None

    @property
    def is_equal(self) -> bool:
        """Whether there are two answers, and they are the same."""
        if self.recorded is None or self.replayed is None:
            return False
        return all(
            one == other or (math.isnan(one) and math.isnan(other))
            for one, other in zip(self.recorded, self.replayed, strict=True)
        )

    @property
    def difference_rad_s(self) -> float:
        """The larger of both wheels' differences; NaN where it is not known."""
        if self.recorded is None or self.replayed is None:
            return math.nan
        return max(abs(a - b) for a, b in zip(self.recorded, self.replayed, strict=True))


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
        seed: Of the controller's randomness.
        events_topic: Where the events are from; None for the usual topic.
        use_lane_state: Whether the controller is given lane states.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    load_course(scenario_course(scenario))  # refuses one that is not there
    cls = controller_class(controller).parameters_class
    groups: dict[str, dict[str, Any]] = {controller: {}, 'sensor': {}}
    for name, value in (default_weights(scenario, controller) | dict(parameters)).items():
        group, _, rest = name.partition('.')
        if group not in groups:
            expected = ' or '.join(f'{group}.<name>' for group in groups)
            raise ParameterError(f'unknown parameter {name!r}; expected {expected}')
        groups[group][rest] = value
    if not 0 <= seed < 2**63:
        raise ParameterError(f'seed: expected a whole number from 0 to 2^63 - 1, got {seed}')
    return ReplayConfig(
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
    answers: list[Answer] = []
    total_s = slowest_s = 0.0
    for recorded in drive.packets():
        start_s = time.perf_counter()
        new = []
        for step in sensor.add(recorded.packet):
            lane = recorded.lane if has_lane else None
            wheels = host.step(Observation(step.stamp_ns, step.events, lane))
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
    return Replayed(answers, sensor, total_s, slowest_s)


def make_sensor(config: ReplayConfig, drive: RecordedDrive) -> Sensor:
    """Return what makes steps of a recording's packets for a controller.

    Raises:
        ParameterError: The sensor's parameters do not go with the recording.
    """
    width, height = image_size(config.controller_parameters)
    has_lane = drive.has_lane and config.use_lane_state
    return Sensor(config.sensor, width=width, height=height, has_lane=has_lane)


def compare(answers: Sequence[Answer]) -> dict[str, Any]:
    """Compare recorded and replayed answers.

    Returns:
        answers: Observations that have both.
        equal: Those whose both wheels have the same velocity to the last bit.
        agreement: Their share, 1.0 for all; None where there are none to compare.
        first_difference: Index of the first observation that differs, None where none does.
        first_difference_at: Its stamp, episode, step, and both answers.
        largest_difference_rad_s: Between finite wheel velocities; None where there are none.
        unanswered: Observations that lack an answer in the bag or now.
    """
    compared = [(n, each) for n, each in enumerate(answers) if each.is_compared]
    differing = [(n, each) for n, each in compared if not each.is_equal]
    equal = len(compared) - len(differing)
    known = [each.difference_rad_s for _, each in compared]
    return {
        'answers': len(compared),
        'equal': equal,
        'agreement': equal / len(compared) if compared else None,
        'first_difference': differing[0][0] if differing else None,
        'first_difference_at': _in_full(differing[0][1]) if differing else None,
        'largest_difference_rad_s': max(filter(math.isfinite, known), default=None),
        'unanswered': len(answers) - len(compared),
    }


def drive_metrics(answers: Sequence[Answer]) -> dict[str, Any]:
    """Measure how the robot drove, from the lane states alone.

    Returns:
        steps: Steps driven: the observations but the first of each episode; all of them where
            there are no lane states.
        mean_abs_distance_m: Mean |d| over them, None where it is not known.
        max_abs_distance_m: Largest |d|.
        mean_distance_m: Mean d, right of the lane's centre positive.
        episodes: Number, lane and `metrics.lap_metrics` of each that was driven.
    """
    episodes = split_episodes(answers)
    driven = [each for each in map(_trajectory, episodes) if len(each) > 1]
    distances = [d for each in driven for d in each.distance_m[1:].tolist()]
    mean = math.fsum(distances) / len(distances) if distances else None
    return {
        'steps': len(distances) if episodes else len(answers),
        'mean_abs_distance_m': (
            math.fsum(map(abs, distances)) / len(distances) if distances else None
        ),
        'max_abs_distance_m': max(map(abs, distances), default=None),
        'mean_distance_m': mean,
        'episodes': [
            {'episode': _number(episode), 'lane': _lane(episode), **lap_metrics(each, STEP_S)}
            for episode, each in zip(episodes, map(_trajectory, episodes), strict=True)
            if len(each) > 1
        ],
    }


def split_episodes(answers: Sequence[Answer]) -> list[list[Answer]]:
    """Begin an episode wherever its number changes or its steps begin again.

    Observations without a lane state are left out.
    """
    episodes: list[list[Answer]] = []
    before: LaneState | None = None
    for answer in answers:
        now = answer.lane
        if now is None:
            continue
        if before is None or now.episode != before.episode or now.step <= before.step:
            episodes.append([])
        episodes[-1].append(answer)
        before = now
    return episodes


def make_folder(config: ReplayConfig, out: Path | None) -> RunFolder:
    """Make the folder a replay leaves, with its configuration in it.

    Raises:
        SpikelaneError: The folder is in use or cannot be made.
    """
    usual = Path('runs') / f'replay-{config.controller}-seed{config.seed}'
    folder = RunFolder.create(out or usual, numbered=out is None)
    folder.write_config(config.to_dict())
    return folder


def report_replay(
    config: ReplayConfig, drive: RecordedDrive, replayed: Replayed, folder: RunFolder
) -> dict[str, Any]:
    """Write the answers, metrics and figure of a replay.

    Returns:
        The metrics and where everything is, ready for JSON.
    """
    from spikelane.figures.replay import draw_replay

    answers, sensor = replayed.answers, replayed.sensor
    title = f'{config.controller}, seed {config.seed}, on {config.bag.name}'
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
        duration_s: Of them.
        source: 'simulator' or 'camera', as the packets were taken.
        packets, lost_packets, faulty_packets: Event packets read, missing, not decodable.
        events: Events decoded: on, off, sum_x and sum_y of their coordinates; kept: those that
            are left after cropping.
        notes: What is missing, damaged or out of order.
    """
    notes = list(drive.notes)
    if sensor.faulty:
        notes.append(f'{sensor.faulty} event packets cannot be decoded; taken as empty')
    if sensor.restarts:
        notes.append(f"the camera's time jumped {sensor.restarts} times; steps begin anew there")
    counts = {name: getattr(sensor, name) for name in ('on', 'off', 'sum_x', 'sum_y', 'kept')}
    return {
        **drive_metrics(answers),
        **compare(answers),
        'observations': len(answers),
        'duration_s': len(answers) * STEP_S,
        'source': 'camera' if sensor.is_camera else 'simulator',
        'packets': sensor.packets,
        'lost_packets': sensor.lost,
        'faulty_packets': sensor.faulty,
        'events': counts,
        'notes': notes,
    }


def write_answers(answers: Sequence[Answer], path: Path) -> None:
    """Write a row per observation; empty where nothing is known.

    Raises:
        FileError: The file cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(
        ['stamp_ns', 'episode', 'step', 'distance_m', 'events']
        + ['recorded_left_rad_s', 'recorded_right_rad_s']
        + ['replayed_left_rad_s', 'replayed_right_rad_s']
    )
    none = (None, None)
    for stamp_ns, lane, events, recorded, replayed in answers:
        place = (None, None, None) if lane is None else (lane.episode, lane.step, lane.distance_m)
        writer.writerow([stamp_ns, *place, events, *(recorded or none), *(replayed or none)])
    write_text_atomically(path, text.getvalue())


def _prepare(config: ReplayConfig, drive: RecordedDrive) -> tuple[Host, Sensor]:
    controller: Any = make_controller(config.controller, config.controller_parameters.to_dict())
    if getattr(controller, 'learning', False):
        controller.initialise(controller_rng(config.seed, 0))
    return Host(controller, config.seed), make_sensor(config, drive)


def _load_kernels(config: ReplayConfig, drive: RecordedDrive) -> None:
    """Load what is compiled before anything is timed, with a controller and a sensor to spare."""
    host, sensor = _prepare(config, drive)
    for recorded in itertools.islice(drive.packets(), 1):
        sensor.add(recorded.packet)
        host.step(Observation(recorded.packet.stamp_ns, no_events(), None))


def _trajectory(episode: Sequence[Answer]) -> Trajectory:
    recorder = TrajectoryRecorder()
    for answer in episode:
        # Its events are counted, not looked at again.
        observation = Observation(answer.stamp_ns, no_events(), answer.lane)
        recorder.append(observation, _UNKNOWN, answer.recorded)
    trajectory = recorder.trajectory()
    trajectory.events[:] = [answer.events for answer in episode]
    return trajectory


def _number(episode: Sequence[Answer]) -> int:
    assert episode[0].lane is not None
    return episode[0].lane.episode


def _lane(episode: Sequence[Answer]) -> str:
    assert episode[0].lane is not None
    return episode[0].lane.lane


def _in_full(answer: Answer) -> dict[str, Any]:
    return {
        'stamp_ns': answer.stamp_ns,
        'episode': None if answer.lane is None else answer.lane.episode,
        'step': None if answer.lane is None else answer.lane.step,
        'recorded': _finite(answer.recorded or ()),
        'replayed': _finite(answer.replayed or ()),
    }


def _finite(wheels: Sequence[float]) -> list[float | None]:
    """Return velocities as JSON can hold them."""
    return [each if math.isfinite(each) else None for each in wheels]
