"""Repaired bags open in rosbags and in the mcap library, and have all that could be read."""

from collections import Counter
from collections.abc import Callable
import json
import os
from pathlib import Path
import shutil
from typing import Any

from mcap.reader import make_reader
from mcap.writer import Writer
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_typestore, Stores
import yaml

from spikelane.bag.drive import RecordedDrive
from spikelane.bag.metadata import QosProfile
from spikelane.bag.reader import BagReader
from spikelane.bag.repair import repair_bag
from spikelane.bag.writer import BagWriter
from spikelane.main import run
from spikelane_sim.errors import BagError

DATA = Path(__file__).parents[3] / 'data'
HASH = (
    'RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a'  # std_msgs/Float64
)
LATCHED = QosProfile(durability='transient_local')
FACTS = {'seed': '7', 'controller': 'rstdp'}
STORE = get_typestore(Stores.ROS2_JAZZY)
FLOAT64: Any = STORE.types['std_msgs/msg/Float64']


def killed_bag(path: Path, max_file_bytes: int = 0) -> Path:
    """Leave a bag as a kill of its recorder does: flushed chunks, and no end."""
    bag = BagWriter(path, chunk_bytes=2000, custom_data=FACTS, max_file_bytes=max_file_bytes)
    # Latched messages would be repeated in each file.
    qos = QosProfile() if max_file_bytes else LATCHED
    topics = [
        bag.add_topic(name, 'std_msgs/msg/Float64', 'float64 data\n', HASH, [qos])
        for name in ('/even', '/odd', '/never')
    ]
    for number in range(400):
        value = bytes(STORE.serialize_cdr(FLOAT64(float(number)), 'std_msgs/msg/Float64'))
        bag.write(topics[number % 2], 10**18 + number, 10**18 - number, value)
    bag.flush()
    for file in bag._files:
        file.close()
    bag._reserve.release()
    return path


def values(bag: Path) -> list[float]:
    """Return what rosbags reads, and see that the mcap library reads as much of each file."""
    with AnyReader([bag]) as reader:
        found = [
            reader.deserialize(data, connection.msgtype).data
            for connection, _, data in reader.messages()
        ]
        assert reader.message_count == len(found)
    count = 0
    for file in bag.glob('*.mcap'):
        with file.open('rb') as stream:
            mcap_reader = make_reader(stream, validate_crcs=True)
            summary = mcap_reader.get_summary()
            assert summary is not None
            assert summary.statistics is not None
            messages = list(mcap_reader.iter_messages())
            assert summary.statistics.message_count == len(messages)
            count += len(messages)
    assert count == len(found)
    return found


def values_of_folder(bag: Path) -> list[bytes]:
    """Return what rosbags reads by metadata.yaml."""
    with Reader(bag) as reader:
        return [data for _, _, data in reader.messages()]


