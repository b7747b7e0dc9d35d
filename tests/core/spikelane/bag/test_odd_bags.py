"""Bags as users have them: reindexed, renamed, compressed otherwise, damaged, or no bags."""

from collections.abc import Callable
from pathlib import Path
import resource
import shutil
import sqlite3
import struct
import time
from typing import Any

import lz4.frame
from mcap.writer import CompressionType, Writer
import numpy as np
import pytest
import zstandard

from spikelane.bag.container import MAGIC
from spikelane.bag.drive import RecordedDrive
from spikelane.bag.reader import BagReader
from spikelane.bag.source import BagSource
from spikelane.bag.writer import BagWriter
from spikelane.main import run
from spikelane.runs.configuration import Request
from spikelane.runs.replay.config import ReplayConfig
from spikelane.runs.replay.metrics import summarise
from spikelane.runs.replay.run import replay
from spikelane_sim.errors import BagError

ODD = Path(__file__).parents[3] / 'data' / 'odd_bags'
EVENT_PACKET = 'event_camera_msgs/msg/EventPacket'
ZEROS = 1 << 27  # bytes; more than a small file may become


def measured(bag: Path) -> dict[str, Any]:
    """Replay a bag; return what is measured."""
    drive = RecordedDrive(bag)
    result = replay(ReplayConfig.make(Request('1', 'braitenberg', parameters={}), bag), drive)
    return summarise(drive, result.answers, result.sensor)


def mcap_file(path: Path, chunk: bytes, compression: str, size: int, times: int = 1) -> Path:
    """Write an MCAP file of chunks with this content, which becomes so large."""
    body = struct.pack('<QQQI', 0, 0, size, 0)
    body += struct.pack('<I', len(compression)) + compression.encode()
    body += struct.pack('<Q', len(chunk)) + chunk
    record = struct.pack('<BQ', 6, len(body)) + body
    header = struct.pack('<I', 4) + b'ros2' + struct.pack('<I', 0)
    head = MAGIC + struct.pack('<BQ', 1, len(header)) + header
    footer = struct.pack('<BQQQI', 2, 20, 0, 0, 0)
    path.write_bytes(head + record * times + footer + MAGIC)
    return path


def database(path: Path, messages: list[bytes]) -> Path:
    """Write an SQLite bag file with one topic of event packets."""
    with sqlite3.connect(path) as connection:
        connection.executescript(
            'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT,'
            ' serialization_format TEXT, offered_qos_profiles TEXT);'
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER,'
            ' timestamp INTEGER, data BLOB);'
        )
        connection.execute(
            'INSERT INTO topics VALUES(1, ?, ?, ?, ?)', ('/events', EVENT_PACKET, 'cdr', '')
        )
        for number, message in enumerate(messages):
            connection.execute('INSERT INTO messages VALUES(NULL, 1, ?, ?)', (number, message))
    connection.close()
    return path


def small_bag(path: Path, topic: str = '/x', **options: Any) -> Path:
    """Write a bag of three messages."""
    with BagWriter(path, **options) as bag:
        number = bag.add_topic(topic, 'std_msgs/msg/Float64', 'float64 data\n')
        for time_ns in range(3):
            bag.write(number, time_ns, time_ns, b'1234')
    return path


# --- bags that are read ---------------------------------------------------------------------


@pytest.mark.parametrize(
    'name',
    [
        '00_plain/bag.mcap',
        '03_event_array_msgs/bag.mcap',
        '20_reindexed_empty_storage_id',
        '30_path_with_folder',
        '32_filtered_copy_beside',
        '35_db3_message_compressed_no_metadata',
        '37_db3_zstd_no_metadata',
        '37_db3_zstd_no_metadata/bag_0.db3.zstd',
    ],
)
def test_the_same_recording_is_read_from_every_odd_bag(name: str) -> None:
    """200 packets with 2,019 ON and 1,981 OFF events in 19 steps."""
    result = measured(ODD / name)
    assert (result['packets'], result['observations'], result['faulty_packets']) == (200, 19, 0)
    events = result['events']
    assert (events['on'], events['off'], events['kept']) == (2019, 1981, 3779)
    others = [note for note in result['notes'] if not note.startswith('no /')]
    named = ['filtered.mcap is not named in metadata.yaml: not read'] if '32' in name else []
    # Packets of 20 events: 19 of the one that completes the last step, then 9 packets.
    rest = (
        'the recording ends within a step: 199 events and 9 whole event packets after the last '
        'complete step are not answered'
    )
    assert others == [*named, rest]
    assert result['unfinished'] == {'packets': 9, 'events': 199}


