"""Bags that we write, opened with libraries that others wrote."""

from collections.abc import Callable
import errno
import os
from pathlib import Path
import random
import struct
import subprocess

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
import yaml

from spikelane.bag.metadata import QosProfile
from spikelane.bag.reader import BagReader
from spikelane.bag.schema import Schema
from spikelane.bag.writer import BagWriter
from spikelane_sim.errors import BagError

DATA = Path(__file__).parents[3] / 'data'
FLOAT64 = 'std_msgs/msg/Float64'
FLOAT64_HASH = 'RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a'
LATCHED = QosProfile(durability='transient_local')


def cdr(value: float) -> bytes:
    """A std_msgs/msg/Float64 as it goes over the wire."""
    return b'\x00\x01\x00\x00' + struct.pack('<d', value)


def add_distance(bag: BagWriter, name: str = '/lane/distance') -> int:
    """Declare a topic of Float64."""
    return bag.add_topic(name, FLOAT64, 'float64 data\n', FLOAT64_HASH, [QosProfile()])


def write_distances(path: Path, count: int = 100, **options: object) -> None:
    """Write a bag of `count` distances, 0.05 s apart."""
    with BagWriter(path, **options) as bag:  # type: ignore[arg-type]
        topic = add_distance(bag)
        for number in range(count):
            bag.write(topic, 10**9 + number * 50_000_000, 10**9 + number, cdr(number / 4))


def values(path: Path) -> list[float]:
    """Return the distances that our reader finds."""
    return [
        struct.unpack('<d', message.data[4:])[0]
        for message in BagReader(path).messages(['/lane/distance'])
    ]


@pytest.mark.parametrize('compression', ['zstd', 'none'])
def test_rosbags_opens_and_decodes_it_and_accepts_its_hash(
    tmp_path: Path, compression: str
) -> None:
    """AnyReader recomputes the type's hash from the definition."""
    write_distances(tmp_path / 'bag', compression=compression, chunk_bytes=1000)
    with Reader(tmp_path / 'bag') as reader:
        assert reader.message_count == 100
        assert reader.start_time == 1_000_000_000
        assert reader.duration == 4_950_000_001  # rosbags counts the end as exclusive
        assert reader.topics['/lane/distance'].msgtype == FLOAT64
        assert reader.connections[0].digest == FLOAT64_HASH
    with AnyReader([tmp_path / 'bag']) as bag:
        found = [
            (time, bag.deserialize(raw, connection.msgtype).data)  # type: ignore[attr-defined]
            for connection, time, raw in bag.messages()
        ]
    assert found == [(10**9 + n * 50_000_000, n / 4) for n in range(100)]


@pytest.mark.parametrize('compression', ['zstd', 'none'])
def test_mcap_decodes_it_with_the_definition_inside(tmp_path: Path, compression: str) -> None:
    """The indexed reader uses summary, chunk and message indexes and checks the CRCs."""
    write_distances(tmp_path / 'bag', compression=compression, chunk_bytes=1000)
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == 'ros2'
        found = [
            (channel.topic, message.log_time, message.publish_time, decoded.data)
            for _, channel, message, decoded in reader.iter_decoded_messages()
        ]
        assert found[99] == ('/lane/distance', 5_950_000_000, 1_000_000_099, 24.75)
        assert len(found) == 100
        window = reader.iter_messages(starting_at=2_000_000_000, ending_before=2_200_000_000)
        assert [message.log_time for _, _, message in window] == [
            2_000_000_000,
            2_050_000_000,
            2_100_000_000,
            2_150_000_000,
        ]


