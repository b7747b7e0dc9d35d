"""What does the runs: how their processes' ends are told."""

from __future__ import annotations

from pathlib import Path
import socket
import sys
import time

import pytest

from spikelane.experiment.engine import Ended, ended_run
from spikelane.experiment.ray import RayEngine
from spikelane.experiment.worker import LOG, main
from spikelane_sim.errors import SpikelaneError


@pytest.mark.parametrize(
    ('status', 'expected'),
    [
        (0, Ended('a', 0, '')),
        (-9, Ended('a', -9, 'killed by signal 9')),
        (143, Ended('a', -15, 'killed by signal 15')),
        (130, Ended('a', -2, 'killed by signal 2')),
        (1, Ended('a', 1, 'no such lane')),
    ],
)
def test_an_end_is_told_with_its_signal_or_the_last_line(
    tmp_path: Path, status: int, expected: Ended
) -> None:
    """A signal is nobody's fault, so that the run can be begun again."""
    (tmp_path / LOG).parent.mkdir()
    (tmp_path / LOG).write_text('driving\nno such lane\n\n')
    assert ended_run('a', status, tmp_path) == expected


def test_a_process_that_said_nothing_has_its_status(tmp_path: Path) -> None:
    """There is nothing else to tell, while the disk is not full."""
    assert ended_run('a', 3, tmp_path) == Ended('a', 3, 'ended with status 3')


def test_without_ray_it_is_told_how_to_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody else needs it."""
    monkeypatch.setitem(sys.modules, 'ray', None)
    with pytest.raises(SpikelaneError, match=r"pip install 'spikelane\[ray\]'$"):
        RayEngine(None, None)


@pytest.mark.parametrize('address', ['', 'nonsense', '127.0.0.1', '127.0.0.1:x', 'ray://:7'])
def test_what_is_no_address_of_a_cluster_is_refused(address: str) -> None:
    """Rather than handed to Ray."""
    pytest.importorskip('ray')
    with pytest.raises(SpikelaneError) as error:
        RayEngine(address, None)
    assert str(error.value) == (
        f"--address: expected HOST:PORT, ray://HOST:PORT or auto, got '{address}'"
    )


@pytest.mark.parametrize('scheme', ['', 'ray://'])
def test_an_address_where_nobody_listens_is_told_at_once(scheme: str) -> None:
    """Ray would try for minutes, with warnings of its own."""
    pytest.importorskip('ray')
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))  # and does not listen
        address = f'{scheme}127.0.0.1:{taken.getsockname()[1]}'
        start_s = time.monotonic()
        with pytest.raises(SpikelaneError) as error:
            RayEngine(address, None)
    assert str(error.value) == (
        f'--address: expected a Ray cluster at {address}, got: Connection refused'
    )
    assert time.monotonic() - start_s < 10


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        (None, 'run.json: cannot be read: No such file'),
        ('{', 'run.json: not JSON: '),
        (
            '{"identity": {"task": "fly"}, "point": {"controller": "rstdp", "scenario": "1", '
            '"seed": 1, "transport": "inprocess", "parameters": {}, "course": ""}, '
            '"options": {}, "checkpoint": null}',
            "task: expected one of train, transfer, evaluate, got 'fly'",
        ),
    ],
)
def test_a_folder_that_is_no_run_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str | None, message: str
) -> None:
    """Status 1, and the last line says why."""
    if text is not None:
        (tmp_path / 'run.json').write_text(text)
    assert main([str(tmp_path)]) == 1
    assert message in capsys.readouterr().err


def test_a_folder_that_this_machine_does_not_see_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As on a cluster without a common file system."""
    assert main([str(tmp_path / 'nowhere')]) == 1
    assert 'every machine that takes part must see the folder' in capsys.readouterr().err
