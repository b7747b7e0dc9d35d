"""The MCAP container: chunks written whole, so that a file is good up to its last chunk.

The `mcap` package's writer cannot be finished after a write has failed; this one can, which is
what makes a recording on a full disk readable. It also costs a tenth per message. Records that
are not in the hot path are those of `mcap.records`. Layout: https://mcap.dev/spec
"""

from __future__ import annotations

from collections.abc import Mapping
import contextlib
import fcntl
import os
from pathlib import Path
import struct
import zlib

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
import zstandard

MAGIC = b'\x89MCAP0\r\n'
COMPRESSIONS = ('zstd', 'none')
_MESSAGE = struct.Struct('<BQHIQQ')
_MESSAGE_FIELDS_LENGTH = 22
_CHUNK = struct.Struct('<BQQQQI')
_MESSAGE_INDEX = struct.Struct('<BQHI')
# Fast is what two cores want: level 1 halves typical bags at several hundred MB/s.
_ZSTD_LEVEL = 1


class McapFile:
    """One MCAP file being written.

    Messages gather in memory until `end_chunk`. Each write is one whole chunk with its index, or
    nothing: where the disk fails in between, the file is cut back to what was complete.

    Attributes:
        size: Bytes in the file.
        pending_size: Bytes of the chunk in memory.
        counts: Messages in complete chunks, by channel.
        start_ns, end_ns: Smallest and largest log time of those; None and 0 without a message.
    """

    def __init__(self, path: Path, library: str, compression: str = 'zstd') -> None:
        """Create the file, which must not exist yet.

        Raises:
            OSError: It exists, or cannot be written.
        """
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        # Until it is closed or the process ends: nobody repairs a file that is being written.
        with contextlib.suppress(OSError):
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._zstd = zstandard.ZstdCompressor(_ZSTD_LEVEL) if compression == 'zstd' else None
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunk_indexes: list[ChunkIndex] = []
        self._metadata_indexes: list[MetadataIndex] = []
        self._declared_size = 0
        self.size = 0
        self.counts: dict[int, int] = {}
        self.start_ns: int | None = None
        self.end_ns = 0
        self._begin_chunk()
        self._append(MAGIC + _bytes_of(Header(profile='ros2', library=library)))

    @property
    def pending_size(self) -> int:
        """Bytes of the chunk in memory."""
        return len(self._chunk)

    @property
    def pending_count(self) -> int:
        """Messages of the chunk in memory."""
        return sum(len(entries) for entries in self._entries.values()) // 2

    @property
    def message_count(self) -> int:
        """Messages in complete chunks."""
        return sum(self.counts.values())

    def add_channel(
        self,
        topic: str,
        type_name: str,
        schema_encoding: str,
        schema_text: str,
        metadata: Mapping[str, str],
    ) -> int:
        """Declare a channel of CDR messages and return its id; the same schema is kept once."""
        schema = self._schema(type_name, schema_encoding, schema_text)
        channel_id = len(self._channels) + 1
        channel = Channel(
            id=channel_id,
            topic=topic,
            message_encoding='cdr',
            metadata=dict(metadata),
            schema_id=schema.id,
        )
        self._channels.append(channel)
        self._declare(_bytes_of(channel))
        return channel_id

    def add_message(
        self,
        channel_id: int,
        log_time_ns: int,
        publish_time_ns: int,
        data: bytes,
        sequence: int = 0,
    ) -> None:
        """Add a message to the chunk in memory.

        Raises:
            struct.error: A time is negative or beyond 64 bits.
        """
        chunk = self._chunk
        head = _MESSAGE.pack(
            Opcode.MESSAGE,
            _MESSAGE_FIELDS_LENGTH + len(data),
            channel_id,
            sequence,
            log_time_ns,
            publish_time_ns,
        )
        entries = self._entries.get(channel_id)
        if entries is None:
            entries = self._entries[channel_id] = []
        entries += (log_time_ns, len(chunk))
        chunk += head
        chunk += data

    def add_metadata(self, name: str, metadata: Mapping[str, str]) -> None:
        """Write a metadata record, after the chunk in memory."""
        self.end_chunk()
        record = _bytes_of(Metadata(name=name, metadata=dict(metadata)))
        index = MetadataIndex(offset=self.size, length=len(record), name=name)
        self._append(record)
        self._metadata_indexes.append(index)

    def end_chunk(self) -> None:
        """Write the chunk in memory, if there is anything in it.

        Raises:
            OSError: It could not be written; the chunk is still in memory, the file unchanged.
        """
        if not self._entries:
            return  # schemas and channels wait for the first message
        times = [time for entries in self._entries.values() for time in entries[::2]]
        start_ns, end_ns = min(times), max(times)
        chunk, index = self._chunk_record(start_ns, end_ns)
        message_indexes = self._message_indexes(index)
        self._append(chunk + message_indexes)
        self._chunk_indexes.append(index)
        for channel_id, entries in self._entries.items():
            self.counts[channel_id] = self.counts.get(channel_id, 0) + len(entries) // 2
        self.start_ns = start_ns if self.start_ns is None else min(self.start_ns, start_ns)
        self.end_ns = max(self.end_ns, end_ns)
        self._begin_chunk()

    def drop_chunk(self) -> int:
        """Forget the chunk in memory and return how many messages were in it."""
        count = self.pending_count
        self._begin_chunk()
        return count

    def finish(self) -> None:
        """Write the chunk in memory and the summary; the file is then complete.

        Raises:
            OSError: It could not be written; the file has its complete chunks, without summary.
        """
        self.end_chunk()
        self._append(self._closing_records())

    def sync(self) -> None:
        """Wait until the disk has the file."""
        os.fsync(self._fd)

    def close(self) -> None:
        """Close the file as it is; closing twice is harmless."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    @property
    def summary_size(self) -> int:
        """An upper estimate of the bytes that `finish` writes behind the last chunk."""
        chunks = len(self._chunk_indexes) * (100 + 10 * len(self._channels))
        return 4096 + self._declared_size + 10 * len(self._channels) + chunks

    def _schema(self, name: str, encoding: str, text: str) -> Schema:
        data = text.encode()
        for schema in self._schemas:
            if (schema.name, schema.encoding, schema.data) == (name, encoding, data):
                return schema
        schema = Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data)
        self._schemas.append(schema)
        self._declare(_bytes_of(schema))
        return schema

    def _declare(self, record: bytes) -> None:
        self._chunk += record
        self._declared_size += len(record)

    def _begin_chunk(self) -> None:
        self._chunk = bytearray()
        # By channel: log time and offset of each message, alternating.
        self._entries: dict[int, list[int]] = {}

    def _chunk_record(self, start_ns: int, end_ns: int) -> tuple[bytes, ChunkIndex]:
        records = bytes(self._chunk)
        stored, compression = records, ''
        if self._zstd is not None:
            compressed = self._zstd.compress(records)
            if len(compressed) < len(records):
                stored, compression = compressed, 'zstd'
        name = struct.pack('<I', len(compression)) + compression.encode()
        length = _CHUNK.size - 9 + len(name) + 8 + len(stored)
        crc = zlib.crc32(records)
        head = _CHUNK.pack(Opcode.CHUNK, length, start_ns, end_ns, len(records), crc)
        record = b''.join((head, name, struct.pack('<Q', len(stored)), stored))
        index = ChunkIndex(
            chunk_length=len(record),
            chunk_start_offset=self.size,
            compression=compression,
            compressed_size=len(stored),
            message_end_time=end_ns,
            message_index_length=0,
            message_index_offsets={},
            message_start_time=start_ns,
            uncompressed_size=len(records),
        )
        return record, index

    def _message_indexes(self, index: ChunkIndex) -> bytes:
        """Return the index records behind the chunk, and note in the chunk's where they are."""
        records = bytearray()
        for channel_id, entries in self._entries.items():
            index.message_index_offsets[channel_id] = self.size + index.chunk_length + len(records)
            size = 8 * len(entries)
            records += _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel_id, size)
            records += struct.pack(f'<{len(entries)}Q', *entries)
        index.message_index_length = len(records)
        return bytes(records)

    def _closing_records(self) -> bytes:
        data_end = _bytes_of(DataEnd(data_section_crc=0))
        groups = (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunk_indexes),
            (Opcode.METADATA_INDEX, self._metadata_indexes),
        )
        start = self.size + len(data_end)
        summary, offsets = bytearray(), bytearray()
        for opcode, records in groups:
            group = b''.join(map(_bytes_of, records))
            if group:
                group_start = start + len(summary)
                offsets += _bytes_of(SummaryOffset(opcode, group_start, len(group)))
                summary += group
        offset_start = start + len(summary)
        summary += offsets
        footer_head = struct.pack('<BQQQ', Opcode.FOOTER, 20, start, offset_start)
        crc = zlib.crc32(footer_head, zlib.crc32(summary))
        footer = _bytes_of(Footer(start, offset_start, crc))
        return b''.join((data_end, summary, footer, MAGIC))

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self.counts),
            chunk_count=len(self._chunk_indexes),
            message_count=self.message_count,
            message_end_time=self.end_ns,
            message_start_time=self.start_ns or 0,
            metadata_count=len(self._metadata_indexes),
            schema_count=len(self._schemas),
        )

    def _append(self, data: bytes) -> None:
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[os.write(self._fd, rest) :]
        except OSError:
            if self._fd >= 0:
                os.ftruncate(self._fd, self.size)
                os.lseek(self._fd, self.size, os.SEEK_SET)
            raise
        self.size += len(data)


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
