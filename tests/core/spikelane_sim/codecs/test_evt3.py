import numpy as np
import pytest

from spikelane_sim.codecs import decode, decode_packet, DecodedPacket, Decoder, encode
from spikelane_sim.errors import PacketError
from spikelane_sim.events import Events, make_events, no_events

SECOND = 1_000_000_000
# TIME_HIGH 1, TIME_LOW 2, ADDR_Y 3: 0x1002 = 4098 us, row 3.
START = '0180 0260 0300'


def rows(events: Events) -> list[tuple[int, ...]]:
    """Return events as tuples of t [ns], x, y, polarity."""
    return [tuple(int(value) for value in event) for event in events]


def read(words: str, stamp_ns: int = 0, width: int = 640, height: int = 480) -> Events:
    """Decode by itself."""
    return decode('evt3', bytes.fromhex(words), stamp_ns, 0, width, height)


def taken(words: str, width: int = 640, height: int = 480) -> DecodedPacket:
    """Decode by itself, with what is left out."""
    return decode_packet('evt3', bytes.fromhex(words), 0, 0, width, height)


def test_a_brighter_and_a_darker_event_are_written_as_these_words() -> None:
    """T = 0x123456 us: TIME_HIGH 0x123, TIME_LOW 0x456, row 2, columns 5 (ON) and 6 (OFF).

    The packet begins 50 ms before, at 0x117106 us, and has every TIME_HIGH from there on.
    """
    events = make_events(0x123456 * 1000, [5, 6], 2, [1, -1])
    packet = encode('evt3', events, 0x123456 * 1000, 128, 128)
    begin = '1781 0661 1881 1981 1a81 1b81 1c81 1d81 1e81 1f81 2081 2181 2281'
    assert packet.data == bytes.fromhex(begin + '2381 5664 0200 0528 0620')
    assert packet[:3] == ('evt3', 128, 128)


def test_words_are_repeated_only_when_they_change() -> None:
    """Same time and row: one word; new LOW: LOW alone; new HIGH: HIGH and LOW; new row: ADDR_Y.

    From 0 to 50 ms = 0xC350 us.
    """
    events = make_events(
        np.array([0x1001, 0x1001, 0x1002, 0x3002, 0x3002]) * 1000, 7, [0, 0, 0, 0, 127], 1
    )
    packet = encode('evt3', events, 50_000_000, 128, 128)
    expected = '0080 0060 0180 0160 0000 0728 0728 0260 0728 0280 0380 0260 0728 7f00 0728'
    end = '0480 0580 0680 0780 0880 0980 0a80 0b80 0c80 5063'
    assert packet.data == bytes.fromhex(expected + end)


def test_an_empty_packet_tells_the_time_from_its_begin_to_its_stamp() -> None:
    """1.85 s = 0x1C3A90 us, 1.9 s = 0x1CFDE0 us."""
    packet = encode('evt3', no_events(), 1_900_000_000, 128, 128)
    highs = 'c481 c581 c681 c781 c881 c981 ca81 cb81 cc81 cd81 ce81 cf81'
    assert packet.data == bytes.fromhex('c381 906a' + highs + 'e06d')
    decoded = Decoder().decode_packet('evt3', packet.data, 1_900_000_000, 0, 128, 128)
    assert (len(decoded.events), decoded.time_ns) == (0, 1_900_000_000)


def test_a_packet_that_ends_with_its_time_high_has_the_time_of_an_event_once() -> None:
    """An event 1 us before the stamp, where no further TIME_HIGH begins: no words after it."""
    events = make_events([49_999_000], 1, 0, 1)
    data = encode('evt3', events, 50_000_000, 128, 128).data
    assert data.endswith(bytes.fromhex('0c80 4f63 0000 0128'))


