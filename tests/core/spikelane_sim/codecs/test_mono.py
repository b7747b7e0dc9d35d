import numpy as np
import pytest

from spikelane_sim.codecs import decode, decode_packet, encode
from spikelane_sim.errors import PacketError
from spikelane_sim.events import make_events, no_events

# dt 0x01020304 ns, column 0x0506, row 0x0708, brighter; then darker.
ON = bytes.fromhex('04030201 0605 0887')
OFF = bytes.fromhex('04030201 0605 0807')


def test_bytes_are_read_as_time_column_row_and_polarity() -> None:
    """T = time base + 16909060 ns."""
    events = decode('mono', ON + OFF, 0, 1_000_000_000, 2000, 2000)
    expected = make_events(1_016_909_060, 0x0506, 0x0708, [1, -1])
    assert np.array_equal(events, expected)


def test_events_are_written_from_the_start_of_their_step() -> None:
    """Stamp 1.05 s: the time base is 1 s, 50 ms before."""
    events = make_events(1_016_909_060, 0x0506, 0x0708, [1, -1])
    packet = encode('mono', events, 1_050_000_000, 2000, 2000)
    assert packet == ('mono', 2000, 2000, 1_000_000_000, ON + OFF)


def test_an_event_before_the_step_moves_the_time_base() -> None:
    """An event 150 ms before the stamp."""
    packet = encode('mono', make_events([900_000_000], 1, 2, 1), 1_050_000_000, 8, 8)
    assert packet.time_base_ns == 900_000_000
    assert packet.data == bytes.fromhex('00000000 0100 0280')


def test_the_time_base_is_not_below_zero() -> None:
    """A stamp before the end of the first step."""
    assert encode('mono', no_events(), 20_000_000, 8, 8) == ('mono', 8, 8, 0, b'')


@pytest.mark.parametrize(
    ('t_ns', 'x', 'y', 'polarity', 'message'),
    [
        ([-1, 0], 0, 0, 1, 'reaches .* index 0'),
        ([0, 2**32], 0, 0, 1, 'reaches .* index 1'),
        ([5, 4], 0, 0, 1, 'do not decrease, not so at index 1'),
        ([0, 0], [0, 8], 0, 1, 'inside the sensor, not so at index 1'),
        ([0, 0], 0, [8, 0], 1, 'inside the sensor, not so at index 0'),
        ([0, 0], 0, 0, 2, r'polarity of \+1 or -1'),
    ],
)
def test_events_that_cannot_be_written_are_an_error(
    t_ns: list[int], x: list[int] | int, y: list[int] | int, polarity: int, message: str
) -> None:
    """The error tells which event."""
    with pytest.raises(PacketError, match=message):
        encode('mono', make_events(t_ns, x, y, polarity), 50_000_000, 8, 8)


@pytest.mark.parametrize('data', [ON[:7], ON + b'\0'])
def test_half_a_word_is_an_error(data: bytes) -> None:
    """A byte too few or too many."""
    with pytest.raises(PacketError, match=f'words of 8 bytes, got {len(data)} bytes'):
        decode('mono', data, 0, 0, 2000, 2000)


@pytest.mark.parametrize(
    ('bad', 'places', 'dropped'),
    [
        ('04030201 d007 0000', range(4), (0, 1, 0)),
        ('04030201 0000 d007', range(4), (0, 1, 0)),
        ('00000000 0000 0000', range(1, 4), (0, 0, 1)),
        ('ffffffff 0000 0000', range(2), (0, 0, 1)),
    ],
)
def test_a_bad_word_costs_one_event(
    bad: str, places: range, dropped: tuple[int, int, int]
) -> None:
    """Column or row 2000 of 2000; 180 ms before the event before; 4 s after the next one."""
    good = ['0403020b 0605 0887', '0403020b 0605 0807', '0403020b 0605 0807']
    for place in places:
        data = bytes.fromhex(''.join([*good[:place], bad, *good[place:]]))
        decoded = decode_packet('mono', data, 0, 0, 2000, 2000)
        assert decoded.events['polarity'].tolist() == [1, -1, -1]
        assert set(decoded.events['t'].tolist()) == {0x0B020304}
        assert decoded.dropped == dropped
