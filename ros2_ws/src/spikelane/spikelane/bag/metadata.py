"""The text that rosbag2 keeps next to and inside its files: metadata.yaml and QoS profiles.

The layout (keys, order, indentation) is that of rosbag2 0.26 (Jazzy), metadata version 9.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import itertools
import json
from pathlib import Path
import re
from typing import Any, NamedTuple

from spikelane_sim.errors import BagError
from spikelane_sim.parsing import parse_yaml, ParseError

FILE_NAME = 'metadata.yaml'
# What rosbag2 writes as the starting time of a bag without a message.
NO_TIME_NS = 2**63 - 1
#: The newest version of metadata.yaml that is known.
NEWEST_VERSION = 9

_TOP_KEY = 'rosbag2_bagfile_information'
_TEXT_LIMIT = 1 << 25

_PLAIN = re.compile(r'[A-Za-z_/][A-Za-z0-9_/.\-]*')
_RESERVED = {'true', 'false', 'yes', 'no', 'on', 'off', 'y', 'n', 'null'}


class QosDuration(NamedTuple):
    """A duration as QoS profiles write it; the default is rosbag2's infinity."""

    sec: int = 9223372036
    nsec: int = 854775807

    @classmethod
    def from_nanoseconds(cls, nanoseconds: int) -> QosDuration:
        """Return the duration, which for the largest number is the infinite one."""
        return cls(*divmod(nanoseconds, 10**9))


class QosProfile(NamedTuple):
    """What a publisher offers, in rosbag2's words; discovery does not tell history and depth."""

    history: str = 'unknown'
    depth: int = 0
    reliability: str = 'reliable'
    durability: str = 'volatile'
    deadline: QosDuration = QosDuration()
    lifespan: QosDuration = QosDuration()
    liveliness: str = 'automatic'
    liveliness_lease_duration: QosDuration = QosDuration()
    avoid_ros_namespace_conventions: bool = False

    @property
    def is_latched(self) -> bool:
        """Whether a late subscriber gets the last messages, however old."""
        return self.durability == 'transient_local' and self.lifespan == QosDuration()


class TopicRecord(NamedTuple):
    """A recorded topic as metadata.yaml describes it."""

    name: str
    type_name: str
    type_hash: str
    qos: tuple[QosProfile, ...]
    message_count: int


class FileRecord(NamedTuple):
    """A file of a bag; `start_ns` is None as long as it has no message."""

    path: str
    start_ns: int | None
    end_ns: int
    message_count: int


class BagMetadata(NamedTuple):
    """All that metadata.yaml says."""

    topics: tuple[TopicRecord, ...]
    files: tuple[FileRecord, ...]
    custom_data: Mapping[str, str]
    ros_distro: str = 'jazzy'

    def to_text(self) -> str:
        """Return rosbag2's YAML without its top key, as it stands in the `rosbag2` record."""
        return '\n'.join(self._lines())

    def to_file_text(self) -> str:
        """Return the text of metadata.yaml."""
        lines = ['rosbag2_bagfile_information:', *_indented(self._lines(), '  ')]
        return '\n'.join(lines)

    def _lines(self) -> list[str]:
        starts = [file.start_ns for file in self.files if file.start_ns is not None]
        start_ns = min(starts, default=None)
        end_ns = max((file.end_ns for file in self.files if file.start_ns is not None), default=0)
        return [
            'version: 9',
            'storage_identifier: mcap',
            *_span_lines(start_ns, end_ns, duration_first=True),
            f'message_count: {sum(file.message_count for file in self.files)}',
            'topics_with_message_count:',
            *(_indented(_list_lines(map(_topic_lines, self.topics)), '  ') or ['  []']),
            'compression_format: ""',
            'compression_mode: ""',
            'relative_file_paths:',
            *[f'  - {_scalar(file.path)}' for file in self.files],
            'files:',
            *_indented(_list_lines(map(_file_lines, self.files)), '  '),
            *_custom_data_lines(self.custom_data),
            f'ros_distro: {_scalar(self.ros_distro)}',
        ]


class StoredMetadata(NamedTuple):
    """What a reader needs from a metadata.yaml of any version."""

    storage: str  # '' where it does not say
    file_names: tuple[str, ...]
    message_count: int
    custom_data: dict[str, str]
    compression_mode: str = ''  # file or message, of rosbag2 itself; '' where MCAP compresses
    version: int = 0  # 0 where it does not say
    ros_distro: str = ''


def qos_text(profiles: Sequence[QosProfile]) -> str:
    """Return the YAML list that an MCAP channel carries as `offered_qos_profiles`."""
    return '\n'.join(_qos_list_lines(profiles)) or '[]'


