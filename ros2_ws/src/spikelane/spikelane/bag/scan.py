"""One pass over an MCAP file, from front to back: every message of every whole record.

It needs neither summary nor index, so that cut, killed and damaged files are read as far as they
are sound.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
import struct
from typing import BinaryIO, NamedTuple
import zlib

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Header, Metadata, Schema
import zstandard

from spikelane.bag.container import MAGIC
from spikelane.bag.decompression import Budget, PIECE_LIMIT
from spikelane_sim.errors import one_line

_RECORD_HEAD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<HIQQ')
_FOOTER_SIZE = 29 + len(MAGIC)
_RECORD_LIMIT = PIECE_LIMIT + (1 << 16)
_SUMMARY_LIMIT = 1 << 28
# What the decoders raise for damaged bytes.
_PARSE_ERRORS = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    ArithmeticError,
    RuntimeError,
    MemoryError,
)
_IN_CHUNK = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_WANTED = (*_IN_CHUNK, Opcode.HEADER, Opcode.METADATA, Opcode.CHUNK)


class ScannedMessage(NamedTuple):
    """A message as the file has it."""

    channel_id: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes


class McapScan:
    """One pass over one file.

    Attributes:
        channels: Channels met so far, by id; complete after `messages` has ended.
        schemas: Schemas, likewise.
        metadata: Contents of the metadata records met, by name; the last one of each name.
        attachments: How many there are.
        is_complete: Whether the file has its end record.
        damage: What could not be read, one sentence each without the file's name.
    """

    def __init__(
        self,
        path: Path,
        *,
        original_size: int | None = None,
        is_wanted: Callable[[Channel, Schema | None], bool] = lambda channel, schema: True,
        on_metadata: Callable[[str, dict[str, str]], None] = lambda name, values: None,
    ) -> None:
        """Get ready.

        Args:
            path: The file.
            original_size: Size of the file on the disk [bytes] where this is its decompressed
                content.
            is_wanted: Whether messages of a channel are.
            on_metadata: Called with each metadata record.
        """
        self._path = path
        self._original_size = original_size
        self._is_wanted, self._on_metadata = is_wanted, on_metadata
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments = 0
        self.is_complete = False
        self.damage: list[str] = []
        self._wanted: dict[int, bool] = {}
        self._count = 0
        self._bad_count = self._bad_offset = 0
        self._bad_reason = ''  # of the first

    def messages(self) -> Iterator[ScannedMessage]:
        """Yield every message that can be read, in the order of the file.

        Raises:
            OSError: The file cannot be read.
        """
        self._size = self._path.stat().st_size
        self._budget = Budget(self._original_size or self._size)
        with self._path.open('rb') as stream:
            yield from self._messages(stream)
        if self._bad_count:
            what = f'the record at byte {self._bad_offset} is damaged and was left out'
            if self._bad_count > 1:
                what = (
                    f'{self._bad_count} records are damaged and were left out, the first at byte '
                    f'{self._bad_offset}'
                )
            self.damage.insert(0, f'{what}: {self._bad_reason}')

    def _messages(self, stream: BinaryIO) -> Iterator[ScannedMessage]:
        if stream.read(len(MAGIC)) != MAGIC:
            self.damage.append('is not an MCAP file, or its beginning is lost')
            return
        self._preload_summary(stream)
        while (head := stream.read(_RECORD_HEAD.size)) and len(head) == _RECORD_HEAD.size:
            opcode, length = _RECORD_HEAD.unpack(head)
            offset = stream.tell()
            if opcode == Opcode.FOOTER and offset + length + len(MAGIC) <= self._size:
                self.is_complete = True
                return
            if offset + length > self._size or opcode == 0:
                break
            self.attachments += opcode == Opcode.ATTACHMENT
            if opcode not in _WANTED:
                stream.seek(length, 1)
            elif length > _RECORD_LIMIT:
                self._report(offset, f'it has {length} bytes, more than {_RECORD_LIMIT}')
                stream.seek(length, 1)
            else:
                yield from self._record(opcode, stream.read(length), offset)
        self.damage.append(
            f'was cut or never closed: it ends within {self._size} bytes without its end record;'
            f' all {self._count} messages of complete chunks were read'
        )

    def _record(self, opcode: int, body: bytes, offset: int) -> Iterator[ScannedMessage]:
        records = b''
        try:
            if opcode == Opcode.CHUNK:
                records = _open_chunk(body, self._budget)
            elif opcode in _IN_CHUNK:
                records = _RECORD_HEAD.pack(opcode, len(body)) + body
            else:
                self._note(opcode, ReadDataStream(BytesIO(body)))
            self._count += self._check(records)
        except _PARSE_ERRORS as error:
            self._report(offset, str(error) or type(error).__name__)
            return
        yield from self._found(records)

    def _preload_summary(self, stream: BinaryIO) -> None:
        """Learn the channels from the summary: the chunk that declares one may be damaged."""
        try:
            stream.seek(max(self._size - _FOOTER_SIZE, 0))
            tail = stream.read()
            if tail[:1] == bytes([Opcode.FOOTER]) and tail.endswith(MAGIC):
                (start,) = struct.unpack_from('<Q', tail, _RECORD_HEAD.size)
                if 0 < self._size - start <= _SUMMARY_LIMIT:
                    stream.seek(start)
                    summary = stream.read()[: -len(MAGIC)]
                    for opcode, begin, end in _records(summary):
                        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                            self._declare(opcode, summary[begin:end])
        except _PARSE_ERRORS:
            pass  # a summary is a help, not a need
        stream.seek(len(MAGIC))

    def _note(self, opcode: int, stream: ReadDataStream) -> None:
        if opcode == Opcode.HEADER:
            profile = Header.read(stream).profile
            if profile not in ('ros2', ''):
                self.damage.append(f'expected an MCAP file of profile ros2, got {profile!r}')
            return
        record = Metadata.read(stream)
        self.metadata[record.name] = record.metadata
        self._on_metadata(record.name, record.metadata)

    def _check(self, records: bytes) -> int:
        """Make sure that all records can be read before the first is given; count messages."""
        count = 0
        for opcode, start, end in _records(records):
            if opcode == Opcode.MESSAGE:
                channel_id = _MESSAGE.unpack_from(records, start)[0]
                if channel_id not in self._wanted:
                    raise ValueError(f'channel {channel_id} was never declared')
                if end - start < _MESSAGE.size:
                    raise ValueError(f'a message of {end - start} bytes')
                count += self._wanted[channel_id]
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._declare(opcode, records[start:end])
        return count

    def _found(self, records: bytes) -> Iterator[ScannedMessage]:
        for opcode, start, end in _records(records):
            if opcode == Opcode.MESSAGE:
                channel_id, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(records, start)
                if self._wanted[channel_id]:
                    data = records[start + _MESSAGE.size : end]
                    yield ScannedMessage(channel_id, sequence, log_ns, publish_ns, data)

    def _declare(self, opcode: int, body: bytes) -> None:
        stream = ReadDataStream(BytesIO(body))
        if opcode == Opcode.SCHEMA:
            declared = Schema.read(stream)
            self.schemas[declared.id] = declared
            return
        channel = Channel.read(stream)
        self.channels[channel.id] = channel
        schema = self.schemas.get(channel.schema_id)
        self._wanted[channel.id] = self._is_wanted(channel, schema)

    def _report(self, offset: int, reason: str) -> None:
        if not self._bad_count:
            self._bad_offset, self._bad_reason = offset, one_line(' '.join(reason.split()))
        self._bad_count += 1


def _records(records: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, beginning and end of each record's content.

    Raises:
        ValueError: One reaches beyond the end, or is none.
    """
    position, size = 0, len(records)
    while position < size:
        opcode, length = _RECORD_HEAD.unpack_from(records, position)
        start = position + _RECORD_HEAD.size
        position = start + length
        if position > size:
            raise ValueError('a record reaches beyond its chunk')
        if opcode == 0:
            raise ValueError('there is no record of kind 0')
        yield opcode, start, position


def _open_chunk(body: bytes, budget: Budget) -> bytes:
    chunk = Chunk.read(ReadDataStream(BytesIO(body)))
    records = budget.decompress(chunk.data, chunk.compression, chunk.uncompressed_size)
    if chunk.uncompressed_crc and zlib.crc32(records) != chunk.uncompressed_crc:
        raise ValueError('its checksum is wrong')
    return records
