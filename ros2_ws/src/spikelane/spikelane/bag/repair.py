"""Repair of bags: what a killed recorder or damage has left becomes a bag that all readers take.

Files that are sound stay as they are. From each other file, all messages that can be read are
written into a new file in a hidden folder. When rosbags has read the new bag whole, the new files
take the places of the old ones; metadata.yaml follows at the end. If this is interrupted, each
file is as it was or repaired, and the next repair does the rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import contextlib
import fcntl
import os
from pathlib import Path
import shutil
import tempfile
from typing import NamedTuple

from mcap.records import Channel, Schema

from spikelane.bag.container import MAGIC, McapFile
from spikelane.bag.metadata import (
    BagMetadata,
    FILE_NAME,
    FileRecord,
    parse_metadata,
    parse_qos,
    qos_text,
    QosProfile,
    read_metadata,
    StoredMetadata,
    TopicRecord,
)
from spikelane.bag.scan import McapScan
from spikelane.bag.storage import later_files, locate
from spikelane.bag.verification import has_sound_summary, is_described, readable_count
from spikelane.bag.writer import CHUNK_BYTES, LIBRARY
from spikelane_sim.errors import BagError
from spikelane_sim.files import write_text_atomically

_QOS = 'offered_qos_profiles'


class Repair(NamedTuple):
    """What was done.

    Attributes:
        path: The bag that is whole now.
        message_count: Messages in it.
        written: Names of the files that were rewritten; none where nothing was to repair.
        notes: What was wrong, and what could not be saved, one sentence each.
    """

    path: Path
    message_count: int
    written: tuple[str, ...]
    notes: tuple[str, ...]


class _Contents(NamedTuple):
    """What a file has, or would have after it is rewritten."""

    name: str
    channels: tuple[tuple[Channel, str], ...]  # with the names of their types
    qos: dict[str, tuple[QosProfile, ...]]  # by topic, where a declaration of it can be read
    counts: dict[int, int]  # messages by channel
    start_ns: int | None
    end_ns: int
    rosbag2: str  # what it says about the bag, '' for nothing
    damage: tuple[str, ...]
    attachments: int

    @property
    def record(self) -> FileRecord:
        """What metadata.yaml says about it."""
        return FileRecord(self.name, self.start_ns, self.end_ns, sum(self.counts.values()))


def repair_bag(path: Path, out: Path | None = None) -> Repair:
    """Repair a bag.

    Args:
        path: The bag's folder, or one .mcap file, whose folder's metadata.yaml is left alone.
        out: A new folder for the repaired bag; None to repair it where it is.

    Raises:
        BagError: It is no MCAP bag, is being recorded, or cannot be written; nothing has changed
            then.
    """
    path = Path(path)
    if out is not None and out.exists():
        raise BagError(f'{out}: expected a folder that does not exist yet')
    files, metadata, notes = _find(path)
    try:
        with contextlib.ExitStack() as stack:
            for file in files:
                stack.enter_context(_not_being_recorded(file))
            return _repair(path, out, files, metadata, notes)
    except OSError as error:
        raise BagError(f'{path}: cannot be repaired: {error.strerror}') from None


def _repair(
    path: Path,
    out: Path | None,
    files: list[Path],
    metadata: StoredMetadata | None,
    notes: list[str],
) -> Repair:
    contents = [_scan(file) for file in files]
    count = sum(each.record.message_count for each in contents)
    is_whole = path.is_dir() and is_described(path, files, count)
    bad = [
        file
        for file, each in zip(files, contents, strict=True)
        if not _is_sound(file, each, is_readable=is_whole)
    ]
    for file, each in zip(files, contents, strict=True):
        notes += [f'{each.name}: {what}' for what in each.damage]
        if file in bad and each.attachments:
            notes.append(f'{each.name}: its {each.attachments} attachments are not kept')
    if metadata is not None and metadata.message_count > count:
        notes.append(
            f'{count} messages are left of the {metadata.message_count} that {FILE_NAME} counts'
        )
    has_metadata = path.is_dir() or out is not None
    if not bad and (is_whole or not has_metadata):
        return Repair(path, count, (), tuple(notes))
    target = path if out is None else out
    _write(path, out, files, bad, _metadata(contents, metadata))
    written = [file.name for file in bad] + ([FILE_NAME] if has_metadata else [])
    return Repair(target, count, tuple(written), tuple(notes))


def _write(
    path: Path, out: Path | None, files: Sequence[Path], bad: Sequence[Path], metadata: BagMetadata
) -> None:
    """Rewrite bad files and metadata.yaml, into a copy of the bag or in place."""
    folder = out or (path if path.is_dir() else path.parent)
    topics = {topic.name: topic for topic in metadata.topics}
    with _workshop(folder, is_new=out is not None) as workshop:
        for file in files:
            if file in bad:
                _write_anew(file, workshop / file.name, topics)
            elif out is not None:
                shutil.copyfile(file, workshop / file.name)
            else:
                (workshop / file.name).symlink_to(file.absolute())
        write_text_atomically(workshop / FILE_NAME, metadata.to_file_text())
        count = sum(file.message_count for file in metadata.files)
        if not is_described(workshop, files, count):
            raise BagError(
                f'{path}: what can be read of it does not make a bag that others read whole'
            )
        if out is not None:
            workshop.rename(out)
            return
        for file in bad:
            os.replace(workshop / file.name, file)
        if path.is_dir():
            os.replace(workshop / FILE_NAME, path / FILE_NAME)


def _find(path: Path) -> tuple[list[Path], StoredMetadata | None, list[str]]:
    """Return the files, what metadata.yaml says, and what is wrong with it."""
    notes = []
    is_readable = True
    if path.is_dir() and (path / FILE_NAME).exists():
        try:
            read_metadata(path / FILE_NAME)
        except BagError as error:
            is_readable = False
            notes.append(str(error))
    located = locate(path, has_metadata=is_readable)
    if located.storage != 'mcap':
        raise BagError(
            f'{path}: expected MCAP storage, got {located.storage}: `ros2 bag reindex -s sqlite3` '
            'repairs such a bag'
        )
    mode = located.metadata.compression_mode if located.metadata else ''
    if mode or any(file.is_compressed for file in located.files):
        raise BagError(
            f'{path}: expected an MCAP bag whose chunks alone are compressed, got compression of '
            f'each {mode or "file"}'
        )
    files = [file.path for file in located.files]
    if path.is_dir():
        files += later_files(files)
    return files, located.metadata, notes


@contextlib.contextmanager
def _not_being_recorded(file: Path) -> Iterator[None]:
    with file.open('rb') as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BagError(f'{file}: is being recorded; stop the recorder first') from None
        except OSError:
            pass  # a file system without locks
        yield


@contextlib.contextmanager
def _workshop(folder: Path, *, is_new: bool) -> Iterator[Path]:
    """Give a hidden folder on the same file system, which becomes the bag or vanishes."""
    parent = folder.parent if is_new else folder
    parent.mkdir(parents=True, exist_ok=True)
    workshop = Path(tempfile.mkdtemp(prefix=f'.{folder.name}-', suffix='.part', dir=parent))
    workshop.chmod(0o755)
    try:
        yield workshop
    finally:
        shutil.rmtree(workshop, ignore_errors=True)


def _scan(file: Path) -> _Contents:
    with file.open('rb') as stream:
        head = stream.read(len(MAGIC))
    if len(head) == len(MAGIC) and head != MAGIC:  # less is what a kill can leave
        raise BagError(f'{file}: expected an MCAP file, got one that begins with {head!r}')
    qos: dict[str, tuple[QosProfile, ...]] = {}

    def on_declared(channel: Channel, schema: Schema | None) -> bool:
        # A channel is declared in each chunk and in the summary, and one of them may be damaged.
        del schema
        if found := _qos(channel):
            qos.setdefault(channel.topic, found)
        return True

    scan = McapScan(file, is_wanted=on_declared)
    counts: dict[int, int] = {}
    start_ns, end_ns = None, 0
    for message in scan.messages():
        counts[message.channel_id] = counts.get(message.channel_id, 0) + 1
        time_ns = message.log_time_ns
        start_ns = time_ns if start_ns is None else min(start_ns, time_ns)
        end_ns = max(end_ns, time_ns)
    encodings = {channel.message_encoding for channel in scan.channels.values()} - {'cdr'}
    if encodings:
        raise BagError(f'{file}: expected messages in cdr, got {", ".join(sorted(encodings))}')
    channels = tuple(
        (channel, _type_name(scan.schemas.get(channel.schema_id)))
        for channel in scan.channels.values()
    )
    said = scan.metadata.get('rosbag2', {}).get('serialized_metadata', '')
    return _Contents(
        file.name,
        channels,
        qos,
        counts,
        start_ns,
        end_ns,
        said,
        tuple(scan.damage),
        scan.attachments,
    )


def _type_name(schema: Schema | None) -> str:
    return schema.name if schema else ''


def _is_sound(file: Path, contents: _Contents, *, is_readable: bool) -> bool:
    """Return whether a file needs no repair; `is_readable` where rosbags has read it already."""
    if contents.damage or not has_sound_summary(file):
        return False
    return is_readable or readable_count(file) == contents.record.message_count


def _write_anew(file: Path, target: Path, topics: Mapping[str, TopicRecord]) -> None:
    """Write a file with all messages of another one that can be read.

    Args:
        file: The file that is damaged or was never finished.
        target: The new file.
        topics: What metadata.yaml says of each topic. Readers leave a topic out where its channel
            says something else.

    Raises:
        BagError: The new file cannot be read whole.
        OSError: It cannot be written.
    """
    new = McapFile(target, LIBRARY)
    ids: dict[tuple[int, str, int], int] = {}
    with contextlib.closing(new):
        scan = McapScan(file, on_metadata=new.add_metadata)

        def channel_id(channel: Channel) -> int:
            key = channel.id, channel.topic, channel.schema_id
            if key not in ids:
                schema = scan.schemas.get(channel.schema_id) or Schema(0, b'', '', '')
                text = schema.data.decode(errors='replace')
                facts = _facts(channel, topics.get(channel.topic))
                ids[key] = new.add_channel(
                    channel.topic, schema.name, schema.encoding, text, facts
                )
            return ids[key]

        for old_id, sequence, log_ns, publish_ns, data in scan.messages():
            new_id = channel_id(scan.channels[old_id])
            new.add_message(new_id, log_ns, publish_ns, data, sequence)
            if new.pending_size >= CHUNK_BYTES:
                new.end_chunk()
        for channel in scan.channels.values():
            channel_id(channel)
        new.finish()
        new.sync()
    if readable_count(target) != new.message_count:
        raise BagError(f'{file}: what can be read of it does not make a file that others read')


def _facts(channel: Channel, topic: TopicRecord | None) -> dict[str, str]:
    """Return a channel's metadata, agreeing with what metadata.yaml says of its topic."""
    if topic is None:  # a declaration that a later one has replaced
        return dict(channel.metadata)
    known = {_QOS: qos_text(topic.qos), 'topic_type_hash': topic.type_hash}
    return {key: known.get(key, value) for key, value in channel.metadata.items()}


