"""The folder a run leaves, and how every file in it is written.

    runs/<name>/
        config.yaml     everything that determines the run, with seeds and versions
        bag/            what was said on the graph, MCAP
        trajectory.csv  one row per step
        recording.nc    what happened inside the controller, on request
        episodes.csv    one row per episode of a training
        checkpoint.*    what a training stands at
        states.zst      states met in a training of the deep Q-network
        tensorboard/    its log
        answers.csv     of a replay, both answers to every observation
        laps/           of an evaluation, a folder of each lap
        metrics.json    what came out
        figures/        drawn from the above
        logs/           of the processes, where there were several
        parameters.yaml what the nodes were given

Every file is written whole (`spikelane_sim.files`). A finished run is never written over: where
`lap` exists, the next run becomes `lap-2`, then `lap-3`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import contextlib
import dataclasses
import errno
import functools
import importlib.metadata
import itertools
import os
from pathlib import Path
import platform
import subprocess
from typing import Any, TYPE_CHECKING

from spikelane.runs.input_files import input_digests
from spikelane_sim.files import FileError, write_json, write_yaml, WriteError
from spikelane_sim.kinds import check_kind, KindError
from spikelane_sim.parameters import first_difference
from spikelane_sim.parsing import ParseError, read_json_file, read_yaml_file
from spikelane_sim.simulator_parameters import current_config

if TYPE_CHECKING:
    from spikelane.runs.configuration import RunConfig

#: Distributions whose version can change what a run computes.
VERSIONED = ('spikelane', 'numpy', 'numba', 'pybullet', 'torch')
#: The distribution that has pybullet's wheels for Python 3.12 and later.
_PYBULLET_OTHERWISE = 'pybullet-arm64'

_GIT_S = 5.0  # to say which commit this is

#: Entries of `config.yaml` that tell how a run came about, and do not determine it.
_NOT_DETERMINING = ('given', 'command_line', 'versions')

#: The default folder of runs.
RUNS = Path('runs')


class RunFolderError(FileError):
    """A run's folder cannot be made."""

    exit_status = 2


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
        make_folder(path.parent, exist_ok=True)
        if not numbered:
            make_folder(path, exist_ok=True)
            if any(path.iterdir()):
                raise RunFolderError(f'{path}: expected a new or empty folder, got one in use')
            return cls(path)
        for candidate in _candidates(path):
            with contextlib.suppress(FileExistsError):
                make_folder(candidate)
                return cls(candidate)
        raise AssertionError('numbers do not end')

    @classmethod
    def begin(
        cls, run: RunConfig, out: Path | None, command_line: Sequence[str] = ()
    ) -> RunFolder:
        """Make the folder of a run, with its configuration in it.

        Args:
            run: What is going to be done.
            out: The folder, new or empty; None for the usual one, numbered where it exists.
            command_line: As in `write_config`.

        Raises:
            SpikelaneError: The run cannot be begun: then there is no folder that would be in the
                way of the next try. Or the folder is in use or cannot be made.
        """
        run.check()
        folder = cls.create(out or RUNS / run.usual_name, numbered=out is None)
        try:
            folder.write_config(run, command_line)
        except WriteError:
            with contextlib.suppress(OSError):
                folder.path.rmdir()
            raise
        return folder

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
    def recording(self) -> Path:
        """NetCDF: what the controller recorded of itself, on request (`spikelane.recording`)."""
        return self.path / 'recording.nc'

    @property
    def checkpoint(self) -> Path:
        """Safetensors: what a training stands at."""
        return self.path / 'checkpoint.safetensors'

    @property
    def episodes(self) -> Path:
        """CSV: one row per episode of a training."""
        return self.path / 'episodes.csv'

    @property
    def laps(self) -> Path:
        """Folder of an evaluation's laps, each a folder of its own."""
        return self.path / 'laps'

    @property
    def metrics(self) -> Path:
        """JSON: what came out."""
        return self.path / 'metrics.json'

    @property
    def figures(self) -> Path:
        """Folder of the figures; it is created with the first figure."""
        return self.path / 'figures'

    def write_config(self, run: RunConfig, command_line: Sequence[str] = ()) -> None:
        """Write `config.yaml`.

        It has all values that determine the run, digests of the files that they name, `given`,
        the `command_line` where there was one, and `versions`.

        Args:
            run: What is done.
            command_line: The words after `spikelane` with which somebody asked for it.
        """
        told = {'command_line': list(command_line)} if command_line else {}
        values = {**_with_inputs(run.to_dict()), 'given': run.given, **told}
        write_yaml(self.config, {**values, 'versions': versions()})

    def check_config(self, values: Mapping[str, Any]) -> None:
        """Check that the folder is of a run with this configuration, of whatever versions.

        What is in the files that it names must be the same.

        Raises:
            RunFolderError: It is of no run, or of another one.
        """
        try:
            found = read_yaml_file(self.config)
        except ParseError as error:
            raise RunFolderError(
                f"{self.path}: expected a run's folder, got none: config.yaml: {error}"
            ) from None
        wanted = _with_inputs(values)
        given = current_config(found) if isinstance(found, Mapping) else {}
        for name in _NOT_DETERMINING:
            given.pop(name, None)
        for name in (*wanted, *given):
            if given.get(name) != wanted.get(name):
                where, expected, got = first_difference(name, wanted.get(name), given.get(name))
                raise RunFolderError(
                    f'{self.path}: expected a run with {where} {expected}, got one with {got}'
                )

    def write_metrics(self, values: Mapping[str, Any]) -> None:
        """Write `metrics.json`."""
        write_json(self.metrics, values)

    def read_metrics(
        self, kind: Any = dict[str, Any], check: Callable[[Any], None] | None = None
    ) -> dict[str, Any]:
        """Read `metrics.json`; arguments and errors are those of `read_json`."""
        return dict(self.read_json(self.metrics.name, kind, check))

    def read_json(self, name: str, kind: Any, check: Callable[[Any], None] | None = None) -> Any:
        """Read a JSON file of the folder.

        Args:
            name: Name of the file.
            kind: What it must be, as in `kinds.check_kind`.
            check: Checks relations between its values; raises KindError.

        Raises:
            FileError: It is not there, not JSON, or of another kind.
        """
        try:
            value = check_kind(read_json_file(self.path / name), kind)
            if check is not None:
                check(value)
        except (ParseError, KindError) as error:
            raise FileError(f'{self.path / name}: {error}') from None
        return value

    def write_json(self, name: str, values: Mapping[str, Any]) -> None:
        """Write another JSON file into the folder."""
        write_json(self.path / name, values)


