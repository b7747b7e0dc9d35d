"""The event type and what is relied on about events."""

import numpy as np
import pytest

from spikelane_sim.errors import PacketError
from spikelane_sim.events import check_events, EVENT_DTYPE, make_events, no_events


def test_an_event_takes_thirteen_bytes() -> None:
    """Time, column, row, polarity, little-endian, without padding."""
    events = make_events([0x0102030405060708], 0x0A0B, 0x0C0D, -1)
    assert events.tobytes() == bytes.fromhex('0807060504030201 0b0a 0d0c ff')


def test_columns_become_events() -> None:
    """Scalars are repeated."""
    events = make_events([1000, 2000], [3, 4], 5, [1, -1])
    assert events.tolist() == [(1000, 3, 5, 1), (2000, 4, 5, -1)]


def test_columns_of_other_lengths_are_refused() -> None:
    """Nothing is cut off."""
    with pytest.raises(ValueError, match='shape mismatch'):
        make_events([1, 2, 3], [1, 2], 0, 1)


def test_no_events_are_an_empty_array_of_events() -> None:
    """They pass the check of the smallest sensor."""
    assert (len(no_events()), no_events().dtype) == (0, EVENT_DTYPE)
    check_events(no_events(), 1, 1)


def test_events_up_to_the_last_pixel_pass() -> None:
    """Equal times are in order."""
    check_events(make_events([0, 0, 5], [0, 127, 127], [0, 63, 0], [1, -1, 1]), 128, 64)


@pytest.mark.parametrize(
    ('events', 'message'),
    [
        (make_events([1], [128], [0], 1), r'inside 128 x 64 px, got up to \(128, 0\)'),
        (make_events([1], [0], [64], 1), r'inside 128 x 64 px, got up to \(0, 64\)'),
        (make_events([1], [0], [0], 0), r'polarities of \+1 or -1'),
        (make_events([1], [0], [0], -128), r'polarities of \+1 or -1'),
        (make_events([2, 1], [0, 0], [0, 0], 1), 'times that do not decrease'),
        (make_events(1, 0, 0, 1), r'one-dimensional array .* of shape \(\)'),
        (np.zeros(3), 'one-dimensional array .* got float64'),
    ],
)
def test_other_events_are_refused(events: np.ndarray, message: str) -> None:
    """The message says what is wrong with them."""
    with pytest.raises(PacketError, match=message):
        check_events(events, 128, 64)