def test_several_recordings_in_a_folder_are_told_apart(tmp_path: Path) -> None:
    """Split files belong together; of two recordings, one has to be named."""
    small_bag(tmp_path / 'bag', max_file_bytes=1, chunk_bytes=1)
    (tmp_path / 'bag/metadata.yaml').unlink()
    assert [file.name for file in BagReader(tmp_path / 'bag').files] == [
        'bag_0.mcap',
        'bag_1.mcap',
        'bag_2.mcap',
        'bag_3.mcap',
    ]
    shutil.copy(tmp_path / 'bag/bag_1.mcap', tmp_path / 'bag/other.mcap')
    with pytest.raises(BagError, match=r'got 2 without a metadata\.yaml: bag_0\.mcap, other\.mc'):
        BagReader(tmp_path / 'bag')
    assert len(list(BagReader(tmp_path / 'bag/other.mcap').messages())) == 1


def test_split_files_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    """The tenth after the ninth."""
    with BagWriter(tmp_path / 'bag', max_file_bytes=1, chunk_bytes=1) as bag:
        topic = bag.add_topic('/x', 'std_msgs/msg/Float64', 'float64 data\n')
        for number in range(12):
            bag.write(topic, number, number, bytes([number]))
    (tmp_path / 'bag/metadata.yaml').unlink()
    found = [message.data[0] for message in BagReader(tmp_path / 'bag').messages()]
    assert found == list(range(12))


def test_a_newer_version_of_metadata_is_read_with_a_note(tmp_path: Path) -> None:
    """As far as it is the same."""
    bag = small_bag(tmp_path / 'bag')
    file = bag / 'metadata.yaml'
    file.write_text(file.read_text().replace('version: 9', 'version: 12'))
    assert BagSource(bag).notes == [
        'metadata.yaml is of version 12, newer than 9: read as far as it is the same'
    ]
    assert len(list(BagReader(bag).messages())) == 3


def test_files_are_found_by_their_first_bytes(tmp_path: Path) -> None:
    """Whatever their name and metadata.yaml say."""
    content = (ODD / '00_plain/bag.mcap').read_bytes()
    (tmp_path / 'recording').write_bytes(content)
    assert measured(tmp_path / 'recording')['packets'] == 200
    bag = tmp_path / 'bag#1?%20'
    shutil.copytree(ODD / '37_db3_zstd_no_metadata', bag)
    with (bag / 'bag_0.db3.zstd').open('rb') as source, (bag / 'bag_0.db3').open('wb') as target:
        zstandard.ZstdDecompressor().copy_stream(source, target)
    (bag / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n'
        '  relative_file_paths: [/elsewhere/bag_0.db3.zstd, bag_0.db3.zstd]\n'
    )
    assert measured(bag)['packets'] == 200  # named twice, read once
    (bag / 'bag_0.db3.zstd').unlink()
    assert measured(bag)['packets'] == 200


def test_what_sqlite_keeps_next_to_a_database_is_noted(tmp_path: Path) -> None:
    """Messages that a killed recorder left there are not read."""
    database(tmp_path / 'a_0.db3', [])
    (tmp_path / 'a_0.db3-wal').write_bytes(b'1')
    (note,) = BagSource(tmp_path).notes
    assert note == 'a_0.db3-wal may have messages that are not in a_0.db3'


