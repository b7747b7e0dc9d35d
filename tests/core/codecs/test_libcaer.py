import pytest

from spikelane_sim.codecs import decode, Decoder
from spikelane_sim.errors import PacketError
from spikelane_sim.events import Events

BASE = 1_700_000_000_000_000_000


def rows(events: Events) -> list[tuple[int, ...]]:
    """Return events as tuples of t - BASE [ns], x, y, polarity."""
    return [(int(e['t']) - BASE, int(e['x']), int(e['y']), int(e['polarity'])) for e in events]


def read(encoding: str, words: str) -> list[tuple[int, ...]]:
    """Decode by itself."""
    return rows(decode(encoding, bytes.fromhex(words), 0, BASE, 640, 480))


def test_libcaer_events_hold_polarity_row_column_and_microseconds() -> None:
    """5 << 17 | 3 << 2 | ON << 1 | 1 = 0xA000F at 7 us, then OFF (0xA000D)."""
    events = read('libcaer', '0f000a00 07000000' + '0d000a00 08000000')
    assert events == [(7_000, 5, 3, 1), (8_000, 5, 3, -1)]


def test_libcaer_time_comes_round_after_31_bits() -> None:
    """2**31 - 1 us is followed by 0."""
    events = read('libcaer', '01000000 ffffff7f' + '01000000 00000000')
    assert [t for t, *_ in events] == [2_147_483_647_000, 2_147_483_648_000]


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        ('01000000 00000080', 'zero or more, not so at index 0'),
        ('01000000 05000000 01000000 04000000', 'do not decrease, not so at index 1'),
        ('01000005 00000000', 'inside the sensor'),
        ('81070000 00000000', 'inside the sensor'),
        ('01000000 000000', 'words of 8 bytes, got 7'),
    ],
)
def test_malformed_libcaer_is_an_error(words: str, message: str) -> None:
    """Negative time, time that decreases, column 640, row 480, a byte too few."""
    with pytest.raises(PacketError, match=message):
        read('libcaer', words)


def test_libcaer_cmp_rows_make_the_events() -> None:
    """TIME_HIGH 1, TIME_LOW 2, column 5, rows 3 (ON) and 4 (OFF); before, time is the base."""
    events = read('libcaer_cmp', '0520 0038 0100 0210 0338 0430')
    assert events == [(0, 5, 0, 1), (4_098_000, 5, 3, 1), (4_098_000, 5, 4, -1)]


def test_libcaer_cmp_vectors_run_down_a_column() -> None:
    """Base row 8 ON, bits 0 and 7, then bit 0 of the next eight."""
    events = read('libcaer_cmp', '0520 0848 8150 0150')
    assert events == [(0, 5, 8, 1), (0, 5, 15, 1), (0, 5, 16, 1)]


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        ('0520 0060', 'known word, not so at index 1'),
        ('00f0', 'known word'),
        ('0338', 'row and column before the event, not so at index 0'),
        ('0520 0150', 'row and column before the event, not so at index 1'),
        ('8022 0030', 'inside the sensor, not so at index 1'),
        ('0520 e031', 'inside the sensor, not so at index 1'),
        ('0520 0510 0030 0410 0030', 'do not decrease, not so at index 4'),
        ('05', 'words of 2 bytes, got 1'),
    ],
)
def test_malformed_libcaer_cmp_is_an_error(words: str, message: str) -> None:
    """Unknown words, addresses missing or outside, time that decreases, half a word."""
    with pytest.raises(PacketError, match=message):
        read('libcaer_cmp', words)


def test_a_decoder_holds_a_time_that_falls_a_little() -> None:
    """libcaer_driver leaves a TIME_HIGH out where two of the camera's packets meet."""
    data = bytes.fromhex('0520 0510 0030 0410 0030')
    events = Decoder().decode('libcaer_cmp', data, 0, BASE, 640, 480)
    assert rows(events) == [(5_000, 5, 0, -1), (5_000, 5, 0, -1)]
