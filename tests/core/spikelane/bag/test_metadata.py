"""metadata.yaml as rosbag2 writes it."""

from pathlib import Path

import pytest
import yaml

from spikelane.bag.metadata import (
    BagMetadata,
    FileRecord,
    qos_text,
    QosDuration,
    QosProfile,
    read_metadata,
    TopicRecord,
)
from spikelane_sim.errors import BagError

DATA = Path(__file__).parents[3] / 'data'

# The facts of the bag in tests/data/bag_none, which `ros2 bag record` made.
OFFICIAL = BagMetadata(
    topics=(
        TopicRecord(
            '/tf_static',
            'tf2_msgs/msg/TFMessage',
            'RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087',
            (QosProfile(durability='transient_local'),),
            1,
        ),
        TopicRecord(
            '/lane/distance',
            'std_msgs/msg/Float64',
            'RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a',
            (QosProfile(),),
            98,
        ),
        TopicRecord(
            '/event_camera/events',
            'event_camera_msgs/msg/EventPacket',
            'RIHS01_d6fa176260b1f37e5a40845305315e150a0f18191241eb64f407442aa29844aa',
            (QosProfile(),),
            98,
        ),
    ),
    files=(
        FileRecord('bag_none_0.mcap', 1795321372272372061, 1795321372272372061 + 5054446368, 197),
    ),
    custom_data={},
)


def test_the_text_is_that_of_rosbag2_to_the_letter() -> None:
    """The same facts give the same file as `ros2 bag record` wrote."""
    assert OFFICIAL.to_file_text() == (DATA / 'bag_none' / 'metadata.yaml').read_text()


def test_a_bag_without_messages_reads_as_rosbag2_begins_one() -> None:
    """This is the record that rosbag2 writes when it opens a file."""
    text = BagMetadata((), (FileRecord('bag_none_0.mcap', None, 0, 0),), {}).to_text()
    assert text == (
        'version: 9\nstorage_identifier: mcap\nduration:\n  nanoseconds: 0\nstarting_time:\n'
        '  nanoseconds_since_epoch: 9223372036854775807\nmessage_count: 0\n'
        'topics_with_message_count:\n  []\ncompression_format: ""\ncompression_mode: ""\n'
        'relative_file_paths:\n  - bag_none_0.mcap\nfiles:\n  - path: bag_none_0.mcap\n'
        '    starting_time:\n      nanoseconds_since_epoch: 9223372036854775807\n'
        '    duration:\n      nanoseconds: 0\n    message_count: 0\ncustom_data: ~\n'
        'ros_distro: jazzy'
    )


@pytest.mark.parametrize('value', ['7', 'true', '', 'a: b', "it's", '# no', 'é\n"\\'])
def test_custom_data_comes_back_as_the_texts_that_were_given(tmp_path: Path, value: str) -> None:
    """Numbers and punctuation stay texts, for our reader and for any YAML reader."""
    metadata = OFFICIAL._replace(custom_data={'seed': value, 'camera.tau': '1'})
    (tmp_path / 'metadata.yaml').write_text(metadata.to_file_text())
    expected = {'seed': value, 'camera.tau': '1'}
    assert read_metadata(tmp_path / 'metadata.yaml').custom_data == expected
    block = yaml.safe_load(metadata.to_file_text())['rosbag2_bagfile_information']
    assert block['custom_data'] == expected


@pytest.mark.parametrize('name', ['a bag_0.mcap', '7_0.mcap', 'yes', "b'ag_0.mcap", 'läb_0.mcap'])
def test_odd_file_names_come_back(tmp_path: Path, name: str) -> None:
    """A folder's name is the user's."""
    text = BagMetadata((), (FileRecord(name, 1, 2, 1),), {}).to_file_text()
    (tmp_path / 'metadata.yaml').write_text(text)
    assert read_metadata(tmp_path / 'metadata.yaml').file_names == (name,)


def test_a_qos_profile_reads_as_in_rosbag2s_channels() -> None:
    """Finite durations and booleans included."""
    profile = QosProfile(
        history='keep_last', depth=5, deadline=QosDuration.from_nanoseconds(1_500_000_000)
    )
    assert yaml.safe_load(qos_text([profile])) == [
        {
            'history': 'keep_last',
            'depth': 5,
            'reliability': 'reliable',
            'durability': 'volatile',
            'deadline': {'sec': 1, 'nsec': 500_000_000},
            'lifespan': {'sec': 9223372036, 'nsec': 854775807},
            'liveliness': 'automatic',
            'liveliness_lease_duration': {'sec': 9223372036, 'nsec': 854775807},
            'avoid_ros_namespace_conventions': False,
        }
    ]


def test_the_longest_duration_is_the_infinite_one() -> None:
    """The middleware says infinite as the largest number of nanoseconds."""
    assert QosDuration.from_nanoseconds(2**63 - 1) == QosDuration()


@pytest.mark.parametrize(
    'text', ['', 'a: 1', 'rosbag2_bagfile_information:\n  version: 9', ': :\n\t', '[]']
)
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    """One sentence that names the file."""
    (tmp_path / 'metadata.yaml').write_text(text)
    with pytest.raises(BagError, match=r'metadata\.yaml'):
        read_metadata(tmp_path / 'metadata.yaml')
