"""Logs of a training for TensorBoard, under the names that Stable-Baselines3 has.

A log is for the eyes: times are in it, and where a training was resumed TensorBoard leaves out
what came after the checkpoint. Nothing is read from it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from spikelane_controllers.training import Training

LOG_FOLDER = 'tensorboard'

_FLUSH_S = 10


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
        self._writer: Any = None
        training.on_episode = self._add

    def close(self) -> None:
        """Write what is not written yet."""
        if self._writer is not None:
            self._writer.close()

    def _add(self) -> None:
        scalars = self._training.scalars()
        if not scalars:
            return
        if self._writer is None:
            # Here and not above: whoever does not train need not wait for it.
            from tensorboardX import SummaryWriter

            purge_step = self._first_step + 1 if self._first_step else None
            self._writer = SummaryWriter(
                str(self._folder), purge_step=purge_step, flush_secs=_FLUSH_S
            )
        elapsed_s = max(self._now_s() - self._start_s, 1e-9)
        steps = self._training.steps
        scalars |= {'time/fps': (steps - self._first_step) / elapsed_s}
        for name, value in scalars.items():
            self._writer.add_scalar(name, value, steps)
