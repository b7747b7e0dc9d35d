"""The messages of one episode, put together by their stamps, in arrays.

The messages of a step carry one stamp. Where simulation time was reset and a stamp comes again,
the message recorded next to the lane state is meant.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from spikelane.runs.lap.column_store import ColumnStore
from spikelane.runs.lap.trajectory import (
    LANE_KINDS,
    lane_values,
    Trajectory,
    trajectory_from_columns,
    TrajectoryError,
)
from spikelane_sim.contract import LaneState

#: Values of a message: position x, y [m] and orientation x, y, z, w; wheel velocities [rad/s],
#: left and right; number of events.
WIDTHS = {'pose': 6, 'wheels': 2, 'events': 1}

_NEVER = np.iinfo(np.int64).max


class LaneStates:
    """The lane states of one episode, a row each; one that was sent again counts once."""

    def __init__(self) -> None:
        """Begin without any."""
        self._store = ColumnStore({'stamp_ns': np.int64, 'log_ns': np.int64, **LANE_KINDS})
        self._last: tuple[int, int, LaneState] | None = None

    def __len__(self) -> int:
        """Return the number of lane states."""
        return len(self._store) + (self._last is not None)

    def add(self, stamp_ns: int, log_ns: int, state: LaneState) -> None:
        """Add a lane state, or the last one once more.

        Args:
            stamp_ns: Simulation time [ns].
            log_ns: When it was recorded [ns].
            state: Lane state of the same episode as those before.
        """
        if self._last is not None and not self._is_last(stamp_ns, state):
            self._keep(*self._last)
        self._last = stamp_ns, log_ns, state

    def begins_another(self, stamp_ns: int, state: LaneState) -> bool:
        """Return whether a lane state begins another episode than this one."""
        if self._last is None or self._is_last(stamp_ns, state):
            return False
        return state.episode != self.last.episode or state.step <= self.last.step

    @property
    def last(self) -> LaneState:
        """The last lane state; there must be one."""
        assert self._last is not None
        return self._last[2]

    def pack(self) -> None:
        """Take as little memory as possible: no more are to come for now."""
        self._store.pack()

    def columns(self) -> dict[str, NDArray[np.generic]]:
        """Return the columns, (n,) each: `stamp_ns`, `log_ns` and those of `LANE_KINDS`."""
        if self._last is not None:
            self._keep(*self._last)
        return self._store.columns()

    def _is_last(self, stamp_ns: int, state: LaneState) -> bool:
        assert self._last is not None
        before = self._last[2]
        return (stamp_ns, state.episode, state.step) == (
            self._last[0],
            before.episode,
            before.step,
        )

    def _keep(self, stamp_ns: int, log_ns: int, state: LaneState) -> None:
        self._store.append((stamp_ns, log_ns, *lane_values(state)))


class StepMessages:
    """Gathers what else was said in each step of an episode."""

    def __init__(self, lane_states: LaneStates) -> None:
        """Begin with the lane states of the episode; no more are added to them."""
        self._lane, self._reason = lane_states.last.lane, lane_states.last.reason
        self._columns = lane_states.columns()
        stamps = self._columns['stamp_ns'].astype(np.int64)
        self._stamps, self._rows = np.unique(stamps, return_inverse=True)
        self._logged = np.empty(len(self._stamps), np.int64)
        self._logged[self._rows] = self._columns.pop('log_ns')
        count = len(self._stamps)
        self._values = {kind: np.full((count, width), np.nan) for kind, width in WIDTHS.items()}
        self._gaps = {kind: np.full(count, _NEVER) for kind in WIDTHS}

    def add(
        self, kind: str, stamp_ns: int, log_ns: int, values: Callable[[], tuple[float, ...]]
    ) -> None:
        """Add a message, unless it is of another episode or another is recorded nearer.

        Args:
            kind: A key of `WIDTHS`.
            stamp_ns: Simulation time [ns].
            log_ns: When it was recorded [ns].
            values: Returns its values; called only where they are needed.
        """
        index = int(np.searchsorted(self._stamps, stamp_ns))
        if index == len(self._stamps) or self._stamps[index] != stamp_ns:
            return
        gap = abs(log_ns - int(self._logged[index]))
        if gap < self._gaps[kind][index]:
            self._gaps[kind][index] = gap
            self._values[kind][index] = values()

    def trajectory(self) -> Trajectory:
        """Put all together.

        A recording that began or ended in the middle of a step loses the incomplete observations
        at its ends; those without a command are kept.

        Raises:
            TrajectoryError: No observation is complete, or one between complete ones is not.
        """
        has = {kind: (gaps < _NEVER)[self._rows] for kind, gaps in self._gaps.items()}
        complete = np.flatnonzero(has['pose'] & has['events'])
        if not len(complete):
            raise TrajectoryError(
                f'trajectory: expected poses and events at the stamps of {len(self._rows)} lane '
                'states, got none'
            )
        first, last = int(complete[0]), int(complete[-1])
        if len(complete) < last - first + 1:
            self._refuse_gap(first, has)
        kept = slice(first, last + 1)
        rows = self._rows[kept]
        pose, wheels = self._values['pose'][rows], self._values['wheels'][rows]
        columns = {name: column[kept] for name, column in self._columns.items()}
        names = ('x_m', 'y_m', 'orientation_x', 'orientation_y', 'orientation_z', 'orientation_w')
        columns |= dict(zip(names, pose.T, strict=True))
        columns |= dict(zip(('left_rad_s', 'right_rad_s'), wheels.T, strict=True))
        columns['events'] = self._values['events'][rows, 0].astype(np.int64)
        reason = self._reason if last + 1 == len(self._rows) else ''
        return trajectory_from_columns(self._lane, reason, columns)

    def _refuse_gap(self, first: int, has: dict[str, NDArray[np.bool_]]) -> None:
        gaps = np.flatnonzero(~(has['pose'] & has['events'])[first:])
        at = first + int(gaps[0])
        what = 'pose' if not has['pose'][at] else 'events'
        step, stamp_ns = self._columns['step'][at], self._columns['stamp_ns'][at]
        raise TrajectoryError(f'trajectory: the {what} of step {step} ({stamp_ns} ns) is lost')
