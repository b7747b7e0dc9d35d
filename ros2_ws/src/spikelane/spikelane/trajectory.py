"""What a lap leaves: where the robot was, what it was told and how much the camera saw.

One row per observation of an episode, the first one (at the reset, step 0) included. The same
columns come from a loop in this process (`TrajectoryRecorder`) and from a bag
(`trajectory_bag.read_trajectory`), and they are equal bit for bit if the runs were.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import csv
import dataclasses
import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.contract import LaneState, Observation, RobotState, WheelVelocities
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.files import write_text_atomically

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_NO_COMMAND = (float('nan'), float('nan'))


class TrajectoryError(SpikelaneError):
    """A trajectory is empty, incomplete or not written as expected."""


class Pose(NamedTuple):
    """Pose of the robot's body (frame base_link) in the world."""

    position: tuple[float, float, float]  # x, y, z [m]
    orientation: tuple[float, float, float, float]  # quaternion x, y, z, w


@dataclasses.dataclass(frozen=True, eq=False)
class Trajectory:
    """One episode as columns of equal length n, a row per observation.

    Attributes:
        lane: Name of the lane driven.
        reason: Why the episode ended, a TERMINATED_ constant; '' where it had not.
        stamp_ns: Simulation time [ns], (n,).
        step: Steps since the reset, (n,).
        distance_m: From the lane's centre [m], right of it positive, (n,).
        heading_error_rad: Robot's heading less the lane's [rad], left positive, (n,).
        position_m: Along the lane's centre from its first section's start [m], (n,).
        progress_m: Along the lane's centre since the reset, counted over laps [m], (n,).
        section: Name of the section of the course, (n,).
        laps: Completed since the reset, (n,).
        x_m: Position in the world [m], (n,).
        y_m: Position in the world [m], (n,).
        heading_rad: In the world, counter-clockwise from x [rad], [-pi, pi], (n,).
        left_rad_s: Command that answered this observation [rad/s], NaN where none did, (n,).
        right_rad_s: The same for the right wheel.
        events: Number of events in this observation, (n,).
    """

    lane: str
    reason: str
    stamp_ns: Integers
    step: Integers
    distance_m: Floats
    heading_error_rad: Floats
    position_m: Floats
    progress_m: Floats
    section: NDArray[np.str_]
    laps: Integers
    x_m: Floats
    y_m: Floats
    heading_rad: Floats
    left_rad_s: Floats
    right_rad_s: Floats
    events: Integers

    def __post_init__(self) -> None:
        """Check the columns.

        Raises:
            TrajectoryError: They differ in length, or there is not one row.
        """
        lengths = {name: len(column) for name, column in self.columns().items()}
        if len(set(lengths.values())) != 1:
            raise TrajectoryError(f'trajectory: expected columns of one length, got {lengths}')
        if not len(self):
            raise TrajectoryError('trajectory: expected at least one observation, got none')

    def __len__(self) -> int:
        """Return the number of observations."""
        return len(self.stamp_ns)

    def columns(self) -> dict[str, NDArray[np.generic]]:
        """Return the columns by name, in the order of the class."""
        return {name: getattr(self, name) for name in COLUMNS}

    def equals(self, other: Trajectory) -> bool:
        """Tell whether the other is the same, bit for bit (a missing command equals another)."""
        return (self.lane, self.reason, len(self)) == (other.lane, other.reason, len(other)) and (
            all(np.array_equal(a, b, equal_nan=a.dtype.kind == 'f') for a, b in self._pairs(other))
        )

    def _pairs(self, other: Trajectory) -> list[tuple[NDArray[np.generic], NDArray[np.generic]]]:
        return list(zip(self.columns().values(), other.columns().values(), strict=True))


_KINDS: dict[str, type] = {
    'stamp_ns': np.int64,
    'step': np.int64,
    'distance_m': np.float64,
    'heading_error_rad': np.float64,
    'position_m': np.float64,
    'progress_m': np.float64,
    'section': np.str_,
    'laps': np.int64,
    'x_m': np.float64,
    'y_m': np.float64,
    'heading_rad': np.float64,
    'left_rad_s': np.float64,
    'right_rad_s': np.float64,
    'events': np.int64,
}

#: Names of the columns, in order.
COLUMNS = tuple(_KINDS)


class TrajectoryRecorder:
    """Gathers a trajectory in a loop; keeps references only, the columns are made at the end."""

    def __init__(self) -> None:
        self._stamps_ns: list[int] = []
        self._lane_states: list[LaneState] = []
        self._robot_states: list[RobotState] = []
        self._commands: list[tuple[float, float]] = []
        self._events: list[int] = []

    def append(
        self, observation: Observation, robot: RobotState, wheels: WheelVelocities | None
    ) -> None:
        """Add an observation.

        Args:
            observation: With a lane state: nobody can say how a robot drove without one.
            robot: The state at the observation's time.
            wheels: The answer to this observation, None where there is none.

        Raises:
            TrajectoryError: The observation has no lane state.
        """
        if observation.lane is None:
            raise TrajectoryError('trajectory: expected a lane state, got an observation without')
        self._stamps_ns.append(observation.stamp_ns)
        self._lane_states.append(observation.lane)
        self._robot_states.append(robot)
        self._commands.append(_NO_COMMAND if wheels is None else wheels)
        self._events.append(len(observation.events))

    def trajectory(self) -> Trajectory:
        """Return what was gathered.

        Raises:
            TrajectoryError: Nothing was.
        """
        poses = [Pose(state.position, state.orientation) for state in self._robot_states]
        return _from_rows(self._stamps_ns, self._lane_states, poses, self._commands, self._events)


