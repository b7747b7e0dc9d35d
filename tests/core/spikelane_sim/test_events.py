"""The event type."""

import pytest

from spikelane_sim.events import EVENT_DTYPE, make_events, no_events


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
    """The array has one axis."""
    assert (no_events().shape, no_events().dtype) == ((0,), EVENT_DTYPE)
