"""Answers of a controller compared with the recorded ones, and the drive measured by them."""

from __future__ import annotations

from collections.abc import Sequence
import csv
import io
import math
from pathlib import Path
from typing import Any, NamedTuple

from spikelane.bag.drive import RecordedDrive
from spikelane.runs.lap.metrics import lap_metrics
from spikelane.runs.lap.trajectory import Trajectory, TrajectoryRecorder
from spikelane_sim.contract import (
    LaneState,
    Observation,
    RobotState,
    WheelVelocities,
)
from spikelane_sim.events import no_events
from spikelane_sim.files import write_text_atomically
from spikelane_sim.sensor import Sensor

_NAN3 = (math.nan,) * 3
#: Nobody recorded where the robot was in the world.
_UNKNOWN = RobotState(_NAN3, (math.nan,) * 4, _NAN3, _NAN3, (math.nan,) * 2, (math.nan,) * 2)


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


def compare(answers: Sequence[Answer]) -> dict[str, Any]:
    """Compare recorded and replayed answers.

    Returns:
        answers: Observations that have both.
        equal: Those whose both wheels have the same velocity to the last bit.
        agreement: Their share, 1.0 for all; None where there are none to compare.
        first_difference: Index of the first observation that differs, None where none does.
        first_difference_at: Its stamp, episode, step, and both answers.
        largest_difference_rad_s: Between finite wheel velocities; None where there are none.
        answered: Observations that the controller answered now, recorded answer or not.
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
        'answered': sum(each.replayed is not None for each in answers),
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
            {
                'episode': _number(episode),
                'lane': _lane(episode),
                **lap_metrics(each, each.period_s),
            }
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


def summarise(drive: RecordedDrive, answers: Sequence[Answer], sensor: Sensor) -> dict[str, Any]:
    """Return all that is measured of a replay, in-process or over ROS.

    Returns:
        What `drive_metrics` and `compare` give, and
        observations: Steps that the controller was given.
        duration_s: Their duration [s].
        source: 'simulator' or 'camera', as the packets were taken.
        packets, lost_packets, faulty_packets: Event packets read, missing, not decodable.
        reserved_words, events_outside, events_mistimed, restarts: As `Sensor` counts them.
        events: Events decoded: on, off, sum_x and sum_y of their coordinates; passed: those that
            the filters let pass; kept: those that are left after cropping.
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
        'duration_s': len(answers) * sensor.period_ns / 1e9,
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
        'events': {**counts, 'passed': sensor.events_out, 'kept': sensor.events_in_steps},
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
        ms = sensor.period_ns // 10**6
        return (
            f'nothing was measured: the {sensor.packets} event packets make no complete step of '
            f'{ms} ms'
        )
    return ''
