from collections.abc import Callable
from datetime import timedelta

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from spikelane_sim.codecs import DECODABLE, decode, Decoder, encode
from spikelane_sim.errors import PacketError
from spikelane_sim.events import Events, make_events

STEP_NS = 50_000_000
ROUND_NS = 2**24 * 1000
#: Stamps around zero, where the time of evt3 comes round, and in the far future.
STAMPS_US = st.one_of(
    st.integers(0, 10**6),
    st.integers(1, 10).flatmap(lambda n: st.integers(n * 2**24 - 10**5, n * 2**24 + 10**5)),
    st.integers(0, 4 * 10**15),
)
SIZES = st.tuples(st.integers(1, 2048), st.integers(1, 2048))
FIELDS = st.tuples(st.integers(0, 2047), st.integers(0, 2047), st.booleans())


@pytest.fixture(scope='module', autouse=True)
def _compiled() -> None:
    """Compile the kernels before anything is timed."""
    for encoding in DECODABLE:
        decode(encoding, bytes(8), 0, 0, 8, 8)
        Decoder().decode(encoding, bytes(8), 0, 0, 8, 8)
    for encoding in ('evt3', 'mono'):
        encode(encoding, make_events([0], 0, 0, 1), 0, 8, 8)


@st.composite
def packets(draw: st.DrawFn, reach_us: int) -> tuple[Events, int, int, int]:
    """Draw events, their stamp [ns] and the size of the sensor [px]."""
    width, height = draw(SIZES)
    stamp_us = draw(STAMPS_US)
    fields = draw(st.lists(FIELDS, max_size=50))
    ages_us = st.integers(0, min(draw(st.sampled_from([100, 50_000, reach_us])), stamp_us))
    count = len(fields)
    t_us = sorted(
        stamp_us - age for age in draw(st.lists(ages_us, min_size=count, max_size=count))
    )
    x, y, on = np.array(fields, dtype=np.int64).reshape(-1, 3).T
    t_ns = np.array(t_us, dtype=np.int64) * 1000
    events = make_events(t_ns, x % width, y % height, 2 * on - 1)
    return events, stamp_us * 1000, width, height


@settings(max_examples=200, deadline=timedelta(seconds=2))
@given(packets(reach_us=2**23))
def test_evt3_gives_back_what_it_was_given(packet: tuple[Events, int, int, int]) -> None:
    """Up to half a round before the stamp, across rounds, at any stamp, in any order of places."""
    events, stamp_ns, width, height = packet
    coded = encode('evt3', events, stamp_ns, width, height)
    # Row, column and TIME_LOW of each event, and a TIME_HIGH each 4.096 ms.
    begin_ns = min([stamp_ns - STEP_NS, *events['t'].tolist()])
    assert len(coded.data) <= 12 + 6 * len(events) + 2 * (stamp_ns - begin_ns) // 4_096_000
    again = decode('evt3', coded.data, stamp_ns, coded.time_base_ns, width, height)
    assert np.array_equal(again, events)


@settings(max_examples=200, deadline=timedelta(seconds=2))
@given(packets(reach_us=4_200_000))
def test_mono_gives_back_what_it_was_given(packet: tuple[Events, int, int, int]) -> None:
    """Up to 4.2 s before the stamp, and the time base is not after the events."""
    events, stamp_ns, width, height = packet
    coded = encode('mono', events, stamp_ns, width, height)
    assert 0 <= coded.time_base_ns <= min([stamp_ns, *events['t'].tolist()])
    # The stamp of a mono packet does not matter.
    again = decode('mono', coded.data, 0, coded.time_base_ns, width, height)
    assert np.array_equal(again, events)


@settings(max_examples=100, deadline=timedelta(seconds=2))
@given(st.lists(packets(reach_us=50_000), max_size=5))
def test_a_decoder_gives_the_same_events_but_for_whole_rounds(
    stream: list[tuple[Events, int, int, int]],
) -> None:
    """Packet by packet, whatever came before."""
    decoder = Decoder()
    for events, stamp_ns, width, height in stream:
        data = encode('evt3', events, stamp_ns, width, height).data
        again = decoder.decode('evt3', data, stamp_ns, 0, width, height)
        assert not np.any((again['t'] - events['t']) % ROUND_NS)
        again['t'] = events['t']
        assert np.array_equal(again, events)


def words(codes: list[int]) -> st.SearchStrategy[bytes]:
    """Draw payloads of 16-bit words with these codes, mostly with small values."""
    values = st.one_of(st.integers(0, 7), st.integers(0, 4095))
    word = st.builds(lambda code, value: code << 12 | value, st.sampled_from(codes), values)
    return st.lists(word, max_size=200).map(lambda drawn: np.array(drawn, '<u2').tobytes())


#: Anything; words that are all known, so that the decoders get far; 64-bit words like events.
PAYLOADS = st.one_of(
    st.binary(max_size=400),
    words([0x0, 0x2, 0x3, 0x4, 0x5, 0x6, 0x7, 0x8, 0xA, 0xE, 0xF]),
    words(list(range(16))),
    words([0, 1, 2, 3, 4, 5]),
    st.lists(st.integers(0, 2**40 - 1), max_size=50).map(
        lambda drawn: np.sort(np.array(drawn, '<u8')).tobytes()
    ),
)


@settings(max_examples=500, deadline=timedelta(seconds=2))
@given(
    st.sampled_from(DECODABLE),
    st.lists(PAYLOADS, min_size=1, max_size=3),
    st.integers(-1, 2**62),
    st.integers(-1, 2**64 - 1),
    st.sampled_from([(1, 1), (8, 8), (640, 480), (2048, 2048), (0, 5), (70_000, 5)]),
)
def test_any_bytes_give_valid_events_or_a_packet_error(
    check_events: Callable[[Events, int, int], None],
    encoding: str,
    payloads: list[bytes],
    stamp_ns: int,
    time_base_ns: int,
    size: tuple[int, int],
) -> None:
    """Never another exception, by either way of decoding.

    Words that cannot be understood alone are no error: only the packet's fields and length are.
    """
    decoder = Decoder()
    for payload in payloads:
        for way in (decode, decoder.decode):
            try:
                events = way(encoding, payload, stamp_ns, time_base_ns, *size)
            except PacketError:
                continue
            check_events(events, *size)
