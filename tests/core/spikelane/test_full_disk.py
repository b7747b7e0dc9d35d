"""Commands on a full disk name the file and the cause, and leave only whole files."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import json
import os
from pathlib import Path
import resource
import signal
import subprocess
import sys

import numpy as np
import pytest
from safetensors.numpy import load_file

from spikelane.main import run
from spikelane.recording.record import written
from spikelane.runs.lap.trajectory import read_csv
from spikelane_controllers.dqn.visited_states import read_states
from spikelane_controllers.learning.scalar_log import ScalarLog
from spikelane_controllers.quantities import Axis, Quantity
from spikelane_sim.files import append_bytes, WriteError
from spikelane_sim.parsing import parse_json, read_json_file, read_yaml_file
from spikelane_sim.period import PERIOD_NS

_USUAL = ('--robot', 'kinematic', '--seed', '1')
_SHORT = (*_USUAL, '--param', 'simulator.episode.max_steps=40')
_EXPERIMENT = """
name: tiny
matrix: {controllers: [braitenberg], robots: [kinematic], seeds: 1, tasks: {evaluate: {}}}
"""
_COMMANDS = {
    'lap': ('lap', *_SHORT, '--transport', 'inprocess', '--out', '{disk}/out'),
    'lap --record': (
        *('lap', *_SHORT, '--transport', 'inprocess', '--record', 'all'),
        *('--out', '{disk}/out'),
    ),
    'evaluate': ('evaluate', *_SHORT, '--out', '{disk}/out'),
    'train rstdp': ('train', 'rstdp', *_USUAL, '--steps', '20', '--out', '{disk}/out'),
    'train dqn': ('train', 'dqn', *_USUAL, '--steps', '2', '--out', '{disk}/out'),
    'transfer': ('transfer', *_USUAL, '--states', '20', '--steps', '2', '--out', '{disk}/out'),
    'export': ('export', 'nir', 'scenario_1', '{disk}/lane.nir'),
    'experiment': ('experiment', '{folder}/tiny.yaml', '--out', '{disk}/out'),
    'report': ('report', '{folder}/runs', '--out', '{disk}/out'),
}


@contextlib.contextmanager
def limited_disk(folder: Path, size: int) -> Iterator[str]:
    """Let a folder take so many bytes, or no file larger than that where one may not mount.

    Yields:
        What the system says when that is not enough.
    """
    folder.mkdir()
    mount = ['mount', '-t', 'tmpfs', '-o', f'size={size}', 'tmpfs', str(folder)]
    can_mount = os.geteuid() == 0
    if can_mount and not subprocess.run(mount, capture_output=True, check=False).returncode:
        try:
            yield 'No space left on device'
        finally:
            subprocess.run(['umount', '--lazy', str(folder)], check=True)
        return
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield 'File too large'
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


def command(name: str, folder: Path, disk: Path) -> list[str]:
    """Return the arguments of a command whose results go to a disk."""
    (folder / 'tiny.yaml').write_text(_EXPERIMENT)
    runs = folder / 'runs'
    runs.mkdir(exist_ok=True)
    (runs / 'config.yaml').write_text(
        '{scenario: "1", controller: braitenberg, seed: 1, lane: outer}'
    )
    (runs / 'metrics.json').write_text(
        '{"completed": true, "steps": 4000, "lap_time_s": 200.0, "mean_abs_distance_m": 0.02, '
        '"max_abs_distance_m": 0.1, "mean_distance_m": 0.01}'
    )
    return [each.format(folder=folder, disk=disk) for each in _COMMANDS[name]]


def check_whole(file: Path) -> None:
    """Check that a file is there to its end."""
    content = file.read_bytes()
    readers = {
        '.json': read_json_file,
        '.yaml': read_yaml_file,
        '.csv': read_csv,
        '.safetensors': load_file,
        '.zst': read_states,
        '.jsonl': lambda path: list(map(parse_json, path.read_text().splitlines())),
    }
    if file.suffix in readers:
        readers[file.suffix](file)
        assert file.suffix == '.zst' or content
    elif file.suffix == '.svg':
        assert content.endswith(b'</svg>\n')
    elif file.suffix == '.png':
        assert content.endswith(b'IEND\xaeB`\x82')
    elif file.suffix == '.md':
        assert content.startswith(b'#')
        assert content.endswith(b'.\n')
    else:
        assert file.suffix in ('.log', '.webp'), file


@pytest.mark.timeout(300)
@pytest.mark.parametrize('name', _COMMANDS)
def test_a_command_on_a_full_disk_names_the_file_and_the_cause(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one line, with exit status 1; what it has written is whole."""
    disk = tmp_path / 'disk'
    arguments = command(name, tmp_path, disk)
    with limited_disk(disk, 8192) as cause:
        assert run(arguments) == 1
        lines = capsys.readouterr().err.splitlines()
        [line] = [each for each in lines if f': cannot be written: {cause}' in each]
        if name == 'experiment':  # which tells of its runs one by one
            assert f' {disk}/out/' in line
        else:
            assert lines == [line]
            assert line.startswith(f'spikelane {arguments[0]}: {disk}/')
        for file in disk.rglob('*'):
            assert not file.name.endswith('.part')
            if file.is_file():
                check_whole(file)