@pytest.mark.parametrize('use_chunking', [True, False])
def test_a_file_without_summary_or_messages_is_read(tmp_path: Path, use_chunking: bool) -> None:
    """As streams leave it; an empty chunk is none."""
    file = tmp_path / 'a_0.mcap'
    with file.open('wb') as stream:
        writer = Writer(
            stream,
            compression=CompressionType.NONE,
            use_chunking=use_chunking,
            use_statistics=False,
            use_summary_offsets=False,
            repeat_channels=False,
            repeat_schemas=False,
        )
        writer.start(profile='ros2')
        schema = writer.register_schema(EVENT_PACKET, 'ros2msg', b'')
        writer.register_channel('/cam/events', 'cdr', schema)
        writer.finish()  # type: ignore[no-untyped-call]
    # The library leaves out a chunk without messages, with the channel in it.
    found = 'none, and no other topics' if use_chunking else '/cam/events without a readable'
    with pytest.raises(BagError, match=f'got {found}'):
        RecordedDrive(file)
    empty = mcap_file(tmp_path / 'b_0.mcap', b'', '', 0, times=3)
    reader = BagReader(empty)
    assert (list(reader.messages()), reader.damage) == ([], [])


def test_two_channels_may_have_one_topic(tmp_path: Path) -> None:
    """As in a bag that was merged."""
    file = tmp_path / 'a_0.mcap'
    with file.open('wb') as stream:
        writer = Writer(stream)
        writer.start(profile='ros2')
        schema = writer.register_schema('std_msgs/msg/Float64', 'ros2msg', b'float64 data')
        for number in range(2):
            channel = writer.register_channel('/x', 'cdr', schema, {'number': str(number)})
            writer.add_message(channel, log_time=number, publish_time=0, data=bytes([number]))
        writer.finish()  # type: ignore[no-untyped-call]
    assert [each.data for each in BagReader(file).messages()] == [b'\0', b'\1']


# --- bags that are refused, or read in part --------------------------------------------------


@pytest.mark.parametrize(
    ('name', 'head', 'expected'),
    [
        ('a.bag', b'#ROSBAG V2.0\n', r'got a ROS 1 bag: convert it with rosbags-convert --src'),
        ('a.raw', b'% Date 2024-05-01\n', r'got a RAW file of Prophesee: .* raw_to_bag -i FILE'),
        ('a.raw', b'\0' * 40, r'got a file named like a RAW file of Prophesee: .* raw_to_bag'),
        ('a.dat', b'% Data file containing CD\n', r'got a DAT file of Prophesee, .* raw_to_bag'),
        ('a.aedat4', b'#!AER-DAT4.0\r\n', r'got an AEDAT file of iniVation: .* libcaer_driver'),
        ('a.hdf5', b'\x89HDF\r\n\x1a\n', r'got an HDF5 file, .* raw_to_bag'),
        ('a.mcap.lz4', b'\x04\x22\x4d\x18', r'got a file compressed by lz4: decompress it first'),
        ('a', b'', r'got an empty file$'),
        ('a.csv', b'1,2,3\n', r"got a file that begins with b'1,2,3\\n'$"),
    ],
)
def test_other_recordings_are_named_with_their_converter(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, head: bytes, expected: str
) -> None:
    """In one line."""
    (tmp_path / name).write_bytes(head)
    with pytest.raises(BagError, match=expected):
        RecordedDrive(tmp_path / name)
    assert run(['replay', str(tmp_path / name), '--controller', 'braitenberg']) == 1
    assert capsys.readouterr().err.count('\n') == 1


def test_a_folder_of_other_recordings_says_what_is_in_it(tmp_path: Path) -> None:
    """The first of them."""
    (tmp_path / 'a.txt').write_text('notes')
    (tmp_path / 'cam.raw').write_bytes(b'% evt 3.0\n')
    with pytest.raises(BagError, match=r'found none; cam\.raw is a RAW file of Prophesee'):
        RecordedDrive(tmp_path)


def test_older_types_of_events_are_named_with_their_converter(tmp_path: Path) -> None:
    """With what was found."""
    with BagWriter(tmp_path / 'bag') as bag:
        topic = bag.add_topic('/dvs/events', 'dvs_msgs/msg/EventArray', '')
        bag.write(topic, 0, 0, b'1234')
    found = r'only /dvs/events \(dvs_msgs/msg/EventArray\); .* legacy_to_bag converts'
    with pytest.raises(BagError, match=found):
        RecordedDrive(tmp_path / 'bag')


