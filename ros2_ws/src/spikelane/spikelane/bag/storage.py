"""Which files make up a bag, and what they are.

A folder with a metadata.yaml has the files that it names; without one, the files of one recording,
`NAME_0`, `NAME_1` and so on. What a file is, its first bytes say; where they are lost or empty,
metadata.yaml or the name's ending does. What is no bag is refused with what it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import contextlib
from pathlib import Path, PurePosixPath
import re
import tempfile
from typing import NamedTuple

import zstandard

from spikelane.bag.container import MAGIC
from spikelane.bag.decompression import Budget, BudgetError, first_bytes
from spikelane.bag.foreign import foreign_format
from spikelane.bag.metadata import FILE_NAME, NEWEST_VERSION, read_metadata, StoredMetadata
from spikelane_sim.errors import BagError, one_line

_HEADS = {MAGIC: 'mcap', b'SQLite format 3\0': 'sqlite3'}
_ENDINGS = {'.mcap': 'mcap', '.db3': 'sqlite3'}
_COMPRESSED = '.zstd'
#: SQLite keeps in a file next to a database what has not been written into it yet.
_UNFINISHED = ('-wal', '-journal')
_HEAD_BYTES = 32
_NAMED = 4  # names in a message at most

EXPECTED = 'expected an .mcap or .db3 file or a bag folder'


class StoredFile(NamedTuple):
    """A file of a bag."""

    path: Path
    storage: str  # mcap or sqlite3
    is_compressed: bool = False  # the whole file, with zstd

    @contextlib.contextmanager
    def opened(self) -> Iterator[tuple[Path, list[str]]]:
        """Give a file with the content, decompressed, and what could not be decompressed.

        Raises:
            OSError: It cannot be read, or there is no room for the decompressed file.
        """
        if not self.is_compressed:
            yield self.path, []
            return
        with tempfile.TemporaryDirectory(prefix='spikelane-') as folder:
            content = Path(folder) / self.path.name.removesuffix(_COMPRESSED)
            damage = []
            with self.path.open('rb') as source, content.open('wb') as target:
                try:
                    Budget(self.path.stat().st_size).unpack(source, target)
                except (zstandard.ZstdError, BudgetError) as error:
                    damage.append(f'{self.path.name}: cannot be decompressed to its end: {error}')
            yield content, damage


class BagFiles(NamedTuple):
    """The files of a bag, in order; all of one storage."""

    files: tuple[StoredFile, ...]
    storage: str
    metadata: StoredMetadata | None
    notes: tuple[str, ...]


def locate(path: Path, *, has_metadata: bool = True) -> BagFiles:
    """Find the files of a bag.

    Args:
        path: A bag's folder, or one of its files.
        has_metadata: Whether a metadata.yaml in the folder is read.

    Raises:
        BagError: There is no bag, a file is missing, or there are several recordings.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise BagError(f'{path!a}: expected a path in UTF-8') from None
    try:
        if path.is_file():
            return _located(path, [path], None, [])
        if path.is_dir():
            return _folder(path, has_metadata)
    except OSError as error:
        raise BagError(f'{path}: cannot be read: {error.strerror}') from None
    raise BagError(f'{path}: {EXPECTED}, found nothing')


def later_files(files: Sequence[Path]) -> list[Path]:
    """Return files of the same recording with higher numbers, which a killed recorder left."""
    name, last, ending = _parts(files[-1])
    found = [file for file in files[-1].parent.iterdir() if _is_named_like_a_bag(file)]
    numbered = {_parts(file)[1]: file for file in found if _parts(file)[::2] == (name, ending)}
    return [numbered[number] for number in sorted(numbered) if number > last]


def _folder(folder: Path, has_metadata: bool) -> BagFiles:
    metadata = None
    notes: list[str] = []
    if has_metadata and (folder / FILE_NAME).exists():
        metadata = read_metadata(folder / FILE_NAME)
        if metadata.version > NEWEST_VERSION:
            notes.append(
                f'{FILE_NAME} is of version {metadata.version}, newer than {NEWEST_VERSION}: '
                'read as far as it is the same'
            )
    present = sorted(file for file in folder.iterdir() if _is_named_like_a_bag(file))
    if metadata is not None and metadata.file_names:
        files = _named_files(folder, metadata.file_names)
        others = [file for file in present if file not in files]
        if others:
            verb = 'are' if len(others) > 1 else 'is'
            notes.append(f'{_names(others)} {verb} not named in {FILE_NAME}: not read')
    else:
        files = _one_recording(folder, present)
    return _located(folder, files, metadata, notes)