@pytest.mark.timeout(300)
def test_a_command_begins_nothing_where_there_is_no_space_at_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first file is named; no folder is left that the next try would find in use."""
    disk = tmp_path / 'disk'
    with limited_disk(disk, 4096) as cause:
        if cause == 'File too large':
            pytest.skip('mounting a small disk needs root')
        (disk / 'full').write_bytes(bytes(4096))
        for name in _COMMANDS:
            arguments = command(name, tmp_path, disk)
            assert run(arguments) == 1
            line = capsys.readouterr().err.splitlines()[-1]
            assert line.startswith(f'spikelane {arguments[0]}: {disk}/')
            assert f': cannot be written: {cause}' in line
            left = [file for file in disk.rglob('*') if file.is_file() and file.stat().st_size]
            assert left == [disk / 'full']
            assert (disk / 'out').exists() == (name in ('experiment', 'report'))


@pytest.mark.timeout(300)
@pytest.mark.parametrize('name', ['lap', 'report'])
def test_a_figure_that_does_not_fit_is_named(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All other files fit; a report says what else is missing."""
    disk = tmp_path / 'disk'
    arguments = command(name, tmp_path, disk)
    with limited_disk(disk, 65_536) as cause:
        assert run(arguments) == 1
        [line] = capsys.readouterr().err.splitlines()
        assert line.startswith(f'spikelane {name}: {disk}/out/figures/')
        assert f': cannot be written: {cause}' in line
        if name == 'report':
            lacking = line.partition('; the report lacks: ')[2]
            assert 'figure ' in lacking
            has_page = (disk / 'out/report.html').exists()
            assert has_page == ('page (report.html)' not in lacking)
        assert not list(disk.rglob('*.part'))


def test_a_recording_that_does_not_fit_is_named(tmp_path: Path) -> None:
    """However much of it has been written; it leaves nothing."""
    quantity = Quantity('values', 'noise', '1', (Axis('place', tuple(map(str, range(10_000)))),))
    rng = np.random.default_rng(0)
    disk, written_steps = tmp_path / 'disk', 0
    with limited_disk(disk, 24 << 20) as cause:
        with (  # noqa: PT012  # where it fails is not known
            pytest.raises(WriteError, match=rf'disk/recording\.nc: cannot be written: {cause}'),
            written(disk / 'recording.nc', [quantity], {}) as append,
        ):
            for step in range(1, 1000):
                append(step * PERIOD_NS, 1, step, {'values': rng.random((1, 10_000))})
                written_steps = step
        assert list(disk.iterdir()) == []
    assert 100 < written_steps < 300


class _Trained:
    """A training that has ended an episode."""

    steps = 7

    def scalars(self) -> dict[str, float]:
        """Return what is logged."""
        return {f'rollout/{number}': 1.0 for number in range(1000)}


def test_a_log_for_tensorboard_that_does_not_fit_is_named(tmp_path: Path) -> None:
    """By the training itself, not by a thread of its own."""
    training = _Trained()
    with limited_disk(tmp_path / 'disk', 4096) as cause:
        ScalarLog(tmp_path / 'disk', training, lambda: 0.0)  # type: ignore[arg-type]
        with pytest.raises(WriteError, match=rf'disk/events\.out\.tfevents\..*: {cause}$'):
            training.on_episode()  # type: ignore[attr-defined]


def test_what_cannot_be_added_to_a_file_leaves_it_as_it_was(tmp_path: Path) -> None:
    """This holds even if a part of the addition would have fitted."""
    with limited_disk(tmp_path / 'disk', 8192) as cause:
        file = tmp_path / 'disk/log.jsonl'
        append_bytes(file, b'first\n')
        with pytest.raises(WriteError, match=rf'log\.jsonl: cannot be written: {cause}'):
            append_bytes(file, bytes(10_000))
        assert file.read_bytes() == b'first\n'
        append_bytes(file, b'second\n')
        assert file.read_bytes() == b'first\nsecond\n'


def test_results_that_standard_output_cannot_take_are_an_error(tmp_path: Path) -> None:
    """One line and exit status 1 also where all else went well."""
    (tmp_path / 'tiny.yaml').write_text(_EXPERIMENT)
    listing = ['experiment', str(tmp_path / 'tiny.yaml'), '--dry-run']
    with open('/dev/full', 'w', encoding='utf-8') as full:
        done = subprocess.run(
            [sys.executable, '-m', 'spikelane.main', *listing],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert (done.returncode, done.stderr) == (
        1,
        'spikelane experiment: standard output: No space left on device\n',
    )


def test_an_error_of_writing_ends_a_command_with_status_1() -> None:
    """The command was right."""
    assert WriteError('x').exit_status == 1


def test_the_readers_here_refuse_half_a_file(tmp_path: Path) -> None:
    """Otherwise no test above could fail."""
    (tmp_path / 'a.json').write_text(json.dumps({'a': 1})[:-1])
    with pytest.raises(ValueError, match='not JSON'):
        check_whole(tmp_path / 'a.json')
