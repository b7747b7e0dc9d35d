"""Reading bags, also those that were cut, killed or damaged: every message that is there.

Files are read from front to back in the order they were written, which needs neither summary nor
index; what could not be read is said in `BagReader.damage`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
import re
import struct
from typing import BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream
import zstandard

from spikelane.bag.container import MAGIC
from spikelane.bag.metadata import FILE_NAME, parse_metadata, read_metadata, StoredMetadata
from spikelane_sim.errors import BagError

# No writer makes larger chunks; a damaged size must not take all memory.
_CHUNK_LIMIT = 1 << 30
_RECORD_HEAD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<HIQQ')
_FOOTER_SIZE = 29 + len(MAGIC)
# What the decoders raise for damaged bytes.
_PARSE_ERRORS = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    RuntimeError,
    MemoryError,
)


class BagTopic(NamedTuple):
    """A topic as the file declares it."""

    name: str
    type_name: str
    schema_encoding: str
    schema_text: str
    type_hash: str
    offered_qos_profiles: str


class BagMessage(NamedTuple):
    """One recorded message; `data` is CDR with its four-byte header."""

    topic: str
    type_name: str
    log_time_ns: int
    publish_time_ns: int
    data: bytes


class BagReader:
    """Reads a bag's folder or one of its .mcap files.

    Attributes:
        path: What was opened.
        files: The .mcap files, in order.
        metadata: What metadata.yaml says; without one, what the file itself says, known after
            `messages` has begun; None if neither does.
        topics: Topics met so far, by name; complete after `messages` has ended.
        damage: What could not be read, one sentence each; complete after `messages` has ended.
    """

    def __init__(self, path: Path) -> None:
        """Find the bag's files.

        Raises:
            BagError: There is no bag, or one of another storage.
        """
        self.path = Path(path)
        self.metadata: StoredMetadata | None = None
        self.topics: dict[str, BagTopic] = {}
        self.damage: list[str] = []
        self.files = self._find_files()

    @property
    def custom_data(self) -> dict[str, str]:
        """The facts about the run that the recorder was given."""
        return dict(self.metadata.custom_data) if self.metadata else {}

    def messages(self, topics: Collection[str] = ()) -> Iterator[BagMessage]:
        """Yield every message that can be read, in the order of the files.

        Args:
            topics: Only of these; all if empty.
        """
        self.damage = []
        for file in self.files:
            try:
                with file.open('rb') as stream:
                    yield from _FileScan(self, file, stream, frozenset(topics)).messages()
            except OSError as error:
                self.damage.append(f'{file.name}: cannot be read: {error.strerror}')

    def _find_files(self) -> list[Path]:
        if self.path.is_file():
            if self.path.suffix != '.mcap':
                raise BagError(f'{self.path}: expected an .mcap file or a bag folder')
            return [self.path]
        if not self.path.is_dir():
            raise BagError(f'{self.path}: expected an .mcap file or a bag folder, found nothing')
        if (self.path / FILE_NAME).exists():
            self.metadata = read_metadata(self.path / FILE_NAME)
            if self.metadata.storage != 'mcap':
                storage = self.metadata.storage
                raise BagError(f'{self.path}: expected MCAP storage, got {storage}')
        # A killed recorder may have begun a file that metadata.yaml does not name yet.
        files = sorted(self.path.glob('*.mcap'), key=_file_number)
        if not files:
            raise BagError(f'{self.path}: expected .mcap files, found none')
        missing = set(self.metadata.file_names if self.metadata else ()) - {f.name for f in files}
        if missing:
            raise BagError(f'{self.path}: {", ".join(sorted(missing))} is missing')
        return files


class _FileScan:
    """One pass over one file; what it learns goes to the bag."""

    def __init__(
        self, bag: BagReader, path: Path, stream: BinaryIO, topics: frozenset[str]
    ) -> None:
        self._bag = bag
        self._path = path
        self._stream = stream
        self._topics = topics
        self._size = path.stat().st_size
        self._schemas: dict[int, Schema] = {}
        # By channel id; None for a channel that is not wanted.
        self._channels: dict[int, tuple[str, str] | None] = {}
        self._count = 0

    def messages(self) -> Iterator[BagMessage]:
        if self._stream.read(len(MAGIC)) != MAGIC:
            self._report('is not an MCAP file, or its beginning is lost')
            return
        self._preload_summary()
        while (head := self._stream.read(_RECORD_HEAD.size)) and len(head) == _RECORD_HEAD.size:
            opcode, length = _RECORD_HEAD.unpack(head)
            offset = self._stream.tell()
            if opcode == Opcode.FOOTER and offset + length + len(MAGIC) <= self._size:
                return
            if offset + length > self._size or opcode == 0:
                break
            if opcode in (Opcode.HEADER, Opcode.METADATA, Opcode.CHUNK) or opcode in _IN_CHUNK:
                yield from self._record(opcode, self._stream.read(length), offset)
            else:
                self._stream.seek(length, 1)
        self._report(
            f'was cut or never closed: it ends within {self._size} bytes without its end record;'
            f' all {self._count} messages of complete chunks were read'
        )

    def _record(self, opcode: int, body: bytes, offset: int) -> Iterator[BagMessage]:
        try:
            if opcode == Opcode.CHUNK:
                stream, size = _open_chunk(body)
                found = list(self._chunk_messages(stream.read(size)))
            elif opcode in _IN_CHUNK:
                found = list(self._chunk_messages(_RECORD_HEAD.pack(opcode, len(body)) + body))
            else:
                found = []
                self._note(opcode, ReadDataStream(BytesIO(body)))
        except _PARSE_ERRORS as error:
            self._report(f'the record at byte {offset} is damaged and was left out: {error}')
            return
        self._count += len(found)
        yield from found

    def _preload_summary(self) -> None:
        """Learn the channels from the summary: the chunk that declares one may be damaged."""
        try:
            self._stream.seek(max(self._size - _FOOTER_SIZE, 0))
            tail = self._stream.read()
            if tail[:1] == bytes([Opcode.FOOTER]) and tail.endswith(MAGIC):
                (start,) = struct.unpack_from('<Q', tail, _RECORD_HEAD.size)
                self._stream.seek(min(start, self._size))
                list(self._chunk_messages(self._stream.read()[: -len(MAGIC)]))
        except _PARSE_ERRORS:
            pass  # a summary is a help, not a need
        self._stream.seek(len(MAGIC))

    def _note(self, opcode: int, stream: ReadDataStream) -> None:
        if opcode == Opcode.HEADER:
            profile = Header.read(stream).profile
            if profile not in ('ros2', ''):
                self._report(f'expected an MCAP file of profile ros2, got {profile!r}')
        elif opcode == Opcode.METADATA and self._bag.metadata is None:
            metadata = Metadata.read(stream)
            if metadata.name == 'rosbag2':
                text = metadata.metadata.get('serialized_metadata', '')
                self._bag.metadata = parse_metadata(text, self._path.name)

    def _chunk_messages(self, records: bytes) -> Iterator[BagMessage]:
        position = 0
        while position < len(records):
            opcode, length = _RECORD_HEAD.unpack_from(records, position)
            start = position + _RECORD_HEAD.size
            position = start + length
            if position > len(records):
                raise ValueError('a record reaches beyond its chunk')
            if opcode == Opcode.MESSAGE:
                channel_id, _, log_time, publish_time = _MESSAGE.unpack_from(records, start)
                if channel_id not in self._channels:
                    raise ValueError(f'channel {channel_id} was never declared')
                channel = self._channels[channel_id]
                if channel is not None:
                    data = records[start + _MESSAGE.size : position]
                    yield BagMessage(*channel, log_time, publish_time, data)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._declare(opcode, ReadDataStream(BytesIO(records[start:position])))

    def _declare(self, opcode: int, stream: ReadDataStream) -> None:
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self._schemas[schema.id] = schema
            return
        channel = Channel.read(stream)
        found = self._schemas.get(channel.schema_id)
        topic = BagTopic(
            name=channel.topic,
            type_name=found.name if found else '',
            schema_encoding=found.encoding if found else '',
            schema_text=found.data.decode(errors='replace') if found else '',
            type_hash=channel.metadata.get('topic_type_hash', ''),
            offered_qos_profiles=channel.metadata.get('offered_qos_profiles', ''),
        )
        self._bag.topics.setdefault(topic.name, topic)
        wanted = not self._topics or topic.name in self._topics
        self._channels[channel.id] = (topic.name, topic.type_name) if wanted else None

    def _report(self, what: str) -> None:
        self._bag.damage.append(f'{self._path.name}: {what}')


_IN_CHUNK = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)


def _open_chunk(body: bytes) -> tuple[ReadDataStream, int]:
    chunk = Chunk.read(ReadDataStream(BytesIO(body)))
    size = chunk.uncompressed_size
    if chunk.compression == 'zstd':
        size = max(size, zstandard.frame_content_size(chunk.data))
    if size > _CHUNK_LIMIT:
        raise ValueError(f'a chunk of {size} bytes')
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    return stream, length


def _file_number(path: Path) -> tuple[int, str]:
    number = re.search(r'_(\d+)$', path.stem)
    return (int(number[1]) if number else 0, path.name)
