"""Reading bags of others, cut bags and damaged bags."""

from collections import Counter
import functools
import hashlib
from pathlib import Path
import struct
import tempfile

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
import pytest

from spikelane.bag.reader import BagReader
from spikelane.bag.writer import BagWriter
from spikelane_sim.errors import BagError

DATA = Path(__file__).parents[3] / 'data'
COUNT = 600


@functools.cache
def sample() -> bytes:
    """Return a file of ours with many chunks, on two topics."""
    with tempfile.TemporaryDirectory() as folder:
        with BagWriter(Path(folder) / 'bag', chunk_bytes=2000) as bag:
            topics = [
                bag.add_topic(name, 'std_msgs/msg/Float64', 'float64 data\n')
                for name in ('/even', '/odd')
            ]
            for number in range(COUNT):
                # A hash, so that chunks do not compress to nothing.
                data = hashlib.sha256(number.to_bytes(4, 'little')).digest()
                bag.write(topics[number % 2], number, number, struct.pack('<I', number) + data)
        return (Path(folder) / 'bag' / 'bag_0.mcap').read_bytes()


@functools.cache
def chunk_ends() -> list[tuple[int, int]]:
    """Return where each chunk ends and how many messages there are up to it, as mcap sees it."""
    with tempfile.TemporaryFile() as stream:
        stream.write(sample())
        stream.seek(0)
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        indexes = sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset)
        return [
            (index.chunk_start_offset + index.chunk_length, index.message_end_time + 1)
            for index in indexes
        ]


