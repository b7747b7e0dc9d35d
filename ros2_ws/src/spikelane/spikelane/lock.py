"""A folder that one process at a time works in: two would destroy each other's results.

On a network file system only processes of one machine keep each other out: Linux locks a
directory on the machine alone.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import fcntl
import os
from pathlib import Path
import time

from spikelane.interruption import check
from spikelane_sim.files import FileError

_LOCKS = Path('/proc/locks')
_POLL_S = 0.05


@contextlib.contextmanager
def locked(path: Path, patience_s: float = 0.0) -> Iterator[None]:
    """Hold a folder for this process; the lock goes with the process, however it ends.

    Args:
        path: The folder.
        patience_s: How long to wait for another process [s].

    Raises:
        FileError: There is no such folder, or another process does not leave it.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise FileError(f'{path}: cannot be opened: {error.strerror}') from None
    try:
        deadline_s = time.monotonic() + patience_s
        while not _try_lock(descriptor):
            if time.monotonic() >= deadline_s:
                raise FileError(f'{path}: another process works here{_holder(descriptor)}')
            check()
            time.sleep(_POLL_S)
        yield
    finally:
        os.close(descriptor)


def _try_lock(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _holder(descriptor: int) -> str:
    """Return which process has the lock, to be put after a sentence; '' if it is unknown."""
    status = os.fstat(descriptor)
    device = f'{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}'
    place = f'{device}:{status.st_ino}'
    with contextlib.suppress(OSError):
        # As `1: FLOCK ADVISORY WRITE 2234 fe:00:3997898 0 EOF` (proc(5)).
        for line in _LOCKS.read_text('ascii').splitlines():
            _, kind, _, _, process, where, *_ = line.split()
            if (kind, where) == ('FLOCK', place):
                return f': {process}'
    return ''
