"""The messages of any bag that rosbag2 or Spikelane wrote, read into fields without ROS.

MCAP is read by `BagReader`, which finds what is there of cut and damaged files, SQLite by rosbags.
What rosbag2 itself compressed, whole files or messages, is decompressed within limits. Types that
we know are read by our own definitions unless the bag's are others: `ros2 bag record` may write
definitions in IDL that rosbags cannot parse, and old SQLite bags have none.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
import contextlib
import functools
from pathlib import Path
from typing import Any, NamedTuple
import urllib.parse

import zstandard

from spikelane.bag.decompression import Budget, PIECE_LIMIT, ZSTD_MAGIC
from spikelane.bag.reader import BagReader
from spikelane.bag.storage import locate
from spikelane_sim.errors import BagError, one_line

_EVENT_PACKET = (
    'std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\n'
    'string encoding\nbool is_bigendian\nuint8[] events\n'
)
#: Fields of the types that we read, as in their .msg files.
DEFINITIONS = {
    'event_camera_msgs/msg/EventPacket': _EVENT_PACKET,
    'event_array_msgs/msg/EventArray': _EVENT_PACKET,  # its name until 2023
    'spikelane_msgs/msg/LaneState': (
        'std_msgs/Header header\nstring lane\nfloat64 distance\nfloat64 heading_error\n'
        'float64 position\nstring section\nfloat64 progress\nuint32 laps\nuint32 episode\n'
        'uint32 step\nbool terminated\nstring reason\n'
    ),
    'sensor_msgs/msg/JointState': (
        'std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n'
        'float64[] effort\n'
    ),
    'spikelane_msgs/msg/ControllerState': (
        'std_msgs/Header header\nstring controller\nuint32 episode\nuint32 step\nint32 action\n'
        'float64 reward\nstring[] neurons\nuint32[] spikes\nbool learning\n'
    ),
    'spikelane_msgs/msg/Weights': (
        'std_msgs/Header header\nstring name\nuint32[] shape\nstring unit\nfloat32[] data\n'
    ),
    'spikelane_msgs/msg/WheelVelocities': (
        'std_msgs/Header header\nfloat64 left\nfloat64 right\n'
    ),
    'rcl_interfaces/msg/ParameterEvent': (
        'builtin_interfaces/Time stamp\nstring node\n'
        'rcl_interfaces/Parameter[] new_parameters\n'
        'rcl_interfaces/Parameter[] changed_parameters\n'
        'rcl_interfaces/Parameter[] deleted_parameters\n'
    ),
}

_TEXT_LIMIT = 1 << 20  # letters of a definition, or of all QoS profiles


class SourceMessage(NamedTuple):
    """A message as it was recorded."""

    topic: str
    type_name: str
    log_ns: int
    data: bytes


class Faults:
    """Counts what is wrong with the messages of each topic, and keeps the first reason.

    Attributes:
        count: Number of faults of all topics.
    """

    def __init__(self) -> None:
        self.count = 0
        self._found: dict[str, tuple[int, str]] = {}

    def add(self, topic: str, reason: str) -> None:
        """Count one."""
        count, first = self._found.get(topic, (0, reason))
        self._found[topic] = count + 1, first
        self.count += 1

    def notes(self, what: str) -> list[str]:
        """Return a sentence for each topic."""
        return [
            one_line(f'{topic}: {count} {what}: {" ".join(reason.split())}')
            for topic, (count, reason) in self._found.items()
        ]


class BagSource:
    """Reads a bag's folder, or one of its .mcap or .db3 files.

    Attributes:
        path: What was opened.
        notes: What is odd about the bag's files, one sentence each.
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
        self._located = located = locate(self.path)
        self.notes = list(located.notes)
        self._reader = BagReader(self.path, located) if located.storage == 'mcap' else None

    @property
    def custom_data(self) -> dict[str, str]:
        """The facts about the run that the recorder was given; complete after `messages`."""
        if self._reader is not None:
            return self._reader.custom_data
        metadata = self._located.metadata
        return dict(metadata.custom_data) if metadata else {}

    @property
    def is_cut(self) -> bool:
        """Whether an MCAP file lacks its end, as after a kill; known after `messages`."""
        return self._reader is not None and self._reader.is_cut

    def messages(self, types: Collection[str]) -> Iterator[SourceMessage]:
        """Yield the messages of these types that can be read, in the order they were recorded."""
        self.damage = []
        faults = Faults()
        budget = Budget(sum(file.path.stat().st_size for file in self._located.files))
        for message in self._stored_messages(types):
            if not message.data.startswith(ZSTD_MAGIC):  # as CDR never does
                yield message
                continue
            try:
                yield message._replace(data=budget.decompress(message.data, 'zstd'))
            except (zstandard.ZstdError, ValueError, MemoryError) as error:
                faults.add(message.topic, str(error))
        self.damage += faults.notes('messages cannot be decompressed')

    def _stored_messages(self, types: Collection[str]) -> Iterator[SourceMessage]:
        if self._reader is not None:
            yield from self._mcap_messages(self._reader, types)
            return
        for file in self._located.files:
            try:
                with file.opened() as (content, damage):
                    self.damage += damage
                    yield from self._database_messages(content, types)
            # What rosbags raises for a damaged file is not ours to list.
            except Exception as error:
                reason = one_line(' '.join(str(error).split())) or type(error).__name__
                self.damage.append(f'{file.path.name}: cannot be read any further: {reason}')

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
        self.damage += reader.damage

    def _declare(self, reader: BagReader) -> None:
        for topic in reader.topics.values():
            self.topics[topic.name] = topic.type_name
            if topic.schema_encoding == 'ros2msg':
                self._texts[topic.type_name] = topic.schema_text

    def _database_messages(
        self, database: Path, types: Collection[str]
    ) -> Iterator[SourceMessage]:
        import apsw
        from rosbags.interfaces import MessageDefinitionFormat
        from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

        _refuse_long_texts(database)
        size = database.stat().st_size
        # It is put into a URI as it is.
        reader = Sqlite3Reader(Path(_quoted(database)))
        reader.open()
        with contextlib.closing(reader):
            if reader.dbconn is not None:  # no blob is larger than the file that it is in
                reader.dbconn.limit(apsw.SQLITE_LIMIT_LENGTH, min(size, PIECE_LIMIT))
            for connection in reader.connections:
                self.topics[connection.topic] = connection.msgtype
                if connection.msgdef.format == MessageDefinitionFormat.MSG:
                    self._texts[connection.msgtype] = connection.msgdef.data
            wanted = [each for each in reader.connections if each.msgtype in types]
            left = size
            for connection, log_ns, data in reader.messages(wanted):
                left -= len(data) + 1
                if left < 0:
                    raise ValueError(f'it has more messages than {size} bytes can hold')
                yield SourceMessage(connection.topic, connection.msgtype, log_ns, bytes(data))