def read_bytes(content: bytes) -> tuple[list[int], list[str]]:
    """Return the numbers of the messages found in these bytes, and the damage reported."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'cut_0.mcap'
        path.write_bytes(content)
        reader = BagReader(path)
        numbers = [struct.unpack_from('<I', message.data)[0] for message in reader.messages()]
        return numbers, reader.damage


@pytest.mark.parametrize(('name', 'count'), [('bag_none', 98), ('bag_zstd', 91)])
def test_bags_of_ros2_bag_record_are_read_whole(name: str, count: int) -> None:
    """Counts, types and definitions of a bag made by the official recorder."""
    reader = BagReader(DATA / name)
    counts = Counter(message.topic for message in reader.messages())
    assert counts == {'/tf_static': 1, '/lane/distance': count, '/event_camera/events': count}
    assert reader.damage == []
    assert reader.topics['/lane/distance'].schema_encoding == 'ros2msg'
    assert reader.topics['/event_camera/events'].type_hash == (
        'RIHS01_d6fa176260b1f37e5a40845305315e150a0f18191241eb64f407442aa29844aa'
    )
    assert 'durability: transient_local' in reader.topics['/tf_static'].offered_qos_profiles


def test_the_first_messages_of_an_official_bag_have_their_times() -> None:
    """Log time is when it was received, publish time when it was sent."""
    first, second, *_ = BagReader(DATA / 'bag_none').messages()
    assert first.topic == '/event_camera/events'
    assert (first.log_time_ns, first.publish_time_ns) == (
        1795321372272372061,
        1795321372272223760,
    )
    assert len(first.data) == 852
    assert (second.topic, second.type_name) == ('/lane/distance', 'std_msgs/msg/Float64')


def test_messages_of_some_topics_can_be_had_alone() -> None:
    """And the others are still known."""
    reader = BagReader(DATA / 'bag_zstd')
    assert {message.topic for message in reader.messages(['/tf_static'])} == {'/tf_static'}
    assert len(reader.topics) == 3


def test_a_file_cut_at_60_percent_gives_all_messages_of_complete_chunks() -> None:
    """And the reader says that it was cut."""
    content = sample()[: len(sample()) * 6 // 10]
    numbers, damage = read_bytes(content)
    expected = max(count for end, count in chunk_ends() if end <= len(content))
    assert numbers == list(range(expected))
    assert 0.4 * COUNT < expected < 0.7 * COUNT
    assert len(damage) == 1
    assert f'all {expected} messages of complete chunks were read' in damage[0]


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_wherever_a_file_is_cut_complete_chunks_are_read(data: st.DataObject) -> None:
    """No cut raises, loses a complete chunk or invents a message."""
    length = data.draw(st.integers(0, len(sample()) - 1))
    numbers, damage = read_bytes(sample()[:length])
    expected = max([count for end, count in chunk_ends() if end <= length], default=0)
    assert numbers == list(range(expected))
    assert len(damage) == 1


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_a_changed_byte_costs_at_most_what_it_damaged(data: st.DataObject) -> None:
    """Never an exception; messages that come are true ones, in order."""
    position = data.draw(st.integers(0, len(sample()) - 1))
    content = bytearray(sample())
    content[position] ^= data.draw(st.integers(1, 255))
    numbers, _ = read_bytes(bytes(content))
    assert numbers == sorted(set(numbers))
    assert set(numbers) <= set(range(COUNT))


def test_a_damaged_chunk_is_left_out_and_reported() -> None:
    """All others are read, also where it was the one that declared the channels."""
    content = bytearray(sample())
    end, count = chunk_ends()[0]
    content[end - 20] ^= 0xFF
    numbers, damage = read_bytes(bytes(content))
    assert numbers == list(range(count, COUNT))
    assert len(damage) == 1
    assert 'is damaged and was left out' in damage[0]


def test_a_complete_file_is_reported_sound() -> None:
    """No damage, all messages."""
    assert read_bytes(sample()) == (list(range(COUNT)), [])


@pytest.mark.parametrize('compression', list(CompressionType))
@pytest.mark.parametrize('use_chunking', [True, False])
def test_files_of_the_mcap_library_are_read(
    tmp_path: Path, compression: CompressionType, use_chunking: bool
) -> None:
    """With any compression, and unchunked as by the preset fastwrite."""
    with (tmp_path / 'a_0.mcap').open('wb') as stream:
        writer = Writer(stream, compression=compression, use_chunking=use_chunking)
        writer.start(profile='ros2')
        schema = writer.register_schema('std_msgs/msg/Float64', 'ros2msg', b'float64 data')
        channel = writer.register_channel('/x', 'cdr', schema)
        for number in range(50):
            writer.add_message(channel, log_time=number, publish_time=7, data=bytes([number]))
        writer.finish()  # type: ignore[no-untyped-call]
    reader = BagReader(tmp_path / 'a_0.mcap')
    found = [(m.topic, m.log_time_ns, m.publish_time_ns, m.data) for m in reader.messages()]
    assert found == [('/x', number, 7, bytes([number])) for number in range(50)]
    assert reader.damage == []


def test_custom_data_is_found_without_metadata_yaml(tmp_path: Path) -> None:
    """The file itself carries it, from its first bytes on."""
    with BagWriter(tmp_path / 'bag', custom_data={'seed': '7'}) as bag:
        bag.add_topic('/x', 'std_msgs/msg/Float64', 'float64 data\n')
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    reader = BagReader(tmp_path / 'bag')
    assert list(reader.messages()) == []
    assert reader.custom_data == {'seed': '7'}


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    """Each with one sentence that names it."""
    with pytest.raises(BagError, match=r'nothing: expected an \.mcap or \.db3 file or a bag'):
        BagReader(tmp_path / 'nothing')
    (tmp_path / 'a.db3').touch()
    with pytest.raises(BagError, match=r'expected MCAP storage, got sqlite3'):
        BagReader(tmp_path / 'a.db3')
    (tmp_path / 'a.db3').unlink()
    with pytest.raises(BagError, match=r'expected \.mcap or \.db3 files, found none'):
        BagReader(tmp_path)


def test_bags_of_another_storage_are_refused(tmp_path: Path) -> None:
    """An sqlite3 bag, say."""
    (tmp_path / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n'
        '  relative_file_paths:\n    - a_0.db3\n  message_count: 0\n'
    )
    (tmp_path / 'a_0.db3').touch()
    with pytest.raises(BagError, match='expected MCAP storage, got sqlite3'):
        BagReader(tmp_path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    """A bag that was copied in part."""
    with BagWriter(tmp_path / 'bag', max_file_bytes=1, chunk_bytes=1) as bag:
        topic = bag.add_topic('/x', 'std_msgs/msg/Float64', 'float64 data\n')
        for number in range(3):
            bag.write(topic, number, number, b'1234')
    (tmp_path / 'bag' / 'bag_1.mcap').unlink()
    with pytest.raises(BagError, match=r'bag_1\.mcap is missing'):
        BagReader(tmp_path / 'bag')