def test_the_order_of_events_is_kept() -> None:
    """Equal times, rows going down and columns in disorder come out as they went in."""
    events = make_events(50_000_000, [9, 3, 3, 100], [7, 2, 7, 0], [1, -1, 1, -1])
    packet = encode('evt3', events, 50_000_000, 128, 128)
    assert np.array_equal(decode('evt3', packet.data, 50_000_000, 0, 128, 128), events)


def test_row_0_stays_row_0() -> None:
    """The encodings count rows from the top, as the events do: nothing is flipped."""
    events = make_events(50_000_000, 0, [0, 127], 1)
    data = encode('evt3', events, 50_000_000, 128, 128).data
    assert data.endswith(bytes.fromhex('0000 0028 7f00 0028'))


def test_addr_x_makes_an_event_of_either_polarity() -> None:
    """Bit 11 set is brighter."""
    assert rows(read(START + '0a28 0b20')) == [(4_098_000, 10, 3, 1), (4_098_000, 11, 3, -1)]


def test_bit_11_of_addr_y_is_no_part_of_the_row() -> None:
    """It tells a pair's slave camera."""
    assert rows(read(START + '0408 0a28')) == [(4_098_000, 10, 4, 1)]


def test_vector_words_make_an_event_per_bit_and_move_on() -> None:
    """Base 100 ON; VECT_12 bits 0 and 11; VECT_8 bits 0 and 7, from 112 on; then base 0 OFF."""
    events = read(START + '6438 0148 8150 0030 0250')
    assert rows(events) == [
        (4_098_000, 100, 3, 1),
        (4_098_000, 111, 3, 1),
        (4_098_000, 112, 3, 1),
        (4_098_000, 119, 3, 1),
        (4_098_000, 1, 3, -1),
    ]


def test_addr_x_does_not_move_the_vector_base() -> None:
    """A single event between vector words leaves their column and polarity."""
    events = read(START + '0a38 0540' + '3220' + '0150')
    assert [(x, p) for _, x, _, p in rows(events)] == [(10, 1), (12, 1), (50, -1), (22, 1)]


def test_only_the_set_bits_of_a_mask_have_to_be_inside() -> None:
    """Base 636 of 640 columns: bits 0 and 3 are inside, bits 4 and 11 are not."""
    assert [x for _, x, _, _ in rows(read(START + '7c3a 0940'))] == [636, 639]
    decoded = taken(START + '7c3a 1948' + '0a28')
    assert [x for _, x, _, _ in rows(decoded.events)] == [636, 639, 10]
    assert decoded.dropped == (0, 2, 0)


def test_triggers_and_other_words_are_skipped() -> None:
    """EXT_TRIGGER, OTHERS, CONTINUED_4 and CONTINUED_12 make no events."""
    assert rows(read(START + '01a1 19e0 ff7f ffff 0a28')) == [(4_098_000, 10, 3, 1)]


@pytest.mark.parametrize('code', [0x1, 0x9, 0xB, 0xC, 0xD])
def test_a_reserved_word_is_skipped_and_counted(code: int) -> None:
    """Whatever its value; the words around it count as if it were not there."""
    decoded = taken(f'{START} ff{code:x}f 0a28 00{code:x}0 ff{code:x}f 0b28')
    assert rows(decoded.events) == [(4_098_000, 10, 3, 1), (4_098_000, 11, 3, 1)]
    assert decoded.dropped == (3, 0, 0)


@pytest.mark.parametrize('before', ['', '0180', '0260', '0260 0180', '0180 0300'])
def test_events_before_both_time_words_are_skipped(before: str) -> None:
    """Either time word alone, or LOW before HIGH, is no time yet."""
    assert rows(read(before + '0300 0b28' + START + '0a28')) == [(4_098_000, 10, 3, 1)]


def test_events_before_a_row_or_a_base_are_skipped() -> None:
    """ADDR_X without ADDR_Y, a vector word without VECT_BASE_X."""
    assert rows(read('0180 0260 0b28 0300 ff5f ff4f 0a28')) == [(4_098_000, 10, 3, 1)]


