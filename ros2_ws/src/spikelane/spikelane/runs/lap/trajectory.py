"""What a lap leaves: where the robot was, its commands and how much the camera saw.

One row per observation of an episode, the first one (at the reset, step 0) included. The same
columns come from a loop in this process (`TrajectoryRecorder`) and from a bag
(`trajectory_bag.read_trajectory`), and they are equal bit for bit if the runs were.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import csv
import dataclasses
import io
import math
import operator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spikelane.runs.lap.column_store import ColumnStore
from spikelane_sim.contract import LaneState, Observation, RobotState, WheelVelocities
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.files import written_whole
from spikelane_sim.period import PERIOD_NS

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_NO_COMMAND = (float('nan'), float('nan'))
_COMMANDS = ('left_rad_s', 'right_rad_s')
_INT64 = 2**63
_CSV_ROWS = 10_000  # that are turned into text at a time


class TrajectoryError(SpikelaneError):
    """A trajectory is empty, incomplete or not written as expected."""


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

    @property
    def period_s(self) -> float:
        """Length of a step, as the stamps tell; 50 ms where there is one observation alone."""
        steps = int(self.step[-1] - self.step[0])
        lasted_ns = int(self.stamp_ns[-1] - self.stamp_ns[0])
        return round(lasted_ns / steps) / 1e9 if steps > 0 and lasted_ns > 0 else PERIOD_NS / 1e9

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


#: Columns that are fields of a lane state.
LANE_KINDS = {name: kind for name, kind in _KINDS.items() if name in LaneState._fields}

_ORIENTATION = ('orientation_x', 'orientation_y', 'orientation_z', 'orientation_w')
_ROW_KINDS: dict[str, type] = {
    'stamp_ns': np.int64,
    **LANE_KINDS,
    'x_m': np.float64,
    'y_m': np.float64,
    **dict.fromkeys(_ORIENTATION, np.float64),
    'left_rad_s': np.float64,
    'right_rad_s': np.float64,
    'events': np.int64,
}

#: Returns the values of a lane state that are columns, in the order of `LANE_KINDS`.
lane_values: Callable[[LaneState], tuple[Any, ...]] = operator.attrgetter(*LANE_KINDS)


class TrajectoryRecorder:
    """Gathers a trajectory in a loop, some 150 bytes a step."""

    def __init__(self) -> None:
        self._store = ColumnStore(_ROW_KINDS)
        self._lane: LaneState | None = None  # of the last observation
        self._episodes: set[int] = set()

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
        lane = observation.lane
        if lane is None:
            raise TrajectoryError('trajectory: expected a lane state, got an observation without')
        left, right = _NO_COMMAND if wheels is None else wheels
        x_m, y_m, _ = robot.position
        values = (x_m, y_m, *robot.orientation, left, right, len(observation.events))
        self._store.append((observation.stamp_ns, *lane_values(lane), *values))
        self._episodes.add(lane.episode)
        self._lane = lane

    def trajectory(self) -> Trajectory:
        """Return what was gathered.

        Raises:
            TrajectoryError: Nothing was, or observations of several episodes.
        """
        if self._lane is None:
            raise TrajectoryError('trajectory: expected at least one observation, got none')
        if len(self._episodes) > 1:
            raise TrajectoryError('trajectory: expected one episode, got observations of several')
        return trajectory_from_columns(self._lane.lane, self._lane.reason, self._store.columns())


def trajectory_from_columns(
    lane: str, reason: str, columns: Mapping[str, NDArray[Any]]
) -> Trajectory:
    """Make a trajectory of columns.

    Args:
        lane: As in `Trajectory`.
        reason: As in `Trajectory`.
        columns: Those of `Trajectory`, (n,) each, but the orientation as a quaternion
            (`orientation_x` to `orientation_w`) in place of the heading.

    Raises:
        TrajectoryError: There is no row.
    """
    own = {name: columns[name] for name in COLUMNS if name in columns}
    heading_rad = _headings(*(columns[name] for name in _ORIENTATION))
    return Trajectory(lane=lane, reason=reason, heading_rad=heading_rad, **own)


def write_csv(trajectory: Trajectory, path: Path) -> None:
    """Write a trajectory with a header line; numbers are as short as reads back exactly.

    Lane and reason are columns too, the reason in the last row.

    Raises:
        FileError: The file cannot be written.
    """
    columns = list(trajectory.columns().values())
    with written_whole(path) as file:
        text = io.TextIOWrapper(file, 'utf-8', newline='', write_through=True)
        writer = csv.writer(text, lineterminator='\n')
        writer.writerow(['lane', *COLUMNS, 'reason'])
        for first in range(0, len(trajectory), _CSV_ROWS):
            rows = zip(
                *(each[first : first + _CSV_ROWS].tolist() for each in columns), strict=True
            )
            for number, row in enumerate(rows, first + 1):
                reason = trajectory.reason if number == len(trajectory) else ''
                writer.writerow([trajectory.lane, *row, reason])
        text.detach()


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
    if len(rows) == 1:
        raise TrajectoryError(f'{path}: expected at least one observation, got none')
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


def _headings(x: Floats, y: Floats, z: Floats, w: Floats) -> Floats:
    """Return the angle of the x axis of each body in the ground plane [rad], (n,)."""
    headings: Floats = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return headings


def _parse(path: Path, name: str, texts: tuple[str, ...]) -> NDArray[np.generic]:
    kind = _KINDS[name]
    convert: type = {np.int64: int, np.float64: float, np.str_: str}[kind]
    values = []
    for line, text in enumerate(texts, 2):
        try:
            value = convert(text)
            if not _is_allowed(name, value):
                raise ValueError
        except ValueError:
            expected = 'a whole number of 64 bits' if kind is np.int64 else 'a number'
            raise TrajectoryError(
                f'{path}:{line}: {name}: expected {expected}, got {text!r:.80}'
            ) from None
        values.append(value)
    return np.array(values, kind)


def _is_allowed(name: str, value: Any) -> bool:
    if isinstance(value, int):
        return -_INT64 <= value < _INT64
    # Where there was no command, there is NaN.
    return isinstance(value, str) or math.isfinite(value) or name in _COMMANDS