def parse_qos(text: str, where: str) -> tuple[QosProfile, ...]:
    """Read the profiles that an MCAP channel carries, also in the numbers of older versions.

    Raises:
        BagError: They cannot be read.
    """
    from rosbags.rosbag2.metadata import parse_qos as parse_profiles

    content = _load(text, where)
    try:
        profiles = parse_profiles(content or [])
        for each in profiles:
            times = each.deadline, each.lifespan, each.liveliness_lease_duration
            if not all(type(number) is int for number in (each.depth, *itertools.chain(*times))):
                raise TypeError('a depth or duration that is no whole number')
            if type(each.avoid_ros_namespace_conventions) is not bool:
                raise TypeError('a convention that is neither true nor false')
        return tuple(
            QosProfile(
                history=each.history.name.lower(),
                depth=each.depth,
                reliability=each.reliability.name.lower(),
                durability=each.durability.name.lower(),
                deadline=QosDuration(*each.deadline),
                lifespan=QosDuration(*each.lifespan),
                liveliness=each.liveliness.name.lower(),
                liveliness_lease_duration=QosDuration(*each.liveliness_lease_duration),
                avoid_ros_namespace_conventions=each.avoid_ros_namespace_conventions,
            )
            for each in profiles
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BagError(f'{where}: expected QoS profiles, got others: {error}') from None


def read_metadata(path: Path) -> StoredMetadata:
    """Read a metadata.yaml that rosbag2 (any version since Foxy), rosbags or we wrote.

    Raises:
        BagError: The file cannot be read or is no bag's metadata.
    """
    try:
        with path.open('rb') as file:
            text = file.read(_TEXT_LIMIT + 1).decode()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'it is no text'
        raise BagError(f'{path}: cannot be read: {reason}') from None
    content = _load(text, str(path))
    if not isinstance(content, dict) or _TOP_KEY not in content:
        got = text.lstrip().partition('\n')[0][:80] or 'nothing'
        raise BagError(f'{path}: expected {_TOP_KEY}: at its top, got {got!r}')
    return _stored(content[_TOP_KEY], str(path))


def parse_metadata(text: str, where: str) -> StoredMetadata:
    """Read the same without its top key, as the `rosbag2` record of an .mcap file has it.

    Args:
        text: The YAML.
        where: Named in front of an error.

    Raises:
        BagError: It is no bag's metadata.
    """
    return _stored(_load(text, where), where)


def _stored(information: Any, where: str) -> StoredMetadata:
    try:
        names = information['relative_file_paths'] or []
        if not isinstance(names, list):
            raise TypeError(f'relative_file_paths: {names!r:.80}')
        return StoredMetadata(
            storage=str(information['storage_identifier'] or ''),
            file_names=tuple(str(name) for name in names),
            message_count=int(information.get('message_count', 0)),
            custom_data=_texts(information.get('custom_data') or {}),
            compression_mode=_mode(information.get('compression_mode')),
            version=int(information.get('version') or 0),
            ros_distro=str(information.get('ros_distro') or ''),
        )
    except KeyError as error:
        raise _no_metadata(where, f'none of {error}') from None
    except (TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise _no_metadata(where, str(error)) from None


def _load(text: str, where: str) -> Any:
    if len(text) > _TEXT_LIMIT:
        raise _no_metadata(where, f'more than {_TEXT_LIMIT} bytes')
    try:
        return parse_yaml(text)
    except ParseError as error:
        line = '' if error.line is None else f', line {error.line}'
        raise _no_metadata(where, f'{error}{line}') from None


def _no_metadata(where: str, got: str) -> BagError:
    return BagError(f'{where}: expected the metadata of a rosbag2 bag, got: {got}')


def _mode(mode: object) -> str:
    text = str(mode or '').lower()
    return '' if text == 'none' else text


def _texts(mapping: Mapping[Any, Any]) -> dict[str, str]:
    return {str(key): str(value) for key, value in mapping.items()}


def _span_lines(start_ns: int | None, end_ns: int, *, duration_first: bool) -> list[str]:
    duration_ns = 0 if start_ns is None else end_ns - start_ns
    duration = ['duration:', f'  nanoseconds: {duration_ns}']
    start_text = NO_TIME_NS if start_ns is None else start_ns
    start = ['starting_time:', f'  nanoseconds_since_epoch: {start_text}']
    return duration + start if duration_first else start + duration


def _topic_lines(topic: TopicRecord) -> list[str]:
    profiles = _qos_list_lines(topic.qos) or ['[]']
    return [
        'topic_metadata:',
        f'  name: {_scalar(topic.name)}',
        f'  type: {_scalar(topic.type_name)}',
        '  serialization_format: cdr',
        '  offered_qos_profiles:',
        *_indented(profiles, '    '),
        f'  type_description_hash: {_scalar(topic.type_hash)}',
        f'message_count: {topic.message_count}',
    ]


def _file_lines(file: FileRecord) -> list[str]:
    return [
        f'path: {_scalar(file.path)}',
        *_span_lines(file.start_ns, file.end_ns, duration_first=False),
        f'message_count: {file.message_count}',
    ]


def _custom_data_lines(custom_data: Mapping[str, str]) -> list[str]:
    if not custom_data:
        return ['custom_data: ~']
    # Values are quoted, so that every reader takes `seed: "7"` for a text.
    lines = [f'  {_scalar(key)}: {json.dumps(value)}' for key, value in custom_data.items()]
    return ['custom_data:', *lines]


def _qos_list_lines(profiles: Sequence[QosProfile]) -> list[str]:
    return _list_lines(map(_qos_lines, profiles))


def _qos_lines(profile: QosProfile) -> list[str]:
    lines = []
    for name, value in profile._asdict().items():
        if isinstance(value, QosDuration):
            lines += [f'{name}:', f'  sec: {value.sec}', f'  nsec: {value.nsec}']
        else:
            lines.append(f'{name}: {str(value).lower()}')
    return lines


def _list_lines(items: Any) -> list[str]:
    lines = []
    for first, *rest in items:
        lines += [f'- {first}', *_indented(rest, '  ')]
    return lines


def _indented(lines: Sequence[str], indent: str) -> list[str]:
    return [indent + line for line in lines]


def _scalar(text: str) -> str:
    """Return the text as YAML that every reader takes for this text."""
    is_plain = _PLAIN.fullmatch(text) and text.lower() not in _RESERVED
    return text if is_plain else json.dumps(text)
