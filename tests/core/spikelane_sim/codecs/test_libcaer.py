import pytest

from spikelane_sim.codecs import decode, decode_packet, Decoder
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
    ('words', 'dropped'),
    [
        ('01000000 00000080', (0, 0, 1)),
        ('01000005 00000000', (0, 1, 0)),
        ('81070000 00000000', (0, 1, 0)),
        ('01000000 00000070', (0, 0, 1)),
    ],
)
def test_a_bad_libcaer_word_costs_one_event(words: str, dropped: tuple[int, int, int]) -> None:
    """Negative time, column 640, row 480, a time half an hour after that of the next event."""
    whole = ['0f000a00 07000000', '0d000a00 08000000', '0d000a00 08000000']
    for place in range(2):
        data = bytes.fromhex(''.join(whole[:place] + [words] + whole[place:]))
        decoded = decode_packet('libcaer', data, 0, BASE, 640, 480)
        assert rows(decoded.events) == [(7_000, 5, 3, 1), (8_000, 5, 3, -1), (8_000, 5, 3, -1)]
        assert decoded.dropped == dropped


def test_half_a_libcaer_word_is_an_error() -> None:
    """A byte too few."""
    with pytest.raises(PacketError, match='words of 8 bytes, got 7'):
        read('libcaer', '01000000 000000')


def test_libcaer_cmp_rows_make_the_events() -> None:
    """TIME_HIGH 1, TIME_LOW 2, column 5, rows 3 (ON) and 4 (OFF); before, time is the base."""
    events = read('libcaer_cmp', '0520 0038 0100 0210 0338 0430')
    assert events == [(0, 5, 0, 1), (4_098_000, 5, 3, 1), (4_098_000, 5, 4, -1)]


def test_libcaer_cmp_vectors_run_down_a_column() -> None:
    """Base row 8 ON, bits 0 and 7, then bit 0 of the next eight."""
    events = read('libcaer_cmp', '0520 0848 8150 0150')
    assert events == [(0, 5, 8, 1), (0, 5, 15, 1), (0, 5, 16, 1)]


@pytest.mark.parametrize(
    ('words', 'dropped', 'places'),
    [
        ('0520 0060 ffff 0338', (2, 0, 0), [(5, 3)]),
        ('0338 0520 0338', (0, 1, 0), [(5, 3)]),
        ('0520 0150 0338', (0, 1, 0), [(5, 3)]),
        ('8022 0030 0520 0338', (0, 1, 0), [(5, 3)]),
        ('0520 e031 0338', (0, 1, 0), [(5, 3)]),
        ('0520 dc49 ff50 0338', (0, 4, 0), [(5, 476), (5, 477), (5, 478), (5, 479), (5, 3)]),
        ('0520 0338 ff07 0338 0000 0338', (0, 0, 1), [(5, 3), (5, 3)]),
    ],
)
def test_a_bad_libcaer_cmp_word_costs_itself(
    words: str, dropped: tuple[int, int, int], places: list[tuple[int, int]]
) -> None:
    """Reserved words; no column; no base; outside; a vector past the edge; 8 s too late."""
    decoded = decode_packet('libcaer_cmp', bytes.fromhex(words), 0, BASE, 640, 480)
    assert [(x, y) for _, x, y, _ in rows(decoded.events)] == places
    assert decoded.dropped == dropped


def test_half_a_libcaer_cmp_word_is_an_error() -> None:
    """A byte too few."""
    with pytest.raises(PacketError, match='words of 2 bytes, got 1'):
        read('libcaer_cmp', '05')


def test_libcaer_cmp_tells_the_time_without_events() -> None:
    """TIME_HIGH 1, TIME_LOW 2."""
    data = bytes.fromhex('0100 0210')
    decoded = Decoder().decode_packet('libcaer_cmp', data, 0, BASE, 640, 480)
    assert decoded.time_ns == BASE + 4_098_000


def test_a_decoder_holds_a_time_that_falls_a_little() -> None:
    """libcaer_driver leaves a TIME_HIGH out where two of the camera's packets meet."""
    data = bytes.fromhex('0520 0510 0030 0410 0030')
    events = Decoder().decode('libcaer_cmp', data, 0, BASE, 640, 480)
    assert rows(events) == [(5_000, 5, 0, -1), (5_000, 5, 0, -1)]
