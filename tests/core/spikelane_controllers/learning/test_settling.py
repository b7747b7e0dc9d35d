"""When trainings last lost the lane, and which have settled."""

from __future__ import annotations

import pytest

from spikelane_controllers.learning.settling import has_settled, last_lane_loss_step
from spikelane_controllers.learning.training import Termination


def ends(*given: tuple[int, str, str]) -> list[Termination]:
    """Return episodes that ended at a step on a lane for a reason."""
    return [
        Termination(step, number, lane, 'A', 1.0, 0.0, 10, reason)
        for number, (step, lane, reason) in enumerate(given, 1)
    ]


@pytest.mark.parametrize(
    ('given', 'last', 'settled'),
    [
        ([(10, 'outer', 'lane_lost'), (20, 'inner', 'laps_complete')], 10, False),
        (
            [
                (10, 'outer', 'lane_lost'),
                (20, 'inner', 'laps_complete'),
                (30, 'outer', 'laps_complete'),
            ],
            10,
            True,
        ),
        (
            [
                (10, 'outer', 'laps_complete'),
                (20, 'inner', 'laps_complete'),
                (30, 'outer', 'lane_lost'),
            ],
            30,
            False,
        ),
        ([(10, 'outer', 'laps_complete')], 0, False),
        ([(10, 'outer', 'step_limit'), (20, 'outer', 'step_limit')], 0, True),
        ([], 0, False),
    ],
)
def test_a_training_has_settled_when_every_lane_was_driven_after_the_last_loss(
    given: list[tuple[int, str, str]], last: int, settled: bool
) -> None:
    """Else its last lane loss is only the last one so far."""
    assert (last_lane_loss_step(ends(*given)), has_settled(ends(*given))) == (last, settled)
