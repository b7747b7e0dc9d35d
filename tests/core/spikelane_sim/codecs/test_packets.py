from array import array
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spikelane_sim.codecs import DECODABLE, decode, Decoder, encode
from spikelane_sim.errors import PacketError
from spikelane_sim.events import make_events, no_events

PACKETS = Path(__file__).parents[3] / 'data' / 'event_packets.json'
GOOD: dict[str, Any] = {
    'data': b'',
    'stamp_ns': 50_000_000,
    'time_base_ns': 0,
    'width': 128,
    'height': 128,
}


@pytest.mark.parametrize(
    'packet',
    json.loads(PACKETS.read_text()),
    ids=lambda packet: f'{packet["encoding"]}-{len(packet["events"])}',
)
def test_bytes_of_the_official_encoder_give_its_events(packet: dict[str, Any]) -> None:
    """Each of them, and again from the bytes that we make of them."""
    encoding, base_ns = packet['encoding'], packet['time_base_ns']
    t, x, y, on = np.array(packet['events'], dtype=np.int64).reshape(-1, 4).T
    expected = make_events(t, x, y, np.where(on, 1, -1))
    args = (encoding, bytes.fromhex(packet['hex']), base_ns, base_ns, 128, 128)
    assert np.array_equal(decode(*args), expected)

    ours = encode(encoding, expected, base_ns, 128, 128)
    again = decode(encoding, ours.data, base_ns, ours.time_base_ns, 128, 128)
    assert np.array_equal(again, expected)


@pytest.mark.parametrize('encoding', DECODABLE)
@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'width': 0}, 'a sensor of 1 x 1 to .*, got 0 x 128'),
        ({'height': 0}, 'got 128 x 0'),
        ({'width': -1}, 'got -1 x 128'),
        ({'width': 65537}, 'got 65537 x 128'),
        ({'height': 32769}, 'got 128 x 32769'),
        ({'stamp_ns': -1}, r'a stamp of 0 to 2\*\*62 ns, got -1'),
        ({'stamp_ns': 2**62}, 'a stamp'),
        ({'time_base_ns': -1}, r'a time base of 0 to 2\*\*62 ns, got -1'),
        ({'time_base_ns': 2**64 - 1}, 'a time base'),
        ({'is_bigendian': True}, 'little-endian words'),
        ({'data': b'\0'}, 'words of [28] bytes, got 1 bytes'),
        ({'data': bytes(64 * 2**20 + 8)}, 'at most 67108864 bytes, got 67108872'),
    ],
)
def test_a_packet_with_absurd_fields_is_an_error(
    encoding: str, change: dict[str, Any], message: str
) -> None:
    """By either way of decoding."""
    with pytest.raises(PacketError, match=message):
        decode(encoding, **(GOOD | change))
    with pytest.raises(PacketError, match=message):
        Decoder().decode(encoding, **(GOOD | change))


@pytest.mark.parametrize('encoding', ['evt3', 'libcaer_cmp'])
def test_a_sensor_beyond_11_bits_is_an_error(encoding: str) -> None:
    """2048 is the most."""
    decode(encoding, **(GOOD | {'width': 2048, 'height': 2048}))
    with pytest.raises(PacketError, match='got 2049 x 128'):
        decode(encoding, **(GOOD | {'width': 2049}))


@pytest.mark.parametrize('encoding', ['trigger', 'evt2', 'EVT3', ''])
def test_an_unknown_encoding_is_an_error(encoding: str) -> None:
    """The error lists the known ones."""
    with pytest.raises(PacketError, match=r"of \('evt3', 'mono', 'libcaer', 'libcaer_cmp'\), got"):
        decode(encoding, **GOOD)
    with pytest.raises(PacketError, match='encoding'):
        encode(encoding, no_events(), 0, 8, 8)


def test_camera_encodings_are_not_written() -> None:
    """Only what a simulator sends is."""
    with pytest.raises(PacketError, match=r"to encode \('evt3', 'mono'\), got 'libcaer'"):
        encode('libcaer', no_events(), 0, 8, 8)


def test_packets_that_would_hold_absurdly_many_events_are_an_error() -> None:
    """2 MiB of vector words, 12 events in each, do not take more memory than allowed."""
    words = np.full(2**21, 0x4FFF, '<u2')
    words[:4] = 0x8000, 0x6000, 0x0000, 0x3000
    with pytest.raises(PacketError, match='at most 16777216 events'):
        decode('evt3', **(GOOD | {'data': words.tobytes()}))


@pytest.mark.parametrize(
    'events',
    [np.zeros((2, 2), no_events().dtype), np.zeros(2), np.zeros(3, [('t', '<i8'), ('x', '<u2')])],
)
def test_arrays_that_are_not_events_are_an_error(events: Any) -> None:
    """Two dimensions, numbers, other fields."""
    with pytest.raises(PacketError, match='events: expected at most 8388608'):
        encode('evt3', events, 50_000_000, 128, 128)


def test_the_payload_may_be_any_buffer() -> None:
    """The array of rclpy, the read-only NumPy of rosbags, a view at an odd address."""
    data = bytes.fromhex('0c80 5063 3f00 1920')
    expected = make_events([50_000_000], 25, 63, -1)
    for payload in (
        array('B', data),
        np.frombuffer(data, np.uint8),
        bytearray(data),
        memoryview(b'\0' + data)[1:],
    ):
        assert np.array_equal(decode('evt3', **(GOOD | {'data': payload})), expected)


def test_events_may_be_a_view_and_numbers_may_be_numpys() -> None:
    """Read-only events and every second one of an array; stamps and sizes from arrays."""
    events = make_events(50_000_000, np.arange(6), 0, 1)
    events.flags.writeable = False
    expected = encode('evt3', events[::2].copy(), 50_000_000, 128, 128)
    stamp_ns, width = np.array([50_000_000]), np.array([128], np.uint32)
    assert encode('evt3', events[::2], stamp_ns[0], width[0], width[0]) == expected