def test_a_killed_bag_is_made_whole(tmp_path: Path) -> None:
    """With all messages, times, QoS, type hashes and custom data; again there is nothing to do."""
    bag = killed_bag(tmp_path / 'bag')
    before = [tuple(each) for each in BagReader(bag).messages()]
    with pytest.raises(Exception, match='magic'), AnyReader([bag]):
        pass
    repair = repair_bag(bag)
    assert repair.path == bag
    assert (repair.message_count, repair.written) == (400, ('bag_0.mcap', 'metadata.yaml'))
    assert any('was cut or never closed' in note for note in repair.notes)
    assert values(bag) == [float(number) for number in range(400)]
    reader = BagReader(bag)
    assert [tuple(each) for each in reader.messages()] == before
    assert (before[3][2], before[3][3]) == (10**18 + 3, 10**18 - 3)
    assert (reader.damage, reader.custom_data) == ([], FACTS)
    assert reader.topics['/never'].type_hash == HASH
    assert 'durability: transient_local' in reader.topics['/never'].offered_qos_profiles
    said = yaml.safe_load((bag / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    topics = {each['topic_metadata']['name']: each for each in said['topics_with_message_count']}
    assert {name: each['message_count'] for name, each in topics.items()} == {
        '/even': 200,
        '/odd': 200,
        '/never': 0,
    }
    metadata = topics['/odd']['topic_metadata']
    assert metadata['type_description_hash'] == HASH
    assert metadata['offered_qos_profiles'][0]['durability'] == 'transient_local'
    assert said['custom_data'] == FACTS
    assert sorted(os.listdir(bag)) == ['bag_0.mcap', 'metadata.yaml']
    content = (bag / 'bag_0.mcap').read_bytes()
    assert repair_bag(bag).written == ()
    assert (bag / 'bag_0.mcap').read_bytes() == content


def test_a_copy_leaves_the_bag_as_it_is(tmp_path: Path) -> None:
    """And is a bag of its own."""
    bag = killed_bag(tmp_path / 'bag', max_file_bytes=4500)
    before = {file.name: file.read_bytes() for file in bag.iterdir()}
    assert len(before) > 3
    repair_bag(bag, tmp_path / 'new' / 'copy')
    assert {file.name: file.read_bytes() for file in bag.iterdir()} == before
    assert values(tmp_path / 'new' / 'copy') == [float(number) for number in range(400)]
    assert os.listdir(tmp_path / 'new') == ['copy']
    with pytest.raises(BagError, match='copy: expected a folder that does not exist yet'):
        repair_bag(bag, tmp_path / 'new' / 'copy')


def test_only_the_last_file_of_a_split_bag_is_written_anew(tmp_path: Path) -> None:
    """Also where metadata.yaml does not name it yet; the others stay as they are."""
    bag = killed_bag(tmp_path / 'bag', max_file_bytes=4500)
    files = sorted(bag.glob('*.mcap'), key=lambda file: int(file.stem[4:]))
    times = [file.stat().st_mtime_ns for file in files]
    lines = (bag / 'metadata.yaml').read_text().splitlines()
    (bag / 'metadata.yaml').write_text(
        '\n'.join(line for line in lines if line.strip() != f'- {files[-1].name}')
    )
    assert len(BagReader(bag).files) == len(files) - 1 > 2
    repair = repair_bag(bag)
    assert repair.written == (files[-1].name, 'metadata.yaml')
    assert repair.message_count == 400
    assert values(bag) == [float(number) for number in range(400)]
    assert [file.stat().st_mtime_ns for file in files[:-1]] == times[:-1]


@pytest.mark.parametrize(
    'spoil',
    [
        lambda bag: (bag / 'metadata.yaml').unlink(),
        lambda bag: (bag / 'metadata.yaml').write_text('[' * 10000),
        lambda bag: (bag / 'metadata.yaml').write_text(
            (bag / 'metadata.yaml').read_text().replace('identifier: mcap', 'identifier: ""')
        ),
    ],
)
def test_metadata_alone_may_be_lost(tmp_path: Path, spoil: Callable[[Path], Any]) -> None:
    """It is written anew, with the custom data that the file has, and nothing else is."""
    bag = killed_bag(tmp_path / 'bag')
    repair_bag(bag)
    spoil(bag)
    assert repair_bag(bag).written == ('metadata.yaml',)
    assert len(values(bag)) == 400
    assert BagReader(bag).custom_data == FACTS


@pytest.mark.parametrize('name', [b'rosbag2', b'reliability: reliable'])
def test_damage_in_a_summary_is_repaired(tmp_path: Path, name: bytes) -> None:
    """Some readers stumble over it though all messages are sound."""
    bag = killed_bag(tmp_path / 'bag')
    repair_bag(bag)
    content = bytearray((bag / 'bag_0.mcap').read_bytes())
    content[content.rindex(name) + 1] ^= 0x80
    (bag / 'bag_0.mcap').write_bytes(content)
    assert 'bag_0.mcap' in repair_bag(bag).written
    assert values(bag) == [float(number) for number in range(400)]


def test_qos_that_is_not_that_of_the_file_is_repaired(tmp_path: Path) -> None:
    """Without this repair rosbags silently leaves out the topic's messages."""
    bag = killed_bag(tmp_path / 'bag')
    repair_bag(bag)
    file = bag / 'metadata.yaml'
    file.write_text(file.read_text().replace('transient_local', 'volatile', 1))
    assert len(values_of_folder(bag)) == 200
    assert repair_bag(bag).written == ('metadata.yaml',)
    assert values(bag) == [float(number) for number in range(400)]


def test_damage_in_the_middle_costs_its_chunk(tmp_path: Path) -> None:
    """And how many messages are left is said."""
    bag = killed_bag(tmp_path / 'bag')
    content = bytearray((bag / 'bag_0.mcap').read_bytes())
    frame = content.index(b'\x28\xb5\x2f\xfd', len(content) // 2)  # of a chunk
    content[frame + 9] ^= 0xFF
    (bag / 'bag_0.mcap').write_bytes(content)
    repair = repair_bag(bag)
    assert 0 < repair.message_count < 400
    left = f'{repair.message_count} messages are left of the 400 that metadata.yaml counts'
    assert left in repair.notes
    assert len(values(bag)) == repair.message_count


def test_wherever_a_file_is_cut_it_is_repaired(tmp_path: Path) -> None:
    """Also to nothing at all."""
    whole = killed_bag(tmp_path / 'whole')
    content = (whole / 'whole_0.mcap').read_bytes()
    rng = np.random.default_rng(3)
    for length in (0, 5, 8, 60, *rng.integers(0, len(content), 12)):
        bag = tmp_path / f'bag{length}'
        shutil.copytree(whole, bag)
        (bag / 'whole_0.mcap').write_bytes(content[:length])
        count = len(list(BagReader(bag).messages()))
        assert repair_bag(bag).message_count == count
        assert values(bag) == [float(number) for number in range(count)]


@pytest.mark.parametrize('name', ['bag_none', 'bag_zstd'])
def test_bags_of_the_official_recorder_are_repaired(tmp_path: Path, name: str) -> None:
    """Sound ones are left alone; a cut one keeps its topics with QoS and hashes."""
    bag = tmp_path / name
    shutil.copytree(DATA / name, bag)
    assert repair_bag(bag).written == ()
    reader = BagReader(bag)
    counts = Counter(each.topic for each in reader.messages())
    file = bag / f'{name}_0.mcap'
    file.write_bytes(file.read_bytes()[:-300])
    assert repair_bag(bag).message_count == sum(counts.values())
    with Reader(bag) as opened:  # AnyReader cannot parse the definitions of these bags
        assert {each.topic: each.msgcount for each in opened.connections} == counts
    again = BagReader(bag)
    assert Counter(each.topic for each in again.messages()) == counts
    assert again.topics == reader.topics


def test_one_file_alone_can_be_repaired(tmp_path: Path) -> None:
    """Its folder's metadata.yaml stays as it is."""
    bag = killed_bag(tmp_path / 'bag')
    said = (bag / 'metadata.yaml').read_text()
    assert repair_bag(bag / 'bag_0.mcap').written == ('bag_0.mcap',)
    assert (bag / 'metadata.yaml').read_text() == said
    assert len(values(bag)) == 400


def test_a_bag_that_is_being_recorded_is_left_alone(tmp_path: Path) -> None:
    """The recorder would write into a file that is gone."""
    with BagWriter(tmp_path / 'bag') as writer:
        topic = writer.add_topic('/x', 'std_msgs/msg/Float64', 'float64 data\n')
        writer.write(topic, 0, 0, b'1234')
        with pytest.raises(BagError, match=r'bag_0\.mcap: is being recorded; stop the recorder'):
            repair_bag(tmp_path / 'bag')
    assert repair_bag(tmp_path / 'bag').written == ()


def test_sequence_numbers_and_metadata_of_others_are_kept(tmp_path: Path) -> None:
    """Attachments are not, which is said."""
    file = tmp_path / 'a_0.mcap'
    with file.open('wb') as stream:
        writer = Writer(stream)
        writer.start(profile='ros2')
        writer.add_metadata('calibration', {'fx': '1.5'})
        writer.add_attachment(1, 1, 'a.txt', 'text/plain', b'text')
        schema = writer.register_schema('std_msgs/msg/Float64', 'ros2msg', b'float64 data')
        channel = writer.register_channel('/x', 'cdr', schema, {'own': 'fact'})
        writer.add_message(channel, log_time=1, publish_time=0, data=b'1234', sequence=9)
        writer.finish()  # type: ignore[no-untyped-call]
    file.write_bytes(file.read_bytes()[:-40])
    assert 'a_0.mcap: its 1 attachments are not kept' in repair_bag(file).notes
    with file.open('rb') as stream:
        reader = make_reader(stream)
        ((_, of_message, message),) = reader.iter_messages()
        assert (message.sequence, of_message.metadata) == (9, {'own': 'fact'})
        names = {each.name: each.metadata for each in reader.iter_metadata()}
    assert names['calibration'] == {'fx': '1.5'}


def test_other_bags_are_refused_with_what_repairs_them(tmp_path: Path) -> None:
    """SQLite, whole files compressed, and what is no bag."""
    with pytest.raises(BagError, match=r'got sqlite3: `ros2 bag reindex -s sqlite3` repairs'):
        repair_bag(DATA / 'odd_bags/35_db3_message_compressed_no_metadata')
    (tmp_path / 'a.mcap').write_bytes(b'no MCAP file')
    with pytest.raises(BagError, match=r"expected an MCAP file, got one that begins with b'no MC"):
        repair_bag(tmp_path / 'a.mcap')
    with pytest.raises(BagError, match='found nothing'):
        repair_bag(tmp_path / 'nothing')


def test_a_full_disk_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bag is as it was."""
    bag = killed_bag(tmp_path / 'bag')
    before = {file.name: file.read_bytes() for file in bag.iterdir()}

    def refuse(fd: int, data: bytes) -> int:
        raise OSError(28, 'No space left on device')

    with monkeypatch.context() as patch:
        patch.setattr(os, 'write', refuse)
        with pytest.raises(BagError, match='cannot be repaired: No space left on device'):
            repair_bag(bag)
    assert {file.name: file.read_bytes() for file in bag.iterdir()} == before


def test_the_command_says_how_many_messages_were_saved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And, the second time, that there is nothing to repair; replay names the command."""
    bag = killed_bag(tmp_path / 'bag')
    assert run(['repair', str(bag)]) == 0
    saved = f'{bag}: 400 messages saved; rewritten files: bag_0.mcap, metadata.yaml\n'
    assert capsys.readouterr().out.startswith(saved)
    assert run(['repair', str(bag)]) == 0
    assert capsys.readouterr().out == f'{bag}: nothing to repair, 400 messages\n'
    assert run(['repair', str(bag), '--json']) == 0
    assert json.loads(capsys.readouterr().out) == {
        'path': str(bag),
        'message_count': 400,
        'written': [],
        'notes': [],
    }
    assert run(['repair', str(tmp_path / 'nothing')]) == 1
    assert capsys.readouterr().err.count('\n') == 1


def test_replay_of_a_cut_bag_names_the_command(tmp_path: Path) -> None:
    """In a note."""
    content = (DATA / 'odd_bags/00_plain/bag.mcap').read_bytes()
    (tmp_path / 'bag.mcap').write_bytes(content[:-500])
    notes = RecordedDrive(tmp_path / 'bag.mcap').notes
    assert '`spikelane repair` makes such a bag whole for other programs' in notes


def test_a_damaged_repetition_of_a_channel_costs_no_message(tmp_path: Path) -> None:
    """Its QoS in the summary differs from that in the chunk; rosbags leaves such a topic out."""
    bag = Path(shutil.copytree(DATA / 'bag_none', tmp_path / 'bag'))
    (file,) = bag.glob('*.mcap')
    before, damaged, after = file.read_bytes().rpartition(b'durability: volatile')
    file.write_bytes(before + damaged.replace(b'volatile', b'volatife') + after)
    assert repair_bag(bag).message_count == 197
    with Reader(bag) as reader:
        assert sum(1 for _ in reader.messages()) == 197