def test_a_damaged_size_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """Beyond what an index can be."""
    assert run(['replay', str(ODD / 'overflow.mcap'), '--controller', 'braitenberg']) == 1
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    assert '2 records are damaged and were left out, the first at byte 51' in error


TOP = (
    'rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths: [bag_0.mcap]'
)


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        (TOP + '\n  custom_data: ' + '[' * 10**5, 'nested 32 deep at most'),
        (TOP + '\n  custom_data: ' + '{a: ' * 10**5, 'nested 32 deep at most'),
        (TOP + '\n  message_count: .inf', 'cannot convert float infinity to integer'),
        (TOP + '\n  custom_data: {a: !!timestamp foo}', 'a value does not fit its tag'),
        (TOP + '\n  custom_data: !!python/object:os.system {}', 'could not determine a construct'),
        (TOP + '\n  message_count: ' + '9' * 5000, 'a whole number of too many digits'),
        (TOP.replace('[bag_0.mcap]', 'bag_0.mcap'), "relative_file_paths: 'bag_0.mcap'"),
        (TOP.replace('mcap\n', 'rosbag_v2\n', 1), "expected storage mcap or sqlite3, got 'rosbag"),
        ('a: 1', r"expected rosbag2_bagfile_information: at its top, got 'a: 1'"),
        (TOP + '\n  custom_data: 3', 'expected the metadata of a rosbag2 bag'),
        (
            TOP.replace('mcap\n', 'mcap\n  \x07', 1),
            'special characters are not allowed|control ch',
        ),
    ],
)
def test_damaged_metadata_is_one_sentence(tmp_path: Path, text: str, expected: str) -> None:
    """Whatever is wrong with it."""
    bag = small_bag(tmp_path / 'bag')
    (bag / 'metadata.yaml').write_text(text)
    (bag / 'bag_0.mcap').write_bytes(b'')
    with pytest.raises(BagError, match=expected) as caught:
        BagReader(bag)
    assert '\n' not in str(caught.value)


def test_deep_nesting_inside_an_mcap_file_is_damage(tmp_path: Path) -> None:
    """Its messages are read all the same."""
    file = tmp_path / 'a_0.mcap'
    with file.open('wb') as stream:
        writer = Writer(stream)
        writer.start(profile='ros2')
        writer.add_metadata('rosbag2', {'serialized_metadata': '[' * 10**5})
        schema = writer.register_schema('std_msgs/msg/Float64', 'ros2msg', b'float64 data')
        channel = writer.register_channel('/x', 'cdr', schema)
        writer.add_message(channel, log_time=1, publish_time=0, data=b'1')
        writer.finish()  # type: ignore[no-untyped-call]
    reader = BagReader(file)
    assert len(list(reader.messages())) == 1
    assert 'nested 32 deep at most' in reader.damage[0]


