"""Reading bags, also those that were cut, killed or damaged: every message that is there.

What could not be read is said in `BagReader.damage`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from mcap.records import Channel, Schema

from spikelane.bag.metadata import parse_metadata, StoredMetadata
from spikelane.bag.scan import McapScan
from spikelane.bag.storage import BagFiles, locate, StoredFile
from spikelane_sim.errors import BagError


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
        is_cut: Whether a file lacks its end, as after a kill; known after `messages` has ended.
    """

    def __init__(self, path: Path, located: BagFiles | None = None) -> None:
        """Find the bag's files.

        Args:
            path: The bag's folder, or one of its files.
            located: Its files, where they have been found already.

        Raises:
            BagError: There is no bag, or one of another storage.
        """
        self.path = Path(path)
        self._located = located = located or locate(self.path)
        if located.storage != 'mcap':
            raise BagError(f'{self.path}: expected MCAP storage, got {located.storage}')
        self.metadata: StoredMetadata | None = located.metadata
        self.files = [file.path for file in located.files]
        self.topics: dict[str, BagTopic] = {}
        self.damage: list[str] = []
        self.is_cut = False

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
        wanted = frozenset(topics)
        for file in self._located.files:
            try:
                yield from self._file_messages(file, wanted)
            except OSError as error:
                self.damage.append(f'{file.path.name}: cannot be read: {error.strerror}')

    def _file_messages(self, file: StoredFile, topics: frozenset[str]) -> Iterator[BagMessage]:
        names: dict[int, tuple[str, str]] = {}

        def is_wanted(channel: Channel, schema: Schema | None) -> bool:
            self._declare(channel, schema)
            names[channel.id] = (channel.topic, schema.name if schema else '')
            return not topics or channel.topic in topics

        def note(name: str, values: dict[str, str]) -> None:
            if name == 'rosbag2' and self.metadata is None:
                text = values.get('serialized_metadata', '')
                self.metadata = parse_metadata(text, file.path.name)

        with file.opened() as (content, damage):
            self.damage += damage
            scan = McapScan(
                content,
                original_size=file.path.stat().st_size,
                is_wanted=is_wanted,
                on_metadata=note,
            )
            for channel_id, _, log_time_ns, publish_time_ns, data in scan.messages():
                yield BagMessage(*names[channel_id], log_time_ns, publish_time_ns, data)
        self.damage += [f'{file.path.name}: {each}' for each in scan.damage]
        self.is_cut |= not scan.is_complete

    def _declare(self, channel: Channel, schema: Schema | None) -> None:
        topic = BagTopic(
            name=channel.topic,
            type_name=schema.name if schema else '',
            schema_encoding=schema.encoding if schema else '',
            schema_text=schema.data.decode(errors='replace') if schema else '',
            type_hash=channel.metadata.get('topic_type_hash', ''),
            offered_qos_profiles=channel.metadata.get('offered_qos_profiles', ''),
        )
        self.topics.setdefault(topic.name, topic)