def _named_files(folder: Path, names: Sequence[str]) -> list[Path]:
    """Return the files that metadata.yaml names, also with the folder in front."""
    found: dict[Path, None] = {}
    missing = []
    for name in names:
        given = PurePosixPath(name)
        last = given.name
        # Nothing outside the folder is read, whatever metadata.yaml says.
        inside = [] if given.is_absolute() or '..' in given.parts else [name]
        candidates = [*inside, last, last + _COMPRESSED, last.removesuffix(_COMPRESSED)]
        files = (folder / each for each in candidates if each)
        file = next((each for each in files if each.is_file()), None)
        if file is None:
            missing.append(name)
        else:
            found[file] = None
    if missing:
        verb = 'are' if len(missing) > 1 else 'is'
        raise BagError(f'{folder}: {_names(missing)} {verb} missing')
    return list(found)


def _one_recording(folder: Path, present: Sequence[Path]) -> list[Path]:
    """Return the files of the only recording in a folder, in order."""
    recordings: dict[tuple[str, str], dict[int, Path]] = {}
    for file in present:
        name, number, ending = _parts(file)
        # The same file may be there whole and compressed; sorted, the whole one comes first.
        recordings.setdefault((name, ending), {}).setdefault(number, file)
    if not recordings:
        raise BagError(f'{folder}: expected .mcap or .db3 files, found none{_hint(folder)}')
    if len(recordings) > 1:
        firsts = [files[min(files)] for files in recordings.values()]
        raise BagError(
            f'{folder}: expected one recording, got {len(recordings)} without a {FILE_NAME}: '
            f'{_names(firsts)}; give one of these files'
        )
    (files,) = recordings.values()
    return [files[number] for number in sorted(files)]


def _located(
    path: Path, files: Sequence[Path], metadata: StoredMetadata | None, notes: list[str]
) -> BagFiles:
    stored = tuple(_stored(file, metadata) for file in files)
    storages = sorted({file.storage for file in stored})
    if len(storages) > 1:
        raise BagError(f'{path}: expected files of one storage, got {" and ".join(storages)}')
    for file in stored:
        for ending in _UNFINISHED:
            other = file.path.with_name(file.path.name + ending)
            if other.exists() and other.stat().st_size:
                notes.append(f'{other.name} may have messages that are not in {file.path.name}')
    return BagFiles(stored, storages[0], metadata, tuple(notes))


def _stored(file: Path, metadata: StoredMetadata | None) -> StoredFile:
    head, is_compressed = first_bytes(file, _HEAD_BYTES)
    for start, storage in _HEADS.items():
        if head.startswith(start):
            return StoredFile(file, storage, is_compressed)
    foreign = foreign_format(file.name, head)
    if foreign:
        raise BagError(f'{file}: {EXPECTED}, got {foreign}')
    said = metadata.storage if metadata else ''
    ending = _ENDINGS.get(_parts(file)[2], '')
    if said in _HEADS.values():
        return StoredFile(file, said, is_compressed)
    if said:
        raise BagError(f'{file}: expected storage mcap or sqlite3, got {said!r}')
    if not ending:
        got = f'a file that begins with {head[:8]!r}' if head else 'an empty file'
        raise BagError(f'{file}: {EXPECTED}, got {got}')
    return StoredFile(file, ending, is_compressed)


def _is_named_like_a_bag(file: Path) -> bool:
    return _parts(file)[2] in _ENDINGS and not file.name.startswith('.') and file.is_file()


def _parts(file: Path) -> tuple[str, int, str]:
    """Return name, number and ending of NAME_2.mcap or NAME_2.mcap.zstd."""
    plain = PurePosixPath(file.name.removesuffix(_COMPRESSED))
    number = re.fullmatch(r'(.*)_(\d{1,9})', plain.stem, re.DOTALL)
    if number is None:
        return plain.stem, 0, plain.suffix
    return number[1], int(number[2]), plain.suffix


def _hint(folder: Path) -> str:
    """Return what else a folder has that events may be in."""
    for file in sorted(folder.iterdir()):
        if file.is_file() and (foreign := foreign_format(file.name, first_bytes(file, 32)[0])):
            return f'; {file.name} is {foreign}'
    return ''


def _names(files: Sequence[Path | str]) -> str:
    """Return the first names."""
    names = [one_line(PurePosixPath(file).name) for file in files[:_NAMED]]
    more = f' and {len(files) - _NAMED} more' if len(files) > _NAMED else ''
    return ', '.join(names) + more
