"""Folders that one process at a time works in."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
from pathlib import Path
import subprocess
import sys
import time

import pytest

from spikelane.lock import locked
from spikelane_sim.files import FileError

#: Holds the folder in its argument until it is told to end.
HOLDER = """
import sys
from pathlib import Path
from spikelane.lock import locked
with locked(Path(sys.argv[1])):
    print('held', flush=True)
    sys.stdin.read()
"""


@contextlib.contextmanager
def held(path: Path) -> Iterator[subprocess.Popen[str]]:
    """Let another process hold a folder."""
    command = [sys.executable, '-c', HOLDER, str(path)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == 'held\n'
        try:
            yield holder
        finally:
            holder.kill()


def test_who_holds_a_folder_is_said(tmp_path: Path) -> None:
    """By the number of its process; another folder is free."""
    (tmp_path / 'one').mkdir()
    (tmp_path / 'other').mkdir()
    with held(tmp_path / 'one') as holder:
        with pytest.raises(FileError) as error, locked(tmp_path / 'one'):
            pass
        with locked(tmp_path / 'other'):
            pass
    assert str(error.value) == f'{tmp_path / "one"}: another process works here: {holder.pid}'


def test_a_process_leaves_a_folder_however_it_ends(tmp_path: Path) -> None:
    """Killed, say; nothing is left in the folder."""
    with held(tmp_path) as holder:
        holder.kill()
        with locked(tmp_path, patience_s=30.0):
            pass
    with locked(tmp_path):
        assert os.listdir(tmp_path) == []


def test_it_is_waited_for_as_long_as_one_has_patience(tmp_path: Path) -> None:
    """And no longer."""
    start_s = time.monotonic()
    with locked(tmp_path), pytest.raises(FileError), locked(tmp_path, patience_s=0.3):
        pass
    assert 0.3 <= time.monotonic() - start_s < 5.0


def test_there_must_be_a_folder(tmp_path: Path) -> None:
    """What there is instead, nothing or a file, is said."""
    (tmp_path / 'file').touch()
    for name, problem in (('nowhere', 'No such file'), ('file', 'Not a directory')):
        message = f'{name}: cannot be opened: {problem}'
        with pytest.raises(FileError, match=message), locked(tmp_path / name):
            pass