def _metadata(contents: Sequence[_Contents], said: StoredMetadata | None) -> BagMetadata:
    """Return what metadata.yaml is to say."""

    def qos(topic: str) -> tuple[QosProfile, ...]:
        return next((each.qos[topic] for each in contents if topic in each.qos), ())

    topics: dict[str, TopicRecord] = {}
    for each in contents:
        for channel, type_name in each.channels:
            count = each.counts.get(channel.id, 0)
            topic = topics.get(channel.topic)
            if topic is None:
                type_hash = channel.metadata.get('topic_type_hash', '')
                topic = TopicRecord(channel.topic, type_name, type_hash, qos(channel.topic), 0)
            topics[channel.topic] = topic._replace(message_count=topic.message_count + count)
    for each in contents:
        with contextlib.suppress(BagError):
            said = said or (parse_metadata(each.rosbag2, each.name) if each.rosbag2 else None)
    return BagMetadata(
        tuple(topics.values()),
        tuple(each.record for each in contents),
        said.custom_data if said else {},
        (said.ros_distro if said else '') or 'jazzy',
    )


def _qos(channel: Channel) -> tuple[QosProfile, ...]:
    text = channel.metadata.get(_QOS, '')
    try:
        return parse_qos(text, channel.topic) if text else ()
    except BagError:  # readers do without
        return ()
