"""Pybullet, imported without the line on its build time that it writes to standard error."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os

__all__ = ['pybullet']

_GREETING = b'pybullet build time'


@contextlib.contextmanager
def _without_greeting() -> Iterator[None]:
    """Hold back standard error's file descriptor, as pybullet writes to it from C."""
    try:
        kept = os.dup(2)
    except OSError:  # there is no standard error
        yield
        return
    with os.fdopen(os.memfd_create('stderr'), 'w+b') as held:
        os.dup2(held.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            held.seek(0)
            os.write(2, b''.join(line for line in held if not line.startswith(_GREETING)))


with _without_greeting():
    import pybullet
