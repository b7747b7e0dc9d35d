"""Writing bags in the exact shape of rosbag2 (Jazzy, MCAP storage).

`<folder>/<name>_0.mcap` with metadata.yaml next to it. A recording that is killed leaves every
flushed chunk, and a metadata.yaml (renewed at every flush) that names the files and counts what
is in them, so that rosbag2 can play them and `BagReader` reads them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import contextlib
import errno
import os
from pathlib import Path
import shutil
import struct
import tempfile
from types import TracebackType
from typing import BinaryIO

from spikelane.bag.container import COMPRESSIONS, McapFile
from spikelane.bag.metadata import (
    BagMetadata,
    FILE_NAME,
    FileRecord,
    qos_text,
    QosProfile,
    TopicRecord,
)
from spikelane.bag.schema import Schema
from spikelane_sim.errors import BagError

LIBRARY = 'spikelane 0.1.0'
# The chunk size of rosbag2's MCAP storage.
CHUNK_BYTES = 768 * 1024
# The last messages of each latched topic are repeated, up to this many.
_LATCHED_LIMIT = 32
_RESERVE_STEP = 256 * 1024
_FULL = (errno.ENOSPC, errno.EDQUOT)


class _Topic:
    """A topic and what must be known of it to begin another file."""

    def __init__(
        self,
        name: str,
        type_name: str,
        schema: Schema,
        type_hash: str,
        qos: tuple[QosProfile, ...],
    ) -> None:
        self.name = name
        self.type_name = type_name
        self.schema = schema
        self.type_hash = type_hash
        self.qos = qos
        self.is_latched = bool(qos) and all(profile.is_latched for profile in qos)
        # Message to publish time: each distinct message once, in order of its last arrival.
        self.latched: dict[bytes, int] = {}

    def keep_latched(self, publish_time_ns: int, data: bytes) -> None:
        """Remember a message of a latched topic."""
        self.latched.pop(data, None)
        self.latched[data] = publish_time_ns
        if len(self.latched) > _LATCHED_LIMIT:
            del self.latched[next(iter(self.latched))]


class _Reserve:
    """Disk space held by a nameless file, to be given back for the summary when the disk is full.

    It vanishes with the process, so nothing is left of it after a kill.
    """

    def __init__(self, folder: Path) -> None:
        self._file: BinaryIO = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        self._size = 0

    def hold(self, size: int) -> None:
        """Hold at least so many bytes."""
        if size > self._size:
            size = -(-size // _RESERVE_STEP) * _RESERVE_STEP
            os.posix_fallocate(self._file.fileno(), 0, size)
            self._size = size

    def release(self) -> None:
        """Give the space back."""
        self._file.close()


class BagWriter:
    """A bag being written.

    Example:
        >>> with BagWriter(Path('run/bag')) as bag:  # doctest: +SKIP
        ...     topic = bag.add_topic('/reward', 'std_msgs/msg/Float64', 'float64 data')
        ...     bag.write(topic, log_time_ns, publish_time_ns, cdr_bytes)
    """

    def __init__(
        self,
        path: Path,
        *,
        compression: str = 'zstd',
        chunk_bytes: int = CHUNK_BYTES,
        max_file_bytes: int = 0,
        custom_data: Mapping[str, str] | None = None,
    ) -> None:
        """Create the folder and the first file.

        Args:
            path: Folder of the bag; must not exist.
            compression: `zstd` or `none`.
            chunk_bytes: A chunk is written when it has reached this size.
            max_file_bytes: Another file is begun when one has reached this size; 0 for never.
            custom_data: Facts about the run (parameters, seeds), kept in the metadata.

        Raises:
            BagError: The folder exists or cannot be written, or an argument is wrong.
        """
        if compression not in COMPRESSIONS:
            allowed = ', '.join(COMPRESSIONS)
            raise BagError(f'compression: expected one of {allowed}, got {compression!r}')
        self.path = Path(os.path.abspath(path))
        self._compression = compression
        self._chunk_bytes = chunk_bytes
        self._max_file_bytes = max_file_bytes
        self._custom_data = dict(custom_data or {})
        self._topics: list[_Topic] = []
        self._files: list[McapFile] = []
        self._is_open = True
        self.lost_count = 0
        try:
            self.path.mkdir(parents=True)
        except FileExistsError:
            raise BagError(f'{path}: expected a folder that does not exist yet') from None
        except OSError as error:
            raise BagError(f'{path}: cannot be created: {error.strerror}') from None
        try:
            self._reserve = _Reserve(self.path)
            self._reserve.hold(_RESERVE_STEP)
            self._begin_file()
            self._write_metadata()
        except OSError as error:
            shutil.rmtree(self.path, ignore_errors=True)
            raise BagError(f'{path}: cannot be written: {error.strerror}') from None

    def __enter__(self) -> BagWriter:
        """Return the writer, which is closed at the end of the block."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the bag."""
        self.close()

    @property
    def message_count(self) -> int:
        """Messages that are in the files or will be at the next flush."""
        pending = self._files[-1].pending_count if self._is_open else 0
        return sum(file.message_count for file in self._files) + pending

    @property
    def counts(self) -> dict[str, int]:
        """Messages of each topic that are in the files: all of them once the bag is closed."""
        return {topic.name: topic.message_count for topic in self._metadata().topics}

    def add_topic(
        self,
        name: str,
        type_name: str,
        schema: Schema | str,
        type_hash: str = '',
        qos: Sequence[QosProfile] = (),
    ) -> int:
        """Declare a topic and return the id under which its messages are written.

        Args:
            name: With leading slash.
            type_name: `package/msg/Type`.
            schema: From `collect_schema`, or the text of a .msg with its dependencies.
            type_hash: `RIHS01_…`, empty where unknown; readers refuse a wrong one.
            qos: What its publishers offer. A topic all of whose publishers latch is repeated at
                the head of every further file.

        Raises:
            BagError: There is such a topic already, or the bag is closed.
        """
        self._check_open()
        if any(topic.name == name for topic in self._topics):
            raise BagError(f'{self.path}: topic {name} is in the bag already')
        if isinstance(schema, str):
            schema = Schema('ros2msg', schema)
        topic = _Topic(name, type_name, schema, type_hash, tuple(qos))
        self._topics.append(topic)
        return self._add_channel(topic)

    def write(self, topic_id: int, log_time_ns: int, publish_time_ns: int, data: bytes) -> None:
        """Add a message.

        Args:
            topic_id: From `add_topic`.
            log_time_ns: When it was received, nanoseconds since the epoch.
            publish_time_ns: When it was sent.
            data: CDR with its four-byte header, as raw subscriptions give it.

        Raises:
            BagError: The disk is full (the bag is then closed, finished as far as possible), the
                bag is closed, or a time is negative.
        """
        self._check_open()
        if self._max_file_bytes and self._files[-1].size >= self._max_file_bytes:
            self._split(log_time_ns)
        file = self._files[-1]
        try:
            file.add_message(topic_id, log_time_ns, publish_time_ns, data)
        except struct.error:
            times = f'{log_time_ns} and {publish_time_ns}'
            raise BagError(f'{self.path}: expected times from 0 to 2^64 ns, got {times}') from None
        topic = self._topics[topic_id - 1]
        if topic.is_latched:
            topic.keep_latched(publish_time_ns, data)
        if file.pending_size >= self._chunk_bytes:
            self._end_chunk()

    def flush(self) -> None:
        """Bring everything written so far into the files, where a kill cannot undo it.

        Raises:
            BagError: As `write`.
        """
        self._check_open()
        if self._files[-1].pending_size:
            self._end_chunk()
            with self._stopping_on_failure():
                self._write_metadata()

    def repeat_latched(self, log_time_ns: int) -> None:
        """Write what latched topics hold again, for one who starts reading here.

        Args:
            log_time_ns: Under this time.
        """
        for topic_id, topic in enumerate(self._topics, start=1):
            for data, publish_time_ns in list(topic.latched.items()):
                self._files[-1].add_message(topic_id, log_time_ns, publish_time_ns, data)

    def close(self) -> None:
        """Finish the files and write metadata.yaml; closing twice is harmless.

        Raises:
            BagError: The disk is full; the bag is finished as far as possible.
        """
        if not self._is_open:
            return
        self._end_chunk()
        with self._stopping_on_failure():
            self._finish()
        self._is_open = False

    def remove(self) -> None:
        """Close the bag and remove its folder.

        Raises:
            BagError: As `close`, or the folder cannot be removed.
        """
        self.close()
        try:
            shutil.rmtree(self.path)
        except OSError as error:
            raise BagError(f'{self.path}: cannot be removed: {error}') from None

    def _check_open(self) -> None:
        if not self._is_open:
            raise BagError(f'{self.path}: the bag is closed')

    def _begin_file(self) -> None:
        name = f'{self.path.name}_{len(self._files)}.mcap'
        self._files.append(McapFile(self.path / name, LIBRARY, self._compression))
        self._files[-1].add_metadata('rosbag2', self._metadata_record())

    def _add_channel(self, topic: _Topic) -> int:
        metadata = {
            'offered_qos_profiles': qos_text(topic.qos),
            'topic_type_hash': topic.type_hash,
        }
        return self._files[-1].add_channel(
            topic.name, topic.type_name, topic.schema.encoding, topic.schema.text, metadata
        )

    def _end_chunk(self) -> None:
        with self._stopping_on_failure():
            self._files[-1].end_chunk()
            self._reserve.hold(self._files[-1].summary_size + len(self._metadata_text()) * 3)

    def _split(self, log_time_ns: int) -> None:
        self._end_chunk()
        with self._stopping_on_failure():
            self._close_file()
            self._begin_file()
            self._write_metadata()
        for topic in self._topics:
            self._add_channel(topic)
        self.repeat_latched(log_time_ns)

    def _close_file(self) -> None:
        self._files[-1].add_metadata('rosbag2', self._metadata_record())
        self._files[-1].finish()
        self._files[-1].sync()
        self._files[-1].close()

    def _finish(self) -> None:
        self._close_file()
        self._reserve.release()
        self._write_metadata()

    @contextlib.contextmanager
    def _stopping_on_failure(self) -> Iterator[None]:
        """Turn a failing write into one BagError, with the bag finished as far as it can be."""
        try:
            yield
        except OSError as error:
            raise self._stop(error) from None

    def _stop(self, error: OSError) -> BagError:
        """Finish with what the reserve has room for; the chunk that did not fit is lost."""
        self._is_open = False
        self.lost_count += self._files[-1].drop_chunk()
        self._reserve.release()
        try:
            self._finish()
        except OSError:
            # Not even that fits (a limit on the file's size, say): complete chunks remain.
            with contextlib.suppress(OSError):
                self._files[-1].close()
            with contextlib.suppress(OSError):
                self._write_metadata()
        reason = 'the disk is full' if error.errno in _FULL else error.strerror
        return BagError(
            f'{self.path}: recording stopped, {reason}; {self.message_count} messages are saved,'
            f' {self.lost_count} lost'
        )

    def _metadata(self) -> BagMetadata:
        topics = tuple(
            TopicRecord(
                topic.name,
                topic.type_name,
                topic.type_hash,
                topic.qos,
                sum(file.counts.get(topic_id, 0) for file in self._files),
            )
            for topic_id, topic in enumerate(self._topics, start=1)
        )
        files = tuple(
            FileRecord(
                f'{self.path.name}_{number}.mcap', file.start_ns, file.end_ns, file.message_count
            )
            for number, file in enumerate(self._files)
        )
        return BagMetadata(topics, files, self._custom_data)

    def _metadata_text(self) -> str:
        return self._metadata().to_file_text()

    def _metadata_record(self) -> dict[str, str]:
        return {'serialized_metadata': self._metadata().to_text()}

    def _write_metadata(self) -> None:
        temporary = self.path / f'.{FILE_NAME}'
        try:
            temporary.write_text(self._metadata_text())
            temporary.replace(self.path / FILE_NAME)
        except OSError:
            with contextlib.suppress(OSError):
                temporary.unlink()
            raise