@pytest.mark.parametrize('size', [(10, 480), (640, 3)])
def test_an_event_outside_the_sensor_is_left_out_alone(size: tuple[int, int]) -> None:
    """Column 10 of 10, row 3 of 3; an event in column 9 and row 2 is kept."""
    decoded = taken(START + '0a28 0200 0928', *size)
    assert rows(decoded.events) == [(4_098_000, 9, 2, 1)]
    assert decoded.dropped == (0, 1, 0)


def test_a_time_that_falls_a_little_is_the_one_before() -> None:
    """By one microsecond; by 45.055 ms (0x1000D - 0x500E us), the most."""
    assert [t for t, *_ in rows(read(START + '0a28 0160 0a28'))] == [4_098_000, 4_098_000]
    assert [t for t, *_ in rows(read('1080 0d60 0300 0a28 0580 0e60 0a28'))] == [65_549_000] * 2


@pytest.mark.parametrize(
    ('words', 'times'),
    [
        # Events at TIME_HIGH 1, 1, 0x7F1 (too late), 2, 2.
        ('0180 0060 0300 0a28 0a28 f187 0a28 0280 0a28 0a28', [1, 1, 2, 2]),
        # At 0x101, 0x101, 1 (too early), 0x102.
        ('0181 0060 0300 0a28 0a28 0180 0a28 0281 0a28', [0x101, 0x101, 0x102]),
        # At 0x7F1 (too late), 1, 1.
        ('f187 0060 0300 0a28 0180 0a28 0a28', [1, 1]),
    ],
)
def test_events_at_a_wrong_time_are_left_out_alone(words: str, times: list[int]) -> None:
    """Those that are fewer are wrong; the others keep their times."""
    decoded = taken(words)
    assert [t for t, *_ in rows(decoded.events)] == [high * 4_096_000 for high in times]
    assert decoded.dropped == (0, 0, 1)


@pytest.mark.parametrize(
    ('stamp_ns', 't_ns'),
    [
        (0, 4_098_000),
        (50_000_000, 4_098_000),
        (8_392_000_000, 4_098_000),
        (8_393_000_000, 4_098_000 + 16_777_216_000),
        (16_777_216_000, 4_098_000 + 16_777_216_000),
        (2_000_000_000 * SECOND, 2_000_000_007_540_738_000),
    ],
)
def test_time_is_the_nearest_to_the_stamp(stamp_ns: int, t_ns: int) -> None:
    """A round is 16.777216 s; 2e9 s is 9.240576 s into one."""
    assert rows(read(START + '0a28', stamp_ns))[0][0] == t_ns


def test_time_goes_on_where_it_comes_round_within_a_packet() -> None:
    """0xFFFFFF us is followed by 0, and the stamp is the later one."""
    events = read('ff8f ff6f 0000 0128 0080 0060 0128', 16_777_216_000)
    assert [t for t, *_ in rows(events)] == [16_777_215_000, 16_777_216_000]


def test_a_packet_far_from_its_stamp_stays_in_one_piece() -> None:
    """Where half a round from the stamp lies between two events, they keep their distance."""
    half_us = 2**23
    events = read('ff87 ff6f 0000 0128 0088 0060 0128', 0)
    assert [t for t, *_ in rows(events)] == [(half_us - 1) * 1000, half_us * 1000]


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'t_ns': [50_000_000, 49_999_000]}, 'do not decrease, not so at index 1'),
        ({'t_ns': [50_000_000, 50_000_001]}, 'whole microseconds, not so at index 1'),
        ({'t_ns': [50_000_000, 8_439_000_000]}, 'reaches from the packet.s stamp, .* index 1'),
        ({'t_ns': [8_439_000_000, 8_439_000_000]}, 'reaches .* index 0'),
        ({'x_px': [0, 128]}, 'coordinates inside the sensor, not so at index 1'),
        ({'y_px': [128, 0]}, 'coordinates inside the sensor, not so at index 0'),
        ({'polarity': [1, 0]}, r'polarity of \+1 or -1, not so at index 1'),
    ],
)
def test_events_that_cannot_be_written_are_an_error(
    change: dict[str, list[int]], message: str
) -> None:
    """The error tells which event."""
    columns = {'t_ns': [50_000_000] * 2, 'x_px': [0, 0], 'y_px': [0, 0], 'polarity': [1, 1]}
    with pytest.raises(PacketError, match=message):
        encode('evt3', make_events(**(columns | change)), 50_000_000, 128, 128)


