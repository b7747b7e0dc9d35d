"""The definitions that bags are read by are those of the message files."""

from pathlib import Path

import pytest
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

from spikelane.bag.source import BagSource, DEFINITIONS, SourceMessage
from spikelane_sim.errors import BagError

MSGS = Path(__file__).parents[4] / 'msgs'


@pytest.mark.parametrize('name', DEFINITIONS)
def test_definitions_are_those_of_the_message_files(name: str) -> None:
    """Fields and types in order; constants are not needed to read."""
    # The older type name had the fields of the newer one.
    recent = name.replace('event_array_msgs/msg/EventArray', 'event_camera_msgs/msg/EventPacket')
    package, _, stem = recent.split('/')
    file = MSGS / package / 'msg' / f'{stem}.msg'
    if file.exists():
        expected = get_types_from_msg(file.read_text(), name)[name][1]
    else:  # of ROS itself
        expected = get_typestore(Stores.ROS2_JAZZY).fielddefs[name][1]
    assert get_types_from_msg(DEFINITIONS[name], name)[name][1] == expected


def test_a_bags_own_definition_wins(drives, tmp_path: Path) -> None:
    """The recorded type had a different field at that time."""
    kind = 'spikelane_msgs/msg/WheelVelocities'
    data = bytes(
        drives.types.serialize_cdr(
            drives.types.types[kind](drives.header(5 * 10**9 + 7), 1.5, 2.5), kind
        )
    )
    source = BagSource(drives.write(tmp_path / 'bag', []))
    message = SourceMessage('/wheels', kind, 0, data)
    assert (source.read(message).left, source.read(message).right) == (1.5, 2.5)
    source._texts[kind] = 'std_msgs/Header header\nfloat64 middle\nfloat64 last\n'
    assert source.read(message).middle == 1.5


def test_bytes_of_another_type_are_one_sentence(drives, tmp_path: Path) -> None:
    """With the topic."""
    source = BagSource(drives.write(tmp_path / 'bag', []))
    message = SourceMessage('/wheels', 'spikelane_msgs/msg/WheelVelocities', 0, b'\0\1\0\0\1')
    with pytest.raises(BagError, match=r'/wheels: expected a .*WheelVelocities, got bytes'):
        source.read(message)