def _quoted(path: Path) -> str:
    """Return a path as it has to stand in a URI."""
    return urllib.parse.quote(str(path.absolute()))


def _refuse_long_texts(database: Path) -> None:
    """Raise where the QoS profiles would keep rosbags, which parses them all, for minutes.

    Raises:
        ValueError: They are too long.
        apsw.Error: The database is damaged.
    """
    import apsw

    uri = f'file:{_quoted(database)}?immutable=1'
    flags = apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
    with contextlib.closing(apsw.Connection(uri, flags=flags)) as connection:
        columns = [row[1] for row in connection.execute('PRAGMA table_info(topics)')]
        if 'offered_qos_profiles' in columns:
            query = 'SELECT total(length(offered_qos_profiles)) FROM topics'
            length: Any = connection.execute(query).fetchall()[0][0]
            if length > _TEXT_LIMIT:
                limit = f'at most {_TEXT_LIMIT} are read'
                raise ValueError(f'its QoS profiles have {length:.0f} letters, {limit}')


@functools.cache
def _typestore(type_name: str, text: str) -> Any:
    """Return types to read a type by: the bag's text where it has other fields, else ours."""
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores

    store = get_typestore(Stores.ROS2_JAZZY)
    ours = get_types_from_msg(DEFINITIONS[type_name], type_name)
    if 0 < len(text) <= _TEXT_LIMIT:
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
