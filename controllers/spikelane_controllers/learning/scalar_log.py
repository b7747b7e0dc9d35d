"""Logs of a training for TensorBoard, under the names that Stable-Baselines3 has.

A log is for the eyes: times are in it, and where a training was resumed TensorBoard leaves out
what came after the checkpoint. Nothing is read from it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import socket
import struct
import time
from typing import Any

from spikelane_controllers.learning.training import Training
from spikelane_sim.files import append_bytes

LOG_FOLDER = 'tensorboard'

_LENGTH, _CHECKSUM = struct.Struct('<Q'), struct.Struct('<I')


class ScalarLog:
    """Writes a training's scalars after each episode; nothing for one that has none."""

    def __init__(self, folder: Path, training: Training, now_s: Callable[[], float]) -> None:
        """Begin, or go on where the training stands.

        Args:
            folder: Folder of the log; made when there is something to write.
            training: Begun or resumed; tells of its episodes from here on.
            now_s: A clock [s].
        """
        self._folder = folder
        self._training = training
        self._now_s = now_s
        self._start_s = now_s()
        self._first_step = training.steps
        self._file: Path | None = None
        training.on_episode = self._add

    def _add(self) -> None:
        """Write the scalars of an episode.

        Raises:
            FileError: They cannot be written.
        """
        scalars = self._training.scalars()
        if not scalars:
            return
        elapsed_s = max(self._now_s() - self._start_s, 1e-9)
        steps = self._training.steps
        scalars |= {'time/fps': (steps - self._first_step) / elapsed_s}
        values = [{'tag': name, 'simple_value': value} for name, value in scalars.items()]
        entry = _record(step=steps, summary={'value': values})
        if self._file is None:
            place = f'events.out.tfevents.{int(time.time())}.{socket.gethostname()}'
            self._file = self._folder / place
            entry = self._head() + entry
        append_bytes(self._file, entry)

    def _head(self) -> bytes:
        """Return what a file begins with; what was logged after the checkpoint is left out."""
        if not self._first_step:
            return _record(file_version='brain.Event:2')
        step = self._first_step + 1
        begin = {'status': 'START'}
        return _record(step=step, file_version='brain.Event:2') + _record(
            step=step, session_log=begin
        )


def _record(**fields: Any) -> bytes:
    """Return an event as TensorFlow's record files have it: lengths and checksums about it."""
    # Here and not above: programs that do not train need not wait for it.
    from tensorboardX.proto.event_pb2 import Event
    from tensorboardX.record_writer import masked_crc32c

    content: bytes = Event(wall_time=time.time(), **fields).SerializeToString()
    length = _LENGTH.pack(len(content))
    checksums = [_CHECKSUM.pack(masked_crc32c(part)) for part in (length, content)]
    return b''.join((length, checksums[0], content, checksums[1]))