def trajectory_from_messages(
    lane_states: Sequence[tuple[int, LaneState]],
    poses: Mapping[int, Pose],
    wheels: Mapping[int, WheelVelocities],
    events: Mapping[int, int],
) -> Trajectory:
    """Put the messages of one episode together by their stamps.

    A recording that began or ended in the middle of a step loses the incomplete observations at
    its ends; those without a command are kept.

    Args:
        lane_states: Stamp [ns] and lane state, in order of time.
        poses: By stamp [ns].
        wheels: Commands by the stamp [ns] of the observation that they answer.
        events: Number of events by stamp [ns].

    Raises:
        TrajectoryError: No observation is complete, or one between complete ones is not.
    """
    complete = [stamp in poses and stamp in events for stamp, _ in lane_states]
    if True not in complete:
        raise TrajectoryError(
            f'trajectory: expected poses and events at the stamps of {len(lane_states)} '
            'lane states, got none'
        )
    first, last = complete.index(True), len(complete) - complete[::-1].index(True)
    if not all(complete[first:last]):
        stamp, state = lane_states[complete.index(False, first)]
        what = 'pose' if stamp not in poses else 'events'
        raise TrajectoryError(f'trajectory: the {what} of step {state.step} ({stamp} ns) is lost')
    kept = lane_states[first:last]
    stamps = [stamp for stamp, _ in kept]
    return _from_rows(
        stamps,
        [state for _, state in kept],
        [poses[stamp] for stamp in stamps],
        [wheels.get(stamp, _NO_COMMAND) for stamp in stamps],
        [events[stamp] for stamp in stamps],
    )


def write_csv(trajectory: Trajectory, path: Path) -> None:
    """Write a trajectory with a header line; numbers are as short as reads back exactly.

    Lane and reason are columns too, the reason in the last row.

    Raises:
        FileError: The file cannot be written.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(['lane', *COLUMNS, 'reason'])
    reasons = [''] * (len(trajectory) - 1) + [trajectory.reason]
    columns = (column.tolist() for column in trajectory.columns().values())
    writer.writerows(zip([trajectory.lane] * len(trajectory), *columns, reasons, strict=True))
    write_text_atomically(path, text.getvalue())


def read_csv(path: Path) -> Trajectory:
    """Read what `write_csv` wrote.

    Raises:
        TrajectoryError: The file is not such a one, or cannot be read.
    """
    try:
        rows = list(csv.reader(Path(path).read_text('utf-8').splitlines(), strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise TrajectoryError(f'{path}: cannot be read: {error}') from None
    expected = ['lane', *COLUMNS, 'reason']
    if not rows or rows[0] != expected:
        raise TrajectoryError(f'{path}: expected the columns {", ".join(expected)}')
    for line, row in enumerate(rows[1:], 2):
        if len(row) != len(expected):
            raise TrajectoryError(
                f'{path}:{line}: expected {len(expected)} values, got {len(row)}'
            )
    lanes, *columns, reasons = zip(*rows, strict=True)
    arrays: dict[str, Any] = {
        name: _parse(path, name, column[1:]) for name, column in zip(COLUMNS, columns, strict=True)
    }
    return Trajectory(lane=lanes[-1], reason=reasons[-1], **arrays)


def _from_rows(
    stamps_ns: Sequence[int],
    lane_states: Sequence[LaneState],
    poses: Sequence[Pose],
    commands: Sequence[tuple[float, float]],
    events: Sequence[int],
) -> Trajectory:
    """Turn one episode's rows into columns."""
    if not lane_states:
        raise TrajectoryError('trajectory: expected at least one observation, got none')
    if len({state.episode for state in lane_states}) > 1:
        raise TrajectoryError('trajectory: expected one episode, got observations of several')
    of_lane: dict[str, Any] = {
        name: np.array([getattr(state, name) for state in lane_states], _KINDS[name])
        for name in COLUMNS
        if name in LaneState._fields
    }
    position = np.array([pose.position for pose in poses], np.float64)
    wheels = np.array(commands, np.float64)
    return Trajectory(
        lane=lane_states[-1].lane,
        reason=lane_states[-1].reason,
        stamp_ns=np.array(stamps_ns, np.int64),
        x_m=position[:, 0],
        y_m=position[:, 1],
        heading_rad=_headings(np.array([pose.orientation for pose in poses], np.float64)),
        left_rad_s=wheels[:, 0],
        right_rad_s=wheels[:, 1],
        events=np.array(events, np.int64),
        **of_lane,
    )


def _headings(quaternions: Floats) -> Floats:
    """Return the angle of the x axis of each body in the ground plane [rad], (n,)."""
    x, y, z, w = quaternions.T
    headings: Floats = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return headings


def _parse(path: Path, name: str, texts: tuple[str, ...]) -> NDArray[np.generic]:
    convert = {np.int64: int, np.float64: float, np.str_: str}[_KINDS[name]]
    values = []
    for line, text in enumerate(texts, 2):
        try:
            values.append(convert(text))
        except ValueError:
            raise TrajectoryError(
                f'{path}:{line}: {name}: expected a number, got {text!r}'
            ) from None
    return np.array(values, _KINDS[name])
