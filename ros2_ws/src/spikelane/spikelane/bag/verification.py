"""Whether readers that we did not write take a bag: rosbags and the mcap library.

What these raise for damaged files is not ours to list: any exception is a refusal.
"""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import os
from pathlib import Path
import struct
import zlib

from mcap.reader import make_reader

from spikelane.bag.container import MAGIC
from spikelane.bag.metadata import FILE_NAME, read_metadata

_FOOTER_SIZE = 29 + len(MAGIC)


def has_sound_summary(file: Path) -> bool:
    """Return whether the mcap library takes the summary, and its checksum is right."""
    try:
        with file.open('rb') as stream:
            summary = make_reader(stream).get_summary()
            stream.seek(-_FOOTER_SIZE, os.SEEK_END)
            footer = stream.read(_FOOTER_SIZE)
            (start,) = struct.unpack_from('<Q', footer, 9)
            (checksum,) = struct.unpack_from('<I', footer, 25)
            if not checksum or not start or summary is None:
                return True  # none is needed
            stream.seek(start)
            found = zlib.crc32(stream.read()[: -(4 + len(MAGIC))])
        return found == int(checksum)
    except Exception:
        return False


def readable_count(file: Path) -> int | None:
    """Return how many messages rosbags reads, None where it refuses the file."""
    from rosbags.rosbag2.storage_mcap import McapReader

    reader = McapReader(file)
    try:
        reader.open()
        with contextlib.closing(reader):
            return sum(1 for _ in reader.messages(reader.connections))
    except Exception:
        return None


def is_described(folder: Path, files: Sequence[Path], count: int) -> bool:
    """Return whether metadata.yaml says what there is, and rosbags takes it."""
    from rosbags.rosbag2 import Reader

    try:
        said = read_metadata(folder / FILE_NAME)
        if said.message_count != count or len(said.file_names) != len(files):
            return False
        with Reader(folder) as reader:
            return sum(1 for _ in reader.messages()) == count
    except Exception:
        return False
