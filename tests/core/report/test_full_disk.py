"""A report on a full disk says what it lacks."""

from __future__ import annotations

from collections.abc import Iterator
import os
from pathlib import Path
import resource
import signal
import subprocess

import pytest

from spikelane.main import run
from spikelane_sim.files import WriteError


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Give a folder that takes 64 kB, or no file larger than that where root may not mount."""
    disk = tmp_path / 'disk'
    disk.mkdir()
    mount = ['mount', '-t', 'tmpfs', '-o', 'size=64k', 'tmpfs', str(disk)]
    can_mount = os.geteuid() == 0
    if can_mount and not subprocess.run(mount, capture_output=True, check=False).returncode:
        yield disk
        subprocess.run(['umount', '--lazy', str(disk)], check=True)
        return
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (65_536, before[1]))
    yield disk
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.timeout(300)
def test_a_report_on_a_full_disk_names_what_it_lacks(
    tmp_path: Path, small_disk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The cause comes first, then page, tables and figures; no half of a file is left."""
    folder = tmp_path / 'runs'
    folder.mkdir()
    (folder / 'config.yaml').write_text(
        '{scenario: "1", controller: braitenberg, seed: 1, lane: outer}'
    )
    (folder / 'metrics.json').write_text(
        '{"completed": true, "steps": 4000, "lap_time_s": 200.0, "mean_abs_distance_m": 0.02, '
        '"max_abs_distance_m": 0.1, "mean_distance_m": 0.01}'
    )
    assert run(['report', str(folder), '--out', str(small_disk / 'report')]) == 1
    [line] = capsys.readouterr().err.strip().splitlines()
    assert line.startswith(f'spikelane report: {small_disk}/report/figures/')
    cause, _, lacking = line.partition('; the report lacks: ')
    assert 'cannot be written: ' in cause
    assert 'figure ' in lacking
    assert 'page (report.html)' in lacking
    assert not (small_disk / 'report/report.html').exists()
    assert not list(small_disk.rglob('*.part'))


def test_an_error_of_writing_ends_a_command_with_status_1() -> None:
    """The command was right."""
    assert WriteError('x').exit_status == 1
