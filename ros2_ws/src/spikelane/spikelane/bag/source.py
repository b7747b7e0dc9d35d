"""The messages of any bag that rosbag2 or Spikelane wrote, read into fields without ROS.

MCAP is read by `BagReader`, which finds what is there of cut and damaged files; SQLite, and what
rosbag2 itself compressed, by rosbags. Types that we know are read by our own definitions unless
the bag's are others: `ros2 bag record` may write definitions in IDL that rosbags cannot parse, and
old SQLite bags have none.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
import contextlib
import functools
from pathlib import Path
from typing import Any, NamedTuple

from spikelane.bag.metadata import FILE_NAME, read_metadata, StoredMetadata
from spikelane.bag.reader import BagReader
from spikelane_sim.errors import BagError

#: Fields of the types that we read, as in their .msg files.
DEFINITIONS = {
    'event_camera_msgs/msg/EventPacket': (
        'std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\n'
        'string encoding\nbool is_bigendian\nuint8[] events\n'
    ),
    'spikelane_msgs/msg/LaneState': (
        'std_msgs/Header header\nstring lane\nfloat64 distance\nfloat64 heading_error\n'
        'float64 position\nstring section\nfloat64 progress\nuint32 laps\nuint32 episode\n'
        'uint32 step\nbool terminated\nstring reason\n'
    ),
    'spikelane_msgs/msg/WheelVelocities': (
        'std_msgs/Header header\nfloat64 left\nfloat64 right\n'
    ),
}


class SourceMessage(NamedTuple):
    """A message as it was recorded."""

    topic: str
    type_name: str
    log_ns: int
    data: bytes


class BagSource:
    """Reads a bag's folder, or one of its .mcap or .db3 files.

    Attributes:
        path: What was opened.
        damage: What could not be read, one sentence each; complete after `messages` has ended.
        topics: Type names by topic; complete after `messages` has ended.
    """

    def __init__(self, path: Path) -> None:
        """Find the bag's files.

        Raises:
            BagError: There is no bag, or one of another storage.
        """
        self.path = Path(path)
        self.damage: list[str] = []
        self.topics: dict[str, str] = {}
        self._texts: dict[str, str] = {}  # definitions in the bag, by type
        self._reader: BagReader | None = None
        self._databases: list[Path] = []
        metadata = _metadata(self.path)
        self._custom_data = metadata.custom_data if metadata else {}
        if _is_for_rosbags(self.path, metadata):
            self._databases = [self.path]
        elif self.path.is_dir() and not metadata and not any(self.path.glob('*.mcap')):
            # A recorder that was killed leaves no metadata.
            self._databases = sorted(self.path.glob('*.db3'))
        if not self._databases:
            self._reader = BagReader(self.path)

    @property
    def custom_data(self) -> dict[str, str]:
        """The facts about the run that the recorder was given; complete after `messages`."""
        return self._reader.custom_data if self._reader else dict(self._custom_data)

    def messages(self, types: Collection[str]) -> Iterator[SourceMessage]:
        """Yield the messages of these types that can be read, in the order they were recorded."""
        self.damage = []
        if self._reader is not None:
            yield from self._mcap_messages(self._reader, types)
            return
        for database in self._databases:
            try:
                yield from self._database_messages(database, types)
            # What rosbags raises for a damaged file is not ours to list.
            except Exception as error:
                reason = ' '.join(str(error).split()) or type(error).__name__
                self.damage.append(f'{database.name}: cannot be read any further: {reason}')

    def read(self, message: SourceMessage) -> Any:
        """Return the fields of a message.

        Raises:
            BagError: Its bytes are not those of its type.
        """
        store = _typestore(message.type_name, self._texts.get(message.type_name, ''))
        try:
            return store.deserialize_cdr(message.data, message.type_name)
        except Exception as error:  # rosbags has no common base for what damaged bytes raise
            raise BagError(
                f'{self.path}: {message.topic}: expected a {message.type_name}, got bytes that '
                f'cannot be read: {error}'
            ) from None

    def _mcap_messages(self, reader: BagReader, types: Collection[str]) -> Iterator[SourceMessage]:
        for message in reader.messages():
            if message.topic not in self.topics:
                self._declare(reader)
            if message.type_name in types:
                yield SourceMessage(
                    message.topic, message.type_name, message.log_time_ns, message.data
                )
        self._declare(reader)
        self.damage = list(reader.damage)

    def _declare(self, reader: BagReader) -> None:
        for topic in reader.topics.values():
            self.topics[topic.name] = topic.type_name
            if topic.schema_encoding == 'ros2msg':
                self._texts[topic.type_name] = topic.schema_text

    def _database_messages(
        self, database: Path, types: Collection[str]
    ) -> Iterator[SourceMessage]:
        from rosbags.interfaces import MessageDefinitionFormat
        from rosbags.rosbag2 import Reader

        with Reader(database) as reader:
            for connection in reader.connections:
                self.topics[connection.topic] = connection.msgtype
                if connection.msgdef.format == MessageDefinitionFormat.MSG:
                    self._texts[connection.msgtype] = connection.msgdef.data
            wanted = [each for each in reader.connections if each.msgtype in types]
            if not wanted:  # for rosbags, no choice is all
                return
            for connection, log_ns, data in reader.messages(connections=wanted):
                yield SourceMessage(connection.topic, connection.msgtype, log_ns, bytes(data))


def _metadata(path: Path) -> StoredMetadata | None:
    file = path / FILE_NAME
    return read_metadata(file) if path.is_dir() and file.exists() else None


def _is_for_rosbags(path: Path, metadata: StoredMetadata | None) -> bool:
    if metadata is None:
        return path.is_file() and path.suffix == '.db3'
    return metadata.storage == 'sqlite3' or bool(metadata.compression_mode)


@functools.cache
def _typestore(type_name: str, text: str) -> Any:
    """Return types to read a type by: the bag's text where it has other fields, else ours."""
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores

    store = get_typestore(Stores.ROS2_JAZZY)
    ours = get_types_from_msg(DEFINITIONS[type_name], type_name)
    if text:
        # A text that cannot be parsed is as good as none.
        with contextlib.suppress(Exception):
            theirs = get_types_from_msg(text, type_name)
            if _fields(theirs[type_name]) != _fields(ours[type_name]):
                own = {name: each for name, each in theirs.items() if name == type_name}
                store.register(own)
                return store
    store.register(ours)
    return store


def _fields(definition: Any) -> Any:
    """Return names and types of a definition's fields, without its constants."""
    return definition[1]
