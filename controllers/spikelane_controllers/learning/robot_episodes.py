"""Episodes of a real robot: somebody tells its distance from the lane, and a person puts it back.

A simulator places the robot and knows where it is. Here an episode begins when a person says so,
and ends where the lane is lost or when the person says that the next one begins. Between the end
of an episode and the next beginning nobody drives, and nothing is learnt.
"""

from __future__ import annotations

import math

from spikelane_sim.contract import LaneState, TERMINATED_LANE_LOST, TERMINATED_PUT_BACK
from spikelane_sim.errors import SpikelaneError


class EpisodeError(SpikelaneError):
    """An episode cannot begin."""


class RobotEpisodes:
    """Makes lane states with an episode and a step of what is known of the lane.

    Attributes:
        is_running: Whether an episode runs.
    """

    def __init__(self, max_distance_m: float, first_episode: int = 1) -> None:
        """Wait for the first episode.

        Args:
            max_distance_m: Distance from the lane's centre beyond which the lane is lost.
            first_episode: Number of the first episode.
        """
        self._max_distance_m = max_distance_m
        self._next_episode = first_episode
        self._step = 0
        self._known: LaneState | None = None
        self._last: LaneState | None = None  # of the episode that runs
        self.is_running = False

    def hear_distance(self, lane: str, distance_m: float) -> None:
        """Take in the distance alone.

        Args:
            lane: Name of the lane.
            distance_m: Distance from its centre, right of it positive.

        Raises:
            EpisodeError: It is not finite.
        """
        if not math.isfinite(distance_m):
            raise EpisodeError(f'lane distance: expected a finite number, got {distance_m} m')
        self.hear(LaneState(lane, distance_m, 0.0, 0.0, '', 0.0, 0, 0, 0, False, ''))

    def hear(self, lane: LaneState) -> None:
        """Take in where the robot is; episode, step and termination are not looked at."""
        self._known = lane

    def begin(self) -> tuple[int, LaneState | None]:
        """Begin an episode; one that runs ends.

        Returns:
            The number of the episode that begins, and how the one that ran has ended; None where
            none ran, or where it had no step.

        Raises:
            EpisodeError: It is not known where the robot is, or it is too far from the lane.
        """
        if self._known is None:
            raise EpisodeError('lane distance: expected one to begin an episode, got none yet')
        distance_m = self._known.distance_m
        if abs(distance_m) > self._max_distance_m:
            raise EpisodeError(
                f"robot: expected at most {self._max_distance_m:g} m from the lane's centre, "
                f'got {distance_m:.3f} m'
            )
        ended = None
        if self.is_running and self._last is not None:
            ended = self._last._replace(terminated=True, reason=TERMINATED_PUT_BACK)
        episode, self._next_episode = self._next_episode, self._next_episode + 1
        self._step, self._last = 0, None
        self._episode, self.is_running = episode, True
        return episode, ended

    def next(self) -> LaneState | None:
        """Return the lane state of the step that has just been seen; None between episodes."""
        if not self.is_running or self._known is None:
            return None
        is_lost = abs(self._known.distance_m) > self._max_distance_m
        state = self._known._replace(
            episode=self._episode,
            step=self._step,
            terminated=is_lost,
            reason=TERMINATED_LANE_LOST if is_lost else '',
        )
        self._step += 1
        self._last = state
        self.is_running = not is_lost
        return state
