"""Files written atomically: to a temporary file in the same folder, flushed, then renamed.

A process that is killed while writing leaves the old file or the new one, never a partial one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import contextlib
import json
import os
from pathlib import Path
from typing import Any, BinaryIO

from spikelane_sim.errors import one_line, SpikelaneError


class FileError(SpikelaneError):
    """A file cannot be written or read."""

    exit_status = 1


class WriteError(FileError):
    """A file cannot be written: the disk is full, or the folder does not allow it."""


def write_bytes_atomically(path: Path, content: bytes, *, sync: bool = True) -> None:
    """Write a file so that, whenever we are interrupted, the old or the new one is there, whole.

    Args:
        path: The file; folders above it are made.
        content: All of it.
        sync: Whether it must be on the disk on return. A killed process loses nothing without,
            only a machine that stops does.

    Raises:
        FileError: The file cannot be written; what was there before still is.
    """
    with written_whole(path, sync=sync) as file:
        file.write(content)


@contextlib.contextmanager
def written_whole(path: Path, *, sync: bool = True) -> Iterator[BinaryIO]:
    """Give a file to write to that gets its name once the block has ended without an error.

    Args:
        path: As in `write_bytes_atomically`.
        sync: As in `write_bytes_atomically`.

    Raises:
        FileError: As in `write_bytes_atomically`.
    """
    with path_written_whole(path, sync=sync) as unfinished, unfinished.open('wb') as file:
        yield file


@contextlib.contextmanager
def path_written_whole(path: Path, *, sync: bool = True) -> Iterator[Path]:
    """Give the path of a file to be made, which gets its name once the block has ended well.

    It is for what opens a file itself; otherwise it is `written_whole`.
    """
    path = Path(path)
    unfinished = path.with_name(f'.{path.name}.{os.getpid()}.part')
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield unfinished
        if sync:
            with unfinished.open('rb') as file:
                os.fsync(file.fileno())
        os.replace(unfinished, path)
        if sync:
            _sync_folder(path.parent)
    except OSError as error:
        # HDF5 gives the number, and a text of many lines.
        reason = os.strerror(error.errno) if error.errno else one_line(str(error))
        raise WriteError(f'{path}: cannot be written: {reason}') from error
    finally:
        with contextlib.suppress(OSError):
            unfinished.unlink()


def append_bytes(path: Path, content: bytes) -> None:
    """Add to the end of a file, all of it or nothing.

    Args:
        path: The file; neither it nor the folders above it need be there.
        content: What to add. It is not on the disk on return: a machine that stops may lose it.

    Raises:
        WriteError: It cannot be written; the file is as long as before.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Without a buffer nothing is left that closing the file would try to write once more.
        with path.open('ab', buffering=0) as file:
            before = file.tell()
            try:
                while content:
                    content = content[file.write(content) :]
            except OSError:
                file.truncate(before)
                raise
    except OSError as error:
        raise WriteError(f'{path}: cannot be written: {error.strerror}') from error


def write_text_atomically(path: Path, text: str) -> None:
    """Write a text as UTF-8; see `write_bytes_atomically`."""
    write_bytes_atomically(path, text.encode())


def write_json(path: Path, value: Any) -> None:
    """Write JSON that any reader takes, two spaces deep, keys in the order given.

    Raises:
        FileError: It holds NaN or infinity, which JSON lacks, or cannot be written.
    """
    try:
        text = json.dumps(_plain(value), indent=2, ensure_ascii=False, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise FileError(f'{path}: cannot be written as JSON: {error}') from None
    write_text_atomically(path, text + '\n')


def write_yaml(path: Path, value: Any) -> None:
    """Write YAML without tags, keys in the order given.

    Raises:
        FileError: It holds something YAML has no plain form for, or cannot be written.
    """
    import yaml

    try:
        text = yaml.safe_dump(_plain(value), sort_keys=False, allow_unicode=True)
    except yaml.YAMLError as error:
        raise FileError(f'{path}: cannot be written as YAML: {error}') from None
    write_text_atomically(path, text)


def _sync_folder(path: Path) -> None:
    """Put the new name itself on the disk; some file systems refuse, and that is no failure."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):
            os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _plain(value: Any) -> Any:
    """Return the value as the dicts, lists, texts and numbers that JSON and YAML share."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, 'tolist'):  # NumPy's arrays and scalars
        return value.tolist()
    return value
