"""How well a lap was driven, in numbers.

A step counts once, by where it took the robot: the observation at the reset (step 0) shows where
the robot was put and is left out of every mean; all later ones count, the last one included.
Only `events` is over all observations, as the camera saw them.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spikelane.runs.lap.trajectory import Trajectory, TrajectoryError
from spikelane_sim.contract import TERMINATED_LANE_LOST, TERMINATED_NO_PROGRESS

#: Reasons of an episode's end for which no lap counts as completed.
_FAILURES = (TERMINATED_LANE_LOST, TERMINATED_NO_PROGRESS)


def lap_metrics(trajectory: Trajectory, step_s: float) -> dict[str, Any]:
    """Measure an episode.

    Args:
        trajectory: Trajectory of the whole episode.
        step_s: Simulated time of a step [s].

    Returns:
        completed: Whether a lap was, and the drive neither lost the lane nor stopped making
            progress after it.
        reason: Why the episode ended, '' where it had not.
        laps: Completed laps.
        steps: Steps driven.
        lap_time_s: From the reset to the end of the first lap [s], None where there is none.
        mean_abs_distance_m: Mean |d|, the paper's mean error e [m].
        max_abs_distance_m: Largest |d| [m].
        mean_distance_m: Mean d, positive where the robot kept to the right [m].
        std_distance_m: Standard deviation of d about its mean (divided by n) [m].
        mean_speed_m_s: Progress along the lane by time [m/s].
        events: Number of events.
        sections: By name, in the order driven: steps that ended in the section,
            mean_abs_distance_m, mean_distance_m and max_abs_distance_m there.

    Raises:
        TrajectoryError: Not one step was driven.
    """
    steps = len(trajectory) - 1
    if not steps:
        raise TrajectoryError('trajectory: expected at least one step, got only the reset')
    distances = trajectory.distance_m[1:]
    mean = _mean(distances)
    progress_m = float(trajectory.progress_m[-1] - trajectory.progress_m[0])
    return {
        'completed': bool(trajectory.laps[-1] > 0) and trajectory.reason not in _FAILURES,
        'reason': trajectory.reason,
        'laps': int(trajectory.laps[-1]),
        'steps': steps,
        'lap_time_s': _first_lap_s(trajectory, step_s),
        **_distances(distances),
        'std_distance_m': math.sqrt(_mean((distances - mean) ** 2)),
        'mean_speed_m_s': progress_m / (steps * step_s),
        'events': int(trajectory.events.sum()),
        'sections': _by_section(trajectory.section[1:], distances),
    }


def _first_lap_s(trajectory: Trajectory, step_s: float) -> float | None:
    finished = np.flatnonzero(trajectory.laps > 0)
    if not len(finished):
        return None
    return float((trajectory.step[finished[0]] - trajectory.step[0]) * step_s)


def _by_section(
    sections: NDArray[np.str_], distances: NDArray[np.float64]
) -> dict[str, dict[str, float]]:
    names: Sequence[str] = list(dict.fromkeys(sections.tolist()))
    return {
        name: {
            'steps': int(np.count_nonzero(sections == name)),
            **_distances(distances[sections == name]),
        }
        for name in names
    }


def _distances(distances: NDArray[np.float64]) -> dict[str, float]:
    return {
        'mean_abs_distance_m': _mean(np.abs(distances)),
        'max_abs_distance_m': float(np.abs(distances).max()),
        'mean_distance_m': _mean(distances),
    }


def _mean(values: NDArray[np.float64]) -> float:
    """Return the mean of an exact sum: the same on every machine, whatever its vector width."""
    return math.fsum(values.tolist()) / len(values)
