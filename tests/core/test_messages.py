"""From messages to records: what is not valid is refused."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from spikelane_sim.errors import MessageError
from spikelane_sim.messages import lane_state_from_message, to_stamp_ns

NUMBERS = ('distance', 'heading_error', 'position', 'progress')


@pytest.mark.parametrize(
    ('seconds', 'nanoseconds', 'stamp_ns'),
    [(0, 0, 0), (1, 50_000_000, 1_050_000_000), (-1, 999_999_999, -1)],
)
def test_a_stamp_is_seconds_and_nanoseconds(seconds: int, nanoseconds: int, stamp_ns: int) -> None:
    """Added, where the nanoseconds are less than a second."""
    assert to_stamp_ns(SimpleNamespace(sec=seconds, nanosec=nanoseconds)) == stamp_ns


@pytest.mark.parametrize('nanoseconds', [1_000_000_000, 4_294_967_295])
def test_a_stamp_that_is_not_normalised_is_refused(nanoseconds: int) -> None:
    """It would be another name of a later time."""
    message = f'^stamp: expected nanosec below 1000000000, got {nanoseconds}$'
    with pytest.raises(MessageError, match=message):
        to_stamp_ns(SimpleNamespace(sec=0, nanosec=nanoseconds))


@pytest.mark.parametrize('name', NUMBERS)
@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_a_lane_state_that_is_not_finite_is_refused(name: str, value: float) -> None:
    """A learning controller would make a reward of it."""
    facts = {'lane': 'outer', 'section': 'A', 'laps': 0, 'episode': 1, 'step': 3}
    fields = facts | dict.fromkeys(NUMBERS, 0.5) | {'terminated': False, 'reason': ''}
    assert lane_state_from_message(SimpleNamespace(**fields)).distance_m == 0.5
    with pytest.raises(MessageError, match='lane state: expected finite distance'):
        lane_state_from_message(SimpleNamespace(**fields | {name: value}))
