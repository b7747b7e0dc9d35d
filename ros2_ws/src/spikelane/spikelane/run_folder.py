"""The folder a run leaves, and how every file in it is written.

    runs/<name>/
        config.yaml     everything that determines the run, with seeds and versions
        bag/            what was said on the graph, MCAP
        trajectory.csv  one row per step
        metrics.json    what came out
        figures/        drawn from the above

A file is written beside its final name, flushed to the disk and renamed, so a run that is killed
leaves the old file or the new one, never half of one. A finished run is never written over: where
`lap` exists, the next run becomes `lap-2`, then `lap-3`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import contextlib
import dataclasses
import importlib.metadata
import itertools
import json
import os
from pathlib import Path
import platform
from typing import Any

from spikelane_sim.errors import SpikelaneError

#: Distributions whose version can change what a run computes.
VERSIONED = ('spikelane', 'numpy', 'numba', 'pybullet')


class RunFolderError(SpikelaneError):
    """A run's folder cannot be made, or a file of it not written or read."""


@dataclasses.dataclass(frozen=True)
class RunFolder:
    """The names of a run's files.

    Attributes:
        path: The folder; `RunFolder.create` makes one, `RunFolder(path)` names an existing one.
    """

    path: Path

    @classmethod
    def create(cls, path: Path, *, numbered: bool = True) -> RunFolder:
        """Make a new folder for a run.

        Args:
            path: The folder wanted; the folders above it are made too.
            numbered: Where it exists, make the first free one of `path-2`, `path-3` and so on:
                runs that start together never share one. Otherwise exactly this folder, which
                may exist if it is empty.

        Raises:
            RunFolderError: The folder cannot be made, or (not `numbered`) has something in it.
        """
        path = Path(path)
        _make_folder(path.parent, exist_ok=True)
        if not numbered:
            _make_folder(path, exist_ok=True)
            if any(path.iterdir()):
                raise RunFolderError(f'{path}: expected a new or empty folder, got one in use')
            return cls(path)
        for candidate in _candidates(path):
            with contextlib.suppress(FileExistsError):
                _make_folder(candidate)
                return cls(candidate)
        raise AssertionError('numbers do not end')

    @property
    def config(self) -> Path:
        """YAML: everything that determines the run."""
        return self.path / 'config.yaml'

    @property
    def bag(self) -> Path:
        """Folder of the MCAP recording; the recorder makes it."""
        return self.path / 'bag'

    @property
    def trajectory(self) -> Path:
        """CSV: one row per step."""
        return self.path / 'trajectory.csv'

    @property
    def metrics(self) -> Path:
        """JSON: what came out."""
        return self.path / 'metrics.json'

    @property
    def figures(self) -> Path:
        """Folder of the figures; whoever draws the first one makes it."""
        return self.path / 'figures'

    def write_config(self, values: Mapping[str, Any]) -> None:
        """Write `config.yaml`: the values, then the versions of what computed with them."""
        write_yaml(self.config, {**values, 'versions': versions()})

    def write_metrics(self, values: Mapping[str, Any]) -> None:
        """Write `metrics.json`."""
        write_json(self.metrics, values)


def lap_name(scenario: str | int, controller: str, lane: str, seed: int) -> str:
    """Return the usual name of the folder of one lap."""
    return f'lap-{scenario}-{controller}-{lane}-seed{seed}'


def versions() -> dict[str, str | None]:
    """Return the versions of what a run computes with; None for what is not installed."""
    found: dict[str, str | None] = {'python': platform.python_version()}
    for name in VERSIONED:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = None
    return found


def write_bytes_atomically(path: Path, content: bytes) -> None:
    """Write a file so that, whenever we are interrupted, the old or the new one is there, whole.

    Folders above it are made.

    Raises:
        RunFolderError: The file cannot be written; what was there before still is.
    """
    path = Path(path)
    beside = path.with_name(f'.{path.name}.{os.getpid()}.part')
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _write_and_sync(beside, content)
        os.replace(beside, path)
        _sync_folder(path.parent)
    except OSError as error:
        raise RunFolderError(f'{path}: cannot be written: {error.strerror}') from error
    finally:
        with contextlib.suppress(OSError):
            beside.unlink()


def write_text_atomically(path: Path, text: str) -> None:
    """Write a text as UTF-8; see `write_bytes_atomically`."""
    write_bytes_atomically(path, text.encode())


def write_json(path: Path, value: Any) -> None:
    """Write JSON that any reader takes, two spaces deep, keys in the order given.

    Raises:
        RunFolderError: It holds NaN or infinity, which JSON lacks, or cannot be written.
    """
    try:
        text = json.dumps(_plain(value), indent=2, ensure_ascii=False, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise RunFolderError(f'{path}: cannot be written as JSON: {error}') from None
    write_text_atomically(path, text + '\n')


def write_yaml(path: Path, value: Any) -> None:
    """Write YAML without tags, keys in the order given.

    Raises:
        RunFolderError: It holds something YAML has no plain form for, or cannot be written.
    """
    import yaml

    try:
        text = yaml.safe_dump(_plain(value), sort_keys=False, allow_unicode=True)
    except yaml.YAMLError as error:
        raise RunFolderError(f'{path}: cannot be written as YAML: {error}') from None
    write_text_atomically(path, text)


def _candidates(path: Path) -> Iterator[Path]:
    yield path
    yield from (path.with_name(f'{path.name}-{number}') for number in itertools.count(2))


def _make_folder(path: Path, exist_ok: bool = False) -> None:
    """Make a folder; one that exists stays a FileExistsError unless that is fine."""
    try:
        path.mkdir(parents=exist_ok, exist_ok=exist_ok)
    except OSError as error:
        if isinstance(error, FileExistsError) and not exist_ok:
            raise
        raise RunFolderError(f'{path}: cannot be made: {error.strerror}') from error


def _write_and_sync(path: Path, content: bytes) -> None:
    with path.open('wb') as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


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