def test_records_and_summary_are_those_of_rosbag2s_file(tmp_path: Path) -> None:
    """Compare kind by kind with a file that `ros2 bag record` wrote."""
    write_distances(tmp_path / 'bag', compression='none')
    with (
        (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as our_stream,
        (DATA / 'bag_none' / 'bag_none_0.mcap').open('rb') as official_stream,
    ):
        ours, official = make_reader(our_stream), make_reader(official_stream)
        assert [record.name for record in ours.iter_metadata()] == ['rosbag2', 'rosbag2']
        assert [record.name for record in official.iter_metadata()] == ['rosbag2', 'rosbag2']
        our_summary, official_summary = ours.get_summary(), official.get_summary()
        assert our_summary is not None
        assert official_summary is not None
        our_channel = our_summary.channels[1]
        official_channel = next(
            channel
            for channel in official_summary.channels.values()
            if channel.topic == '/lane/distance'
        )
        assert our_channel.metadata == official_channel.metadata
        assert our_channel.message_encoding == official_channel.message_encoding == 'cdr'
        assert our_summary.schemas[1].name == FLOAT64
        assert our_summary.schemas[1].encoding == 'ros2msg'
        statistics = our_summary.statistics
        assert statistics is not None
        assert statistics.message_count == 100
        assert (statistics.chunk_count, statistics.metadata_count) == (1, 2)
        first, last = ours.iter_metadata()
        counts = [
            yaml.safe_load(record.metadata['serialized_metadata'])['message_count']
            for record in (first, last)
        ]
        assert counts == [0, 100]


def test_the_metadata_file_says_what_the_bag_holds(tmp_path: Path) -> None:
    """Counts, times, files and the facts about the run."""
    write_distances(tmp_path / 'lap 1', custom_data={'seed': '7', 'lane': 'outer'})
    text = (tmp_path / 'lap 1' / 'metadata.yaml').read_text()
    information = yaml.safe_load(text)['rosbag2_bagfile_information']
    assert information['message_count'] == 100
    assert information['relative_file_paths'] == ['lap 1_0.mcap']
    assert information['starting_time'] == {'nanoseconds_since_epoch': 1_000_000_000}
    assert information['duration'] == {'nanoseconds': 4_950_000_000}
    assert information['custom_data'] == {'seed': '7', 'lane': 'outer'}
    assert sorted(path.name for path in (tmp_path / 'lap 1').iterdir()) == [
        'lap 1_0.mcap',
        'metadata.yaml',
    ]


def test_a_bag_without_messages_opens(tmp_path: Path) -> None:
    """A recorder may be stopped before anything came."""
    with BagWriter(tmp_path / 'bag') as bag:
        add_distance(bag)
    with Reader(tmp_path / 'bag') as reader:
        assert reader.message_count == 0
    assert list(BagReader(tmp_path / 'bag').messages()) == []


def test_a_topic_of_unknown_definition_is_recorded(tmp_path: Path) -> None:
    """With empty texts, as rosbag2 does."""
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write(bag.add_topic('/x', 'lost_msgs/msg/Thing', Schema('', '')), 1, 1, cdr(1.0))
    reader = BagReader(tmp_path / 'bag')
    assert [message.type_name for message in reader.messages()] == ['lost_msgs/msg/Thing']
    with Reader(tmp_path / 'bag') as other:
        assert other.message_count == 1


def test_an_existing_folder_is_refused(tmp_path: Path) -> None:
    """Recording over a recording would lose it."""
    (tmp_path / 'bag').mkdir()
    with pytest.raises(BagError, match='expected a folder that does not exist yet'):
        BagWriter(tmp_path / 'bag')


@pytest.mark.parametrize(
    ('act', 'message'),
    [
        (lambda bag: add_distance(bag), 'in the bag already'),
        (lambda bag: bag.write(1, -1, 0, b''), 'expected times from 0'),
        (lambda bag: (bag.close(), bag.write(1, 0, 0, b'')), 'the bag is closed'),
    ],
)
def test_wrong_use_is_one_clear_error(
    tmp_path: Path, act: Callable[[BagWriter], object], message: str
) -> None:
    """Each of them leaves the bag as it was."""
    with BagWriter(tmp_path / 'bag') as bag:
        bag.write(add_distance(bag), 1, 1, cdr(1.0))
        with pytest.raises(BagError, match=message):
            act(bag)
    assert values(tmp_path / 'bag') == [1.0]


def test_an_unknown_compression_is_refused(tmp_path: Path) -> None:
    """Before anything is created."""
    with pytest.raises(BagError, match="expected one of zstd, none, got 'gzip'"):
        BagWriter(tmp_path / 'bag', compression='gzip')
    assert not (tmp_path / 'bag').exists()


def test_every_further_file_begins_with_what_latched_topics_hold(tmp_path: Path) -> None:
    """Each distinct message, in the order of arrival, under the time of the split."""
    with BagWriter(
        tmp_path / 'bag', max_file_bytes=4000, chunk_bytes=1000, compression='none'
    ) as bag:
        latched = bag.add_topic('/map', FLOAT64, 'float64 data\n', FLOAT64_HASH, [LATCHED])
        topic = add_distance(bag)
        for value in (1.0, 2.0, 1.0):
            bag.write(latched, 5, 5, cdr(value))
        for number in range(200):
            bag.write(topic, 10 + number, 10 + number, cdr(number))
    files = BagReader(tmp_path / 'bag').files
    assert [file.name for file in files] == [f'bag_{number}.mcap' for number in range(len(files))]
    assert len(files) > 2
    for file in files[1:]:
        first, second, third = list(BagReader(file).messages())[:3]
        assert (first.topic, first.data, first.publish_time_ns) == ('/map', cdr(2.0), 5)
        assert (second.topic, second.data) == ('/map', cdr(1.0))
        assert first.log_time_ns == third.log_time_ns
    assert values(tmp_path / 'bag') == list(range(200))
    with AnyReader([tmp_path / 'bag']) as reader:
        found = [raw for c, _, raw in reader.messages() if c.topic == '/lane/distance']
    assert found == [cdr(number) for number in range(200)]


def test_what_was_flushed_can_be_read_while_the_bag_is_open(tmp_path: Path) -> None:
    """The state in which a kill leaves it, with a metadata.yaml that counts the same."""
    bag = BagWriter(tmp_path / 'bag')
    topic = add_distance(bag)
    for number in range(10):
        bag.write(topic, number, number, cdr(number))
    bag.flush()
    bag.write(topic, 10, 10, cdr(10))
    reader = BagReader(tmp_path / 'bag')
    assert len(list(reader.messages())) == 10
    assert reader.metadata is not None
    assert reader.metadata.message_count == 10
    assert 'was cut or never closed' in reader.damage[0]
    bag.close()
    assert values(tmp_path / 'bag') == list(range(11))


def write_until_full(bag: BagWriter, topic: int, noise: bytes) -> None:
    """Write numbers, each followed by another 1000 bytes of the noise."""
    for number in range(10_000):
        bag.write(topic, number, number, cdr(number) + noise[number * 1000 : number * 1000 + 1000])


class FullDisk:
    """Stands in for os.write: the disk takes so many bytes, then none until space is freed."""

    def __init__(self, room: int, real: Callable[[int, bytes], int]) -> None:
        self.room = room
        self.real = real

    def write(self, fd: int, data: bytes) -> int:
        """Write what there is room for."""
        if self.room == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        count = self.real(fd, data[: self.room])
        self.room -= count
        return count


def test_a_disk_that_stays_full_leaves_the_complete_chunks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not even the summary fits: every chunk that was written is there, nothing half."""
    disk = FullDisk(20_000, os.write)
    bag = BagWriter(tmp_path / 'bag', compression='none', chunk_bytes=1000)
    topic = add_distance(bag)
    monkeypatch.setattr('spikelane.bag.container.os.write', disk.write)
    with pytest.raises(BagError, match='recording stopped, the disk is full') as error:
        write_until_full(bag, topic, b'')
    with pytest.raises(BagError, match='the bag is closed'):
        bag.write(topic, 0, 0, b'')
    bag.close()
    found = values(tmp_path / 'bag')
    assert found == list(range(len(found)))
    assert 200 < len(found) < 600
    assert f'{len(found)} messages are saved' in str(error.value)
    assert bag.message_count == len(found)


@pytest.mark.skipif(os.geteuid() != 0, reason='mounting a small disk needs root')
@pytest.mark.parametrize('compression', ['zstd', 'none'])
def test_on_a_full_disk_the_bag_is_complete(tmp_path: Path, compression: str) -> None:
    """The reserve has room for the summary and metadata.yaml: other libraries open it."""
    disk = tmp_path / 'disk'
    disk.mkdir()
    mount = ['mount', '-t', 'tmpfs', '-o', 'size=2m', 'tmpfs', str(disk)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip('mounting is not permitted here')
    try:
        bag = BagWriter(disk / 'bag', compression=compression, chunk_bytes=100_000)
        topic = add_distance(bag)
        with pytest.raises(BagError, match='the disk is full'):
            write_until_full(bag, topic, random.Random(7).randbytes(10_000_000))
        with Reader(disk / 'bag') as reader:
            assert reader.message_count == bag.message_count
            assert len(list(reader.messages())) == bag.message_count
        with (disk / 'bag' / 'bag_0.mcap').open('rb') as stream:
            assert len(list(make_reader(stream, validate_crcs=True).iter_messages())) > 1000
        ours = BagReader(disk / 'bag')
        assert len(list(ours.messages())) == bag.message_count
        assert ours.damage == []
        assert bag.lost_count < 100
    finally:
        subprocess.run(['umount', '--lazy', str(disk)], check=True)