def follow(decoder: Decoder, words: str, stamp_ns: int = 0) -> list[tuple[int, ...]]:
    """Decode as the next packet."""
    return rows(decoder.decode('evt3', bytes.fromhex(words), stamp_ns, 0, 640, 480))


def test_a_decoder_carries_time_row_and_base_from_packet_to_packet() -> None:
    """The second packet begins with an event, then a vector word, then LOW."""
    decoder = Decoder()
    assert follow(decoder, START + '0a38') == []
    assert follow(decoder, '0b28') == [(4_098_000, 11, 3, 1)]
    assert follow(decoder, '0150') == [(4_098_000, 10, 3, 1)]
    assert follow(decoder, '0360 0c20') == [(4_099_000, 12, 3, -1)]


def test_a_decoder_counts_how_often_time_came_round() -> None:
    """Sensor time after TIME_HIGH fell from 0xFFF to 0 twice: two rounds of 16.777216 s."""
    decoder = Decoder()
    for _ in range(2):
        follow(decoder, 'ff8f 0060 0000 0080')
    assert follow(decoder, '0060 0128') == [(2 * 16_777_216_000, 1, 0, 1)]


def test_a_decoder_takes_a_small_fall_of_time_high_for_no_round() -> None:
    """From 0x0FF back by 10 counts; by 11 it is a round."""
    decoder = Decoder()
    follow(decoder, 'ff80 0060 0000')
    assert follow(decoder, 'f580 0060 0128') == [(0xF5000 * 1000, 1, 0, 1)]
    assert follow(decoder, 'ea80 0060 0128') == [(16_777_216_000 + 0xEA000 * 1000, 1, 0, 1)]


@pytest.mark.parametrize(
    ('wrong', 'next_high', 't_us', 'mistimed'),
    [
        ('ff80', '0280', 0x2000, 1),  # TIME_HIGH 0x0FF between 1 and 2: far ahead
        ('f187', '0280', 0x2000, 1),  # 0x7F1: 8 s ahead, as if it had come round afterwards
        ('f08f', '0280', 0x2000, 1),  # 0xFF0: 17 counts back, as if it had come round
        ('ff80', '0081', 0x100000, 0),  # 0x0FF, then 0x100: time has jumped
        ('0280', '0380', 0x3000, 0),
    ],
)
def test_a_damaged_time_high_costs_the_events_up_to_the_next(
    wrong: str, next_high: str, t_us: int, mistimed: int
) -> None:
    """If the next one continues the time before it; the time goes on without a round too many."""
    decoder = Decoder()
    words = f'{START} 0a28 {wrong} 0060 0b28 {next_high} 0060 0c28'
    decoded = decoder.decode_packet('evt3', bytes.fromhex(words), 0, 0, 640, 480)
    assert decoded.dropped == (0, 0, mistimed)
    assert rows(decoded.events)[0] == (4_098_000, 10, 3, 1)
    assert rows(decoded.events)[-1] == (t_us * 1000, 12, 3, 1)
    assert len(decoded.events) == 3 - mistimed
    assert decoded.time_ns == t_us * 1000


def test_a_damaged_time_high_at_a_packets_end_cannot_be_told_from_a_jump() -> None:
    """It is taken as it is, and time seems to have come round with the next packet."""
    decoder = Decoder()
    follow(decoder, START + '0a28 f187')
    assert follow(decoder, '0280 0060 0b28') == [(16_777_216_000 + 0x2000 * 1000, 11, 3, 1)]


