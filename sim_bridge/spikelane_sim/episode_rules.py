"""The rules of an episode, as functions of numbers: what a command does, how far a robot has come.

The single simulator calls them as they are, and the fleet's kernel compiles those that a step
needs: both follow the same rules, bit for bit.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba.extending import register_jitable

from spikelane_sim.contract import (
    TERMINATED_LANE_LOST,
    TERMINATED_LAPS_COMPLETE,
    TERMINATED_NO_PROGRESS,
    TERMINATED_STEP_LIMIT,
)
from spikelane_sim.errors import SpikelaneError

#: Reasons to end an episode, by their numbers; 0 is none.
REASONS = (
    '',
    TERMINATED_LANE_LOST,
    TERMINATED_LAPS_COMPLETE,
    TERMINATED_STEP_LIMIT,
    TERMINATED_NO_PROGRESS,
)

#: What became of a wheel command: taken as it came, not finite, or clipped to the robot's limit.
TAKEN, NOT_FINITE, CLIPPED = range(3)


_LAST_EPISODE = 2**32 - 1  # as a message can name it


def check_beginning(seed: int | None, episode: int) -> None:
    """Check the seed and the number of an episode that is to begin.

    Raises:
        SpikelaneError: A negative seed, or no such number of an episode.
    """
    if seed is not None and seed < 0:
        raise SpikelaneError(f'seed: expected a whole number of at least 0, got {seed}')
    if not 1 <= episode <= _LAST_EPISODE:
        raise SpikelaneError(
            f'episode: expected a number from 1 to {_LAST_EPISODE}, got {episode}'
        )


class Progress(NamedTuple):
    """How far a robot has come in its episode."""

    position_m: float  # along the lane's centre
    progress_m: float  # over laps
    laps: int
    step: int
    furthest_m: float  # the last progress that counted as such
    furthest_step: int  # when it was reached
    reason: int  # of REASONS


@register_jitable
def start_at(position_m: float) -> Progress:
    """Return the progress at an episode's start, at a position along the lane."""
    return Progress(position_m, 0.0, 0, 0, 0.0, 0, 0)


@register_jitable
def admit(left: float, right: float, limit: float) -> tuple[float, float, int]:
    """Return the wheel velocities that a command is taken for, and what became of it.

    Args:
        left: Velocity asked of the left wheel [rad/s].
        right: The same for the right wheel.
        limit: The robot's limit [rad/s].
    """
    if not (math.isfinite(left) and math.isfinite(right)):
        return 0.0, 0.0, NOT_FINITE
    if max(abs(left), abs(right)) > limit:
        return min(max(left, -limit), limit), min(max(right, -limit), limit), CLIPPED
    return left, right, TAKEN


@register_jitable
def advance(length_m: float, last_m: float, position_m: float, progress_m: float) -> float:
    """Return the progress along a lane after the position changed.

    Progress counts over laps and down when driving backwards. A change of position is taken the
    short way round, so between two calls a robot must move by less than half a lap.

    Args:
        length_m: Length of the lane.
        last_m: Position along the lane that progress_m belongs to.
        position_m: Position now.
        progress_m: Progress so far.
    """
    moved = position_m - last_m
    if moved >= length_m / 2:
        moved -= length_m
    elif moved < -length_m / 2:
        moved += length_m
    return progress_m + moved


@register_jitable
def follow(
    length_m: float, limits: Any, last: Progress, position_m: float, distance_m: float
) -> Progress:
    """Return the progress after a step, from that before it.

    Args:
        length_m: Length of the lane.
        limits: The fields of `EpisodeParameters`.
        last: Progress before the step.
        position_m: Position along the lane now.
        distance_m: Distance from the lane's centre now, of either sign.
    """
    progress_m = advance(length_m, last.position_m, position_m, last.progress_m)
    laps = max(last.laps, math.floor(progress_m / length_m))
    step = last.step + 1
    furthest_m, furthest_step = last.furthest_m, last.furthest_step
    if progress_m >= furthest_m + limits.min_progress_m:
        furthest_m, furthest_step = progress_m, step
    reason = _reason_to_end(limits, abs(distance_m), laps, step, step - furthest_step)
    return Progress(position_m, progress_m, laps, step, furthest_m, furthest_step, reason)


@register_jitable
def _reason_to_end(limits: Any, distance_m: float, laps: int, step: int, idle_steps: int) -> int:
    """Return why an episode ends now, as a number of REASONS.

    Args:
        limits: The fields of `EpisodeParameters`.
        distance_m: Distance from the lane's centre, not negative.
        laps: Completed.
        step: Number of the step in the episode.
        idle_steps: Steps since the robot last made progress.
    """
    if limits.max_distance_m > 0.0 and distance_m > limits.max_distance_m:
        return 1
    if limits.max_laps > 0 and laps >= limits.max_laps:
        return 2
    if limits.max_steps > 0 and step >= limits.max_steps:
        return 3
    if limits.no_progress_steps > 0 and idle_steps >= limits.no_progress_steps:
        return 4
    return 0


@register_jitable
def heading_of(qx: float, qy: float, qz: float, qw: float) -> float:
    """Return the heading [rad] of an orientation, a quaternion."""
    return math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
