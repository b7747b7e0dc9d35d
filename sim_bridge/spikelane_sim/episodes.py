"""When an episode begins, as observations tell it."""

from __future__ import annotations

from typing import NamedTuple

from spikelane_sim.contract import LaneState


class _Place(NamedTuple):
    """Where an observation stands in its episode."""

    episode: int
    step: int


class EpisodeWatch:
    """Says where observations begin another episode.

    They do where the episode's number changes or its steps begin again. A later step that is seen
    twice, as after a reset of time alone, is within the episode.
    """

    def __init__(self) -> None:
        self._last: _Place | None = None

    def begins(self, lane: LaneState) -> bool:
        """Return whether an episode begins with this lane state, the next one."""
        last, self._last = self._last, _Place(lane.episode, lane.step)
        if last is None or lane.episode != last.episode:
            return True
        return lane.step == 0 or lane.step < last.step