def test_names_that_are_no_utf_8_are_no_obstacle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Files next to a bag may have such names; a path of a bag with one is refused in one line."""
    bag = tmp_path / 'bag'
    shutil.copytree(ODD / '32_filtered_copy_beside', bag)
    Path(bag / 'filtered.mcap').rename(bag / b'\xff.mcap'.decode(errors='surrogateescape'))
    out = str(tmp_path / 'out')
    assert run(['replay', str(bag), '--controller', 'braitenberg', '--out', out]) == 0
    assert '\ufffd.mcap is not named in metadata.yaml: not read' in capsys.readouterr().out
    bad = tmp_path / b'\xff'.decode(errors='surrogateescape')
    bad.mkdir()
    with pytest.raises(BagError, match='expected a path in UTF-8'):
        RecordedDrive(bad)


# --- limits ---------------------------------------------------------------------------------


def zeros(path: Path) -> Path:
    """Write zeros, compressed by zstd."""
    path.write_bytes(zstandard.ZstdCompressor().compress(bytes(ZEROS)))
    return path


def chunks_of_zeros(path: Path, compression: str) -> Path:
    """Write an MCAP file with three chunks of zeros."""
    if compression == 'zstd':
        chunk = zstandard.ZstdCompressor().compress(bytes(ZEROS))
    elif compression == 'unsized':  # a frame that does not say how large it becomes
        compressor = zstandard.ZstdCompressor().compressobj()
        chunk, compression = compressor.compress(bytes(ZEROS)) + compressor.flush(), 'zstd'
    else:
        chunk = lz4.frame.compress(bytes(ZEROS))[: 1 << 15]
    return mcap_file(path, chunk, compression, ZEROS, times=3)


@pytest.mark.parametrize(
    ('name', 'make', 'expected'),
    [
        ('a_0.mcap', lambda path: chunks_of_zeros(path, 'zstd'), '3 records are damaged.*may bec'),
        ('a_0.mcap', lambda path: chunks_of_zeros(path, 'unsized'), '3 records are damaged.*may'),
        ('a_0.mcap', lambda path: chunks_of_zeros(path, 'lz4'), '3 records are damaged.* may bec'),
        (
            'a_0.mcap',
            lambda path: mcap_file(path, zstandard.compress(b'1'), 'zstd', 1 << 40),
            'it would become 1099511627776 bytes, at most 536870912 are read',
        ),
        (
            'a_0.db3.zstd',
            zeros,
            'cannot be decompressed to its end: it would become 1048576 bytes',
        ),
        (
            'a_0.db3',
            lambda path: database(path, [zstandard.compress(bytes(ZEROS))] * 3),
            '/events: 3 messages cannot be decompressed: it would become 134217728 bytes',
        ),
    ],
)
def test_decompression_has_limits(
    tmp_path: Path, name: str, make: Callable[[Path], Path], expected: str
) -> None:
    """One clear line, at once."""
    file = make(tmp_path / name)
    assert file.stat().st_size < 200_000
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.monotonic()
    with pytest.raises(BagError, match=expected) as caught:
        RecordedDrive(file)
    assert '\n' not in str(caught.value)
    assert time.monotonic() - begin < 10
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib < 150_000


def test_reading_ends_after_very_many_messages_that_cannot_be_read(tmp_path: Path) -> None:
    """A small file may hold millions."""
    with BagWriter(tmp_path / 'bag') as bag:
        topic = bag.add_topic('/events', EVENT_PACKET, '')
        for _ in range(110_000):
            bag.write(topic, 0, 0, b'1')
    with pytest.raises(BagError, match='no more was read after 100001 such messages'):
        RecordedDrive(tmp_path / 'bag')


def test_zeros_in_a_chunk_are_no_records(tmp_path: Path) -> None:
    """They are not walked through nine bytes at a time."""
    size = 1 << 25
    chunk = zstandard.ZstdCompressor().compress(bytes(size))
    reader = BagReader(mcap_file(tmp_path / 'a_0.mcap', chunk, 'zstd', size, times=2))
    assert list(reader.messages()) == []
    assert reader.damage[0].startswith('a_0.mcap: 2 records are damaged and were left out')
    assert reader.damage[0].endswith('there is no record of kind 0')


def test_long_qos_profiles_are_not_parsed(tmp_path: Path) -> None:
    """They would take minutes."""
    file = database(tmp_path / 'a_0.db3', [b'1'])
    with sqlite3.connect(file) as connection:
        connection.execute('UPDATE topics SET offered_qos_profiles = ?', ('- a: 1\n' * 10**6,))
    connection.close()
    begin = time.monotonic()
    with pytest.raises(BagError, match='its QoS profiles have 7000000 letters, at most 1048576'):
        RecordedDrive(file)
    assert time.monotonic() - begin < 10


def test_names_of_topics_are_shown_on_one_line(tmp_path: Path) -> None:
    """Whatever letters they have."""
    bag = small_bag(tmp_path / 'bag', topic='/x\n\x1b[31m')
    with pytest.raises(BagError, match=r'only /x \ufffd\[31m \(std_msgs/msg/Float64\)$'):
        RecordedDrive(bag)


def test_a_database_cannot_have_more_than_it_holds(tmp_path: Path) -> None:
    """As with a column that is computed."""
    file = database(tmp_path / 'a_0.db3', [b'1'] * 5)
    with sqlite3.connect(file) as connection:
        connection.executescript(
            'ALTER TABLE messages RENAME COLUMN data TO old;'
            'ALTER TABLE messages ADD COLUMN data AS (zeroblob(900000000));'
        )
    connection.close()
    with pytest.raises(BagError, match=r'cannot be read any further: .*too big'):
        RecordedDrive(file)


# --- bags of which nothing can be measured ----------------------------------------------------


def packets(drives: Any, **changes: Any) -> list[Any]:
    """Return 60 packets of 5 ms, from a camera."""
    said = []
    from spikelane_sim.events import make_events

    for number in range(60):
        t_ns = np.arange(10) * 400_000 + number * 5_000_000
        events = make_events(t_ns, np.arange(10), np.arange(10), np.ones(10))
        packet = drives.packet(events, t_ns[0], number, 'mono')
        for name, value in changes.items():
            object.__setattr__(packet, name, value)
        object.__setattr__(packet, 'header', drives.header(10**9 + number * 5_000_000))
        said.append(drives.said('/event_camera/events', number * 5_000_000, packet))
    return said


def failure(bag: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """Replay a bag of which nothing can be measured; return the one line that says why."""
    out = str(bag.parent / 'out')
    assert run(['replay', str(bag), '--controller', 'braitenberg', '--json', '--out', out]) == 1
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    return error


def test_packets_that_cannot_be_decoded_are_a_failure(
    drives: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the first reason."""
    said = packets(drives, events=np.zeros(3, np.uint8))
    error = failure(drives.write(tmp_path / 'bag', said), capsys)
    assert 'none of the 60 event packets can be decoded: ' in error


