"""The states met in a training, kept for a network that is to learn from them (section 3.5).

A state is the counts of a state image, (rows, columns), each at most 255. The file is a sequence
of zstd frames that any zstd program unpacks to the counts, one state after the other; what our
reader also needs, shape and lengths, is in skippable frames between. It only grows: a run that
was killed leaves states that its checkpoint does not know of yet, and drops them when it goes on.
"""

from __future__ import annotations

from collections.abc import Iterator
import json
import math
from pathlib import Path
import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
import zstandard

from spikelane_sim.errors import CheckpointChoiceError, CheckpointError
from spikelane_sim.files import append_bytes, FileError, write_bytes_atomically
from spikelane_sim.parsing import parse_json, ParseError

FORMAT = 'spikelane-states'
VERSION = 1
NAME = 'states.zst'

States = NDArray[np.uint8]

_SKIPPABLE = struct.Struct('<II')  # magic number, bytes that follow
_MAGIC = 0x184D2A50
_BLOCK = struct.Struct('<II')  # states, bytes of the frame that has them
_LARGEST = 255
_LONGEST = 4096  # rows or columns of a state
_MOST_BYTES = 2**31  # of all states unpacked: a million actions of the paper's states have half


class _Block(NamedTuple):
    """States written together."""

    states: int
    start: int  # of their frame in the file
    end: int


class StateStore:
    """Appends states to a file, compressed; either `begin` or `resume` comes first."""

    def __init__(self, path: Path, shape: tuple[int, int]) -> None:
        """Prepare a store.

        Args:
            path: Path of the file.
            shape: Rows and columns of a state.
        """
        self._path = path
        self._shape = shape
        self._pending: list[bytes] = []

    def begin(self) -> None:
        """Write a file without states, over any that is there.

        Raises:
            FileError: It cannot be written.
        """
        write_bytes_atomically(self._path, _head(self._shape), sync=False)

    def resume(self, states: int) -> None:
        """Keep the first states of the file and drop the others.

        Raises:
            CheckpointError: It is not there, of another shape, or has fewer.
            FileError: It cannot be written.
        """
        self._pending = []
        content = _read(self._path)
        end = _check_head(self._path, content, self._shape)
        kept = 0
        while kept < states and (block := _block(content, end)) is not None:
            kept, end = kept + block.states, block.end
        if kept != states:
            raise CheckpointError(f'{self._path}: expected {states} states, got {kept}')
        if end < len(content):
            try:
                with self._path.open('r+b') as file:
                    file.truncate(end)
            except OSError as error:
                raise FileError(f'{self._path}: cannot be written: {error.strerror}') from error

    def append(self, counts: NDArray[np.integer]) -> None:
        """Add a state, (rows, columns); counts above 255 are kept as 255."""
        self._pending.append(np.minimum(counts, _LARGEST).astype(np.uint8).tobytes())

    def flush(self) -> None:
        """Write the states added since the last call.

        Raises:
            FileError: They cannot be written.
        """
        if not self._pending:
            return
        frame = zstandard.ZstdCompressor(write_checksum=True).compress(b''.join(self._pending))
        entry = _skippable(_BLOCK.pack(len(self._pending), len(frame)))
        append_bytes(self._path, entry + frame)
        self._pending = []


def read_states(path: Path) -> States:
    """Read the states met in a training.

    Args:
        path: Path of the file, or of the training's folder.

    Returns:
        Counts, (n, rows, columns).

    Raises:
        CheckpointError: There are none, or the file is truncated or no such file.
    """
    file = Path(path) / NAME if Path(path).is_dir() else Path(path)
    content = _read(file)
    end = _check_head(file, content)
    blocks = list(_blocks(file, content, end))
    shape = (sum(block.states for block in blocks), *_shape(content))
    if math.prod(shape) > _MOST_BYTES:
        raise CheckpointError(
            f'{file}: expected at most {_MOST_BYTES} bytes of states, got {math.prod(shape)}'
        )
    states, first = np.empty(shape, np.uint8), 0
    for block in blocks:
        part = states[first : first + block.states]
        first += block.states
        try:
            unpacked = _unpack(content[block.start : block.end], part.nbytes)
        except zstandard.ZstdError as error:
            raise CheckpointError(f'{file}: cannot be unpacked: {error}') from None
        if len(unpacked) != part.nbytes:
            raise CheckpointError(
                f'{file}: expected {part.nbytes} bytes of states, got {len(unpacked)}'
            )
        part[:] = np.frombuffer(unpacked, np.uint8).reshape(part.shape)
    return states


def _unpack(frame: bytes, size: int) -> bytes:
    """Unpack a zstd frame of this size; of a larger one only one byte more."""
    with zstandard.ZstdDecompressor().stream_reader(frame) as reader:
        return reader.read(size + 1)


def _head(shape: tuple[int, int]) -> bytes:
    about = {'format': FORMAT, 'version': VERSION, 'rows': shape[0], 'columns': shape[1]}
    return _skippable(json.dumps(about).encode())


def _skippable(content: bytes) -> bytes:
    return _SKIPPABLE.pack(_MAGIC, len(content)) + content


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise CheckpointChoiceError(
            f'{file}: expected the states of a training, got none: {error.strerror}'
        ) from None


def _payload(content: bytes, start: int) -> bytes | None:
    """Return what is in a skippable frame, None where none is whole."""
    if len(content) < start + _SKIPPABLE.size:
        return None
    magic, length = _SKIPPABLE.unpack_from(content, start)
    first = start + _SKIPPABLE.size
    is_whole = magic == _MAGIC and len(content) >= first + length
    return content[first : first + length] if is_whole else None


def _about(content: bytes) -> dict[str, int | str]:
    try:
        about = parse_json(_payload(content, 0) or b'null')
    except ParseError:
        about = None
    return about if isinstance(about, dict) else {}


def _shape(content: bytes) -> tuple[int, int]:
    about = _about(content)
    return int(about['rows']), int(about['columns'])


def _check_head(file: Path, content: bytes, shape: tuple[int, int] | None = None) -> int:
    """Check the head and return where it ends."""
    about = _about(content)
    if about.get('format') != FORMAT:
        raise CheckpointError(f'{file}: expected the states of a training, got another file')
    if about.get('version') != VERSION:
        raise CheckpointError(f'{file}: expected version {VERSION}, got {about.get("version")}')
    sides = [about.get(name) for name in ('rows', 'columns')]
    if not all(isinstance(side, int) and 0 < side <= _LONGEST for side in sides):
        raise CheckpointError(
            f'{file}: expected rows and columns from 1 to {_LONGEST}, got {about!s:.80}'
        )
    if shape is not None and shape != _shape(content):
        raise CheckpointError(f'{file}: expected states of {shape}, got {_shape(content)}')
    return _SKIPPABLE.size + len(_payload(content, 0) or b'')


def _block(content: bytes, start: int) -> _Block | None:
    """Return the block that begins here, None where none is whole."""
    entry = _payload(content, start)
    if entry is None or len(entry) != _BLOCK.size:
        return None
    states, length = _BLOCK.unpack(entry)
    first = start + _SKIPPABLE.size + _BLOCK.size
    return _Block(states, first, first + length) if len(content) >= first + length else None


def _blocks(file: Path, content: bytes, start: int) -> Iterator[_Block]:
    while start < len(content):
        block = _block(content, start)
        if block is None:
            raise CheckpointError(f'{file}: expected a whole file, got one truncated')
        yield block
        start = block.end
