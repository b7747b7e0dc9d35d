"""Order, time and loss."""

from pathlib import Path
import struct

import pytest

from spikelane.bag.metadata import QosProfile
from spikelane.bag.reader import BagReader
from spikelane.bag.recording import NOT_RECORDED, Recording
from spikelane.bag.writer import BagWriter

LATCHED = QosProfile(durability='transient_local')


def clock(seconds: float) -> bytes:
    """A rosgraph_msgs/msg/Clock as it goes over the wire."""
    sec, nanosec = divmod(round(seconds * 1e9), 10**9)
    return b'\x00\x01\x00\x00' + struct.pack('<iI', sec, nanosec)


@pytest.fixture
def writer(tmp_path: Path) -> BagWriter:
    """Give a bag with topics 1 (/clock), 2 (/map, latched) and 3 (/x)."""
    bag = BagWriter(tmp_path / 'bag')
    for name, qos in (('/clock', QosProfile()), ('/map', LATCHED), ('/x', QosProfile())):
        bag.add_topic(name, 'std_msgs/msg/Empty', '', '', [qos])
    return bag


def recorded(writer: BagWriter) -> list[tuple[str, int, int]]:
    """Close the bag; return topic, log time and publish time of what is in it."""
    writer.close()
    messages = BagReader(writer.path).messages()
    return [(m.topic, m.log_time_ns, m.publish_time_ns) for m in messages]


def test_a_batch_is_written_in_the_order_of_reception(writer: BagWriter) -> None:
    """Topics are taken one after the other, but arrived interleaved."""
    Recording(writer).write([(10, 2, 9, 1, b''), (30, 2, 8, 2, b''), (20, 3, 7, 1, b'')])
    assert recorded(writer) == [('/map', 10, 9), ('/x', 20, 7), ('/map', 30, 8)]


def test_gaps_in_the_numbering_are_losses(writer: BagWriter) -> None:
    """Not what came before the first message, nor a publisher that starts again."""
    recording = Recording(writer)
    recording.watch_losses(3, has_one_publisher=True)
    numbers = [5, 6, 9, 1, 2, 4]
    recording.write([(time, 3, 0, number, b'') for time, number in enumerate(numbers)])
    assert recording.lost_count == 3


def test_topics_of_several_publishers_are_not_watched(writer: BagWriter) -> None:
    """Each numbers its own messages."""
    recording = Recording(writer)
    recording.watch_losses(3, has_one_publisher=True)
    recording.watch_losses(3, has_one_publisher=False)
    recording.write([(1, 3, 0, 1, b''), (2, 3, 0, 100, b'')])
    assert recording.lost_count == 0


def test_simulation_time_stamps_what_follows_a_clock_message(writer: BagWriter) -> None:
    """What came before the first waits for it instead of being stamped zero."""
    recording = Recording(writer, use_sim_time=True)
    recording.follow_clock(1)
    recording.write([(10**18, 3, 5, 1, b''), (10**18 + 1, 1, 6, 1, clock(0.05))])
    recording.write([(10**18 + 2, 3, 7, 2, b''), (10**18 + 3, 1, 8, 2, clock(0.1))])
    recording.end()
    assert recorded(writer) == [
        ('/x', 50_000_000, 5),
        ('/clock', 50_000_000, 6),
        ('/x', 50_000_000, 7),
        ('/clock', 100_000_000, 8),
    ]


def test_a_clock_that_is_not_recorded_still_stamps(writer: BagWriter) -> None:
    """/clock need not be among the topics to record."""
    recording = Recording(writer, use_sim_time=True)
    recording.follow_clock(NOT_RECORDED)
    recording.write([(1, NOT_RECORDED, 0, 1, clock(2.0)), (2, 3, 5, 1, b'')])
    recording.end()
    assert recorded(writer) == [('/x', 2_000_000_000, 5)]


def test_without_any_clock_the_time_of_reception_remains(writer: BagWriter) -> None:
    """Nothing is lost because a clock never came."""
    recording = Recording(writer, use_sim_time=True)
    recording.write([(77, 3, 5, 1, b'')])
    recording.end()
    assert recorded(writer) == [('/x', 77, 5)]


def test_when_time_goes_back_latched_messages_are_repeated(writer: BagWriter) -> None:
    """A player that starts at the new episode also gets them."""
    recording = Recording(writer)
    recording.follow_clock(1)
    recording.write([(1, 2, 1, 1, b'map'), (2, 1, 2, 1, clock(9.0)), (3, 1, 3, 2, clock(0.05))])
    assert recorded(writer) == [('/map', 1, 1), ('/clock', 2, 2), ('/map', 3, 1), ('/clock', 3, 3)]