def test_a_decoder_holds_a_time_that_falls_a_little_within_a_packet() -> None:
    """Cameras do that; the events are kept, in order."""
    events = follow(Decoder(), START + '0a28 0060 0b28')
    assert events == [(4_098_000, 10, 3, 1), (4_098_000, 11, 3, 1)]


def test_a_decoder_starts_afresh_when_the_stamp_goes_back() -> None:
    """After a reset of simulation time the old time and row are worth nothing."""
    decoder = Decoder()
    follow(decoder, 'ff8f 0060 0500', stamp_ns=10 * SECOND)
    assert follow(decoder, '0b28', stamp_ns=9 * SECOND) == []
    assert follow(decoder, START + '0a28', stamp_ns=9 * SECOND) == [(4_098_000, 10, 3, 1)]


def test_a_decoder_starts_afresh_when_the_sensor_changes() -> None:
    """A row of another sensor is worth nothing either."""
    decoder = Decoder()
    follow(decoder, START)
    assert len(decoder.decode('evt3', bytes.fromhex('0b28'), 0, 0, 320, 240)) == 0


def test_the_time_survives_a_packet_that_cannot_be_decoded() -> None:
    """Half a word: what comes next needs a row, but neither TIME_HIGH nor TIME_LOW."""
    decoder = Decoder()
    follow(decoder, 'ff8f 0060 0000 0080' + START)
    with pytest.raises(PacketError):
        follow(decoder, '0a28 00')
    assert follow(decoder, '0b28 0400 0b28') == [(16_777_216_000 + 4_098_000, 11, 4, 1)]
    with pytest.raises(PacketError):
        decoder.decode('evt3', b'', 0, 0, 0, 480)
    assert follow(decoder, '0400 0c28') == [(16_777_216_000 + 4_098_000, 12, 4, 1)]


def test_a_decoder_waits_for_time_and_row_after_a_loss_but_keeps_the_count() -> None:
    """The packets that are missing may have changed them."""
    decoder = Decoder()
    follow(decoder, 'ff8f 0060 0000 0080')
    decoder.resynchronise()
    assert follow(decoder, '0b28 0060 0b28') == []
    assert follow(decoder, START + '0a28') == [(16_777_216_000 + 4_098_000, 10, 3, 1)]


@pytest.mark.parametrize('back_ns', [1_000, 1_000_000, 500_000_000])
def test_a_stamp_that_goes_back_a_little_changes_nothing(back_ns: int) -> None:
    """By up to half a second, as clock synchronisation does."""
    decoder = Decoder()
    follow(decoder, START, stamp_ns=10 * SECOND)
    assert follow(decoder, '0b28', stamp_ns=10 * SECOND - back_ns) == [(4_098_000, 11, 3, 1)]


@pytest.mark.parametrize(
    ('words', 'time_ns'),
    [
        ('0180 0260', 4_098_000),
        ('0180 0260 0280', 8_192_000),  # its low part is not known yet, but is not less than 0
        ('0180', 4_096_000),
        ('0260', None),
        ('', None),
        (START + '0a28 0560', 4_101_000),
    ],
)
def test_time_words_tell_the_time_without_events(words: str, time_ns: int | None) -> None:
    """How far the sensor's time has come at the end of the packet."""
    decoded = Decoder().decode_packet('evt3', bytes.fromhex(words), 0, 0, 640, 480)
    assert decoded.time_ns == time_ns


def test_the_time_told_counts_how_often_it_came_round() -> None:
    """As the times of events do."""
    decoder = Decoder()
    follow(decoder, 'ff8f 0060')
    decoded = decoder.decode_packet('evt3', bytes.fromhex('0080 0760'), 0, 0, 640, 480)
    assert decoded.time_ns == 16_777_216_000 + 7_000