def test_less_than_a_step_is_a_failure(
    drives: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No observation, no result."""
    error = failure(drives.write(tmp_path / 'bag', packets(drives)[:5]), capsys)
    assert 'the 5 event packets make no complete step of 50 ms' in error


@pytest.mark.parametrize('first', [0, 3, 5000])
def test_packets_of_two_publishers_are_a_failure(
    drives: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], first: int
) -> None:
    """Wherever the second one's numbers begin."""
    said = []
    for number, (one, other) in enumerate(zip(packets(drives), packets(drives), strict=True)):
        object.__setattr__(other.fields, 'seq', first + number)
        object.__setattr__(other.fields, 'header', drives.header(2 * 10**9 + number * 5_000_000))
        said += [one, other._replace(log_ns=one.log_ns + 1000)]
    error = failure(drives.write(tmp_path / 'bag', said), capsys)
    assert 'expected the packets of one publisher, got alternating packets of several' in error


# --- chance ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    'name',
    [
        '00_plain/bag.mcap',
        '35_db3_message_compressed_no_metadata/bag_0.db3',
        '37_db3_zstd_no_metadata/bag_0.db3.zstd',
        '20_reindexed_empty_storage_id/metadata.yaml',
    ],
)
def test_damage_by_chance_never_ends_otherwise(tmp_path: Path, name: str) -> None:
    """Only in a result or in one sentence."""
    bag = tmp_path / 'bag'
    shutil.copytree((ODD / name).parent, bag)
    file = bag / Path(name).name
    content = np.frombuffer(file.read_bytes(), np.uint8)
    rng = np.random.default_rng(7)
    for _ in range(40):
        damaged = content.copy()
        count = int(rng.choice([1, 3, 30]))
        where = rng.integers(0, rng.choice([200, len(content)]), count) % len(content)
        damaged[where] = rng.integers(0, 256, count)
        file.write_bytes(damaged[: len(content) - rng.integers(0, 2) * rng.integers(0, 9999)])
        try:
            lines = RecordedDrive(file if file.suffix != '.yaml' else bag).notes
        except BagError as error:
            lines = [str(error)]
        assert not any('\n' in line for line in lines)
