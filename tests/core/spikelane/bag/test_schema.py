"""Definitions of messages as bags carry them."""

from collections.abc import Callable
from pathlib import Path

import pytest

from spikelane.bag.schema import collect_schema, Schema

LINE = '=' * 80


@pytest.fixture
def share_of(tmp_path: Path) -> Callable[[str], Path]:
    """Give the share folder of packages that a test has written."""

    def share(package: str) -> Path:
        if not (tmp_path / package).is_dir():
            raise LookupError(package)
        return tmp_path / package

    return share


def install(root: Path, type_name: str, text: str, suffix: str = 'msg') -> None:
    """Write a definition where an installed package has it."""
    package, name = type_name.split('/')
    path = root / package / 'msg' / f'{name}.{suffix}'
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_dependencies_follow_once_depth_first_in_alphabetical_order(
    tmp_path: Path, share_of: Callable[[str], Path]
) -> None:
    """As rosbag2 wrote for tf2_msgs/msg/TFMessage."""
    install(tmp_path, 'tf2_msgs/TFMessage', 'geometry_msgs/TransformStamped[] transforms\n')
    stamped = '# Header here\nstd_msgs/Header header\nstring child\nTransform transform # Pose p\n'
    install(tmp_path, 'geometry_msgs/TransformStamped', stamped)
    install(tmp_path, 'geometry_msgs/Transform', 'Vector3 translation\nQuaternion rotation\n')
    install(tmp_path, 'geometry_msgs/Vector3', 'float64 x\n')
    install(tmp_path, 'geometry_msgs/Quaternion', 'float64 x 0\n')
    install(tmp_path, 'std_msgs/Header', 'builtin_interfaces/Time stamp\nstring frame_id\n')
    install(tmp_path, 'builtin_interfaces/Time', 'int32 sec\nuint32 nanosec\n')
    expected = (
        'geometry_msgs/TransformStamped[] transforms\n'
        f'\n{LINE}\nMSG: geometry_msgs/TransformStamped\n{stamped}'
        f'\n{LINE}\nMSG: geometry_msgs/Transform\nVector3 translation\nQuaternion rotation\n'
        f'\n{LINE}\nMSG: geometry_msgs/Quaternion\nfloat64 x 0\n'
        f'\n{LINE}\nMSG: geometry_msgs/Vector3\nfloat64 x\n'
        f'\n{LINE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n'
        f'\n{LINE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n'
    )
    assert collect_schema('tf2_msgs/msg/TFMessage', share_of) == Schema('ros2msg', expected)


def test_constants_bounds_and_arrays_are_no_types(
    tmp_path: Path, share_of: Callable[[str], Path]
) -> None:
    """Only Part is a dependency here."""
    text = (
        'uint8 HIGH=10\nstring NAME="a Part b"\nstring<=5 name\nstring<=5[<=3] names\n'
        'byte[4] raw\nPart[<=3] parts\nother_msgs/Part part\nfloat32[] xs [1.0, 2.0]\n'
    )
    install(tmp_path, 'some_msgs/Whole', text)
    install(tmp_path, 'some_msgs/Part', 'bool b\n')
    install(tmp_path, 'other_msgs/Part', 'char c\n')
    _, found = collect_schema('some_msgs/msg/Whole', share_of)
    headings = [line for line in found.splitlines() if line.startswith('MSG: ')]
    assert headings == ['MSG: other_msgs/Part', 'MSG: some_msgs/Part']


def test_a_type_that_contains_itself_ends(tmp_path: Path, share_of: Callable[[str], Path]) -> None:
    """No interface generator allows it, but files can say it."""
    install(tmp_path, 'some_msgs/Loop', 'Loop[] loops\n')
    assert collect_schema('some_msgs/msg/Loop', share_of).text == 'Loop[] loops\n'


def test_idl_stands_in_where_no_msg_file_is_installed(
    tmp_path: Path, share_of: Callable[[str], Path]
) -> None:
    """As rosbag2 wrote for event_camera_msgs: a heading over the root too."""
    install(tmp_path, 'a_msgs/Root', '#include "b_msgs/msg/Leaf.idl"\nroot\n', 'idl')
    install(tmp_path, 'b_msgs/Leaf', 'leaf\n', 'idl')
    assert collect_schema('a_msgs/msg/Root', share_of) == Schema(
        'ros2idl',
        f'{LINE}\nIDL: a_msgs/msg/Root\n#include "b_msgs/msg/Leaf.idl"\nroot\n'
        f'\n{LINE}\nIDL: b_msgs/msg/Leaf\nleaf\n',
    )


@pytest.mark.parametrize('name', ['no_msgs/msg/Type', 'Type', 'a/srv/Type_Request', ''])
def test_what_is_not_installed_has_an_empty_definition(
    share_of: Callable[[str], Path], name: str
) -> None:
    """As rosbag2 records it."""
    assert collect_schema(name, share_of) == Schema('', '')
