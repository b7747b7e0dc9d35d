"""When a training last lost the lane, and whether it has settled."""

from __future__ import annotations

from collections.abc import Sequence

from spikelane_controllers.learning.training import Termination
from spikelane_sim.contract import TERMINATED_LANE_LOST


def last_lane_loss_step(terminations: Sequence[Termination]) -> int:
    """Return the step of the last episode that ended with the lane lost, 0 where none did."""
    lost = [each.step for each in terminations if each.reason == TERMINATED_LANE_LOST]
    return lost[-1] if lost else 0


def has_settled(terminations: Sequence[Termination]) -> bool:
    """Return whether every lane was lapped, or driven to the step limit, after the last loss.

    With a single lane two such episodes are needed: lanes take turns, and after one episode it
    is not known whether there is another lane. Where a training has not settled, its last lane
    loss is only the last one so far: a censored time.
    """
    last = last_lane_loss_step(terminations)
    full = [
        each.lane
        for each in terminations
        if each.step > last and each.reason != TERMINATED_LANE_LOST
    ]
    return set(full) == {each.lane for each in terminations} and len(full) > 1
