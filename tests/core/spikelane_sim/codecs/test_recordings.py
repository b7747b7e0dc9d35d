from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from spikelane_sim.codecs import decode, Decoder

rosbag2 = pytest.importorskip('rosbags.rosbag2')
typesys = pytest.importorskip('rosbags.typesys')

DATA = Path(__file__).parents[3] / 'data'
CAMERAS = Path(__file__).parents[5] / 'shared' / 'data' / 'real_cameras'
TYPE = 'event_camera_msgs/msg/EventPacket'
FIELDS = """\
std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events
"""


class Counted(NamedTuple):
    """What a decoder counts in a recording."""

    packets: int
    on: int
    off: int
    sum_x: int
    sum_y: int


def packets(bag: Path) -> Iterator[tuple[Any, ...]]:
    """Yield the arguments of `decode` of each EventPacket in a bag."""
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    store.register(typesys.get_types_from_msg(FIELDS, TYPE))
    with rosbag2.Reader(bag) as reader:
        for connection, _, raw in reader.messages():
            if connection.msgtype != TYPE:
                continue
            message = store.deserialize_cdr(raw, TYPE)
            stamp = message.header.stamp
            stamp_ns = stamp.sec * 10**9 + stamp.nanosec
            size = (message.width, message.height, message.is_bigendian)
            yield message.encoding, message.events, stamp_ns, message.time_base, *size


def count(decoded: list[Any]) -> Counted:
    """Count what the packets of a recording hold."""
    events = np.concatenate(decoded)
    on = int(np.count_nonzero(events['polarity'] == 1))
    sums = (int(events['x'].sum(dtype=np.int64)), int(events['y'].sum(dtype=np.int64)))
    return Counted(len(decoded), on, len(events) - on, *sums)


def camera(name: str) -> list[tuple[Any, ...]]:
    """Return the packets of a real camera's recording, where there is one."""
    if not CAMERAS.is_dir():
        pytest.skip(f'no recordings of cameras at {CAMERAS}')
    return list(packets(CAMERAS / name))


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('bag_none', Counted(98, 5496, 5643, 719005, 602957)),
        ('bag_zstd', Counted(91, 5086, 5212, 664087, 555322)),
    ],
)
def test_bags_of_rosbag2_hold_these_events(name: str, expected: Counted) -> None:
    """By either way; bag_zstd as event_camera_codecs counts, bag_none as faery does."""
    decoder = Decoder()
    assert count([decode(*packet) for packet in packets(DATA / name)]) == expected
    assert count([decoder.decode(*packet) for packet in packets(DATA / name)]) == expected


def test_a_prophesee_camera_is_decoded_as_the_official_decoder_does() -> None:
    """1280 x 720, evt3 with triggers; its packets begin anywhere in the stream."""
    decoder = Decoder()
    decoded = [decoder.decode(*packet) for packet in camera('test_data_evt3_trigger')]
    assert count(decoded) == Counted(105, 41439, 41030, 42078718, 31656267)
    assert decoded[0]['t'][0] == 14_224_870_000
    assert decoded[-1]['t'][-1] == 15_476_187_000


def test_an_inivation_camera_is_decoded_as_the_official_decoder_does() -> None:
    """640 x 480, libcaer; the time counter comes round during the recording."""
    recording = camera('test_data_libcaer_rollover')
    decoder = Decoder()
    for way in (decode, decoder.decode):
        decoded = [way(*packet) for packet in recording]
        assert count(decoded) == Counted(201, 181908, 152423, 111651612, 82801007)
        assert decoded[0]['t'][0] == 1_702_309_120_762_236_018
        assert decoded[-1]['t'][-1] == 1_702_309_122_762_222_018