def _with_inputs(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration and, where it names files, what is in them."""
    inputs = input_digests(values)
    return {**values, 'inputs': inputs} if inputs else dict(values)


def versions() -> dict[str, str | None]:
    """Return the versions of what a run computes with, and the machine.

    Returns:
        By name; None for what is not installed, and for the commit where this is no checkout.
    """
    found: dict[str, str | None] = {'python': platform.python_version()}
    for name in VERSIONED:
        found[name] = _version(name)
    found['pybullet'] = found['pybullet'] or _version(_PYBULLET_OTHERWISE)
    return {**found, 'commit': commit(), 'machine': machine()}


def _version(distribution: str) -> str | None:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


@functools.cache
def commit() -> str | None:
    """Return the commit of the source that runs, with a + where files differ from it."""
    here = Path(__file__).resolve()
    try:
        # An installed package may lie in somebody else's checkout.
        _git(here.parent, 'ls-files', '--error-unmatch', here.name)
        # Without --exclude a tag would stand for the commit that it is of.
        found = _git(
            here.parent, 'describe', '--always', '--abbrev=12', '--dirty=+', '--exclude=*'
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return found.strip() or None


def _git(folder: Path, *arguments: str) -> str:
    """Return what git says; without locks, so that nobody else's git has to wait."""
    command = ['git', '--no-optional-locks', '-C', str(folder), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_GIT_S, check=True)
    return done.stdout


@functools.cache
def machine() -> str:
    """Return what computes: kernel, processors and their name."""
    try:
        lines = Path('/proc/cpuinfo').read_text('utf-8').splitlines()
    except OSError:
        lines = []
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    processor = names[0] if names else platform.machine()
    return f'{platform.system()} {platform.release()}, {os.cpu_count()} x {processor}'


def _candidates(path: Path) -> Iterator[Path]:
    yield path
    yield from (path.with_name(f'{path.name}-{number}') for number in itertools.count(2))


def make_folder(path: Path, exist_ok: bool = False) -> None:
    """Make a folder, and where `exist_ok` those above it.

    Raises:
        FileExistsError: It exists, and that is not fine.
        RunFolderError: It cannot be made.
        WriteError: It cannot be made since the disk is full.
    """
    try:
        path.mkdir(parents=exist_ok, exist_ok=exist_ok)
    except OSError as error:
        if isinstance(error, FileExistsError) and not exist_ok:
            raise
        kind = WriteError if error.errno in (errno.ENOSPC, errno.EDQUOT) else RunFolderError
        raise kind(f'{path}: cannot be made: {error.strerror}') from error
