"""Runs of an experiment in one process: `python -m spikelane.experiment.worker DIR [DIR ...]`.

It does what `run.json` in each folder says, going on where an earlier process stopped. It writes
how far it is into `progress.json`, and at its end its processor time. It ends with 0, or with 1
and a last line that says why. Only one process at a time works in a folder: another one waits.

Several runs are of one setting and done together, each as alone. One that fails does not end the
others; why it failed is in its own log. With `--always-in-kernel` the kernel of a fleet is used
wherever there is one, and not only where it is sooner done.
"""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import json
from pathlib import Path
import sys
import time
from typing import Any, NamedTuple, TypedDict

from spikelane.experiment.plan import RUN_FILE
from spikelane.experiment.processor_time import add_processor_time, processor_s
from spikelane.experiment.tasks import Job, Point, Task, task_named
from spikelane.fleet.setting import use_kernel_always
from spikelane.interruption import Interrupted, signals_noted
from spikelane.lock import locked
from spikelane.runs.configuration import RunConfig
from spikelane.runs.folder import RunFolder
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.files import FileError, write_bytes_atomically, write_text_atomically

ALWAYS_IN_KERNEL = '--always-in-kernel'
PROGRESS_FILE = 'progress.json'
LOG = Path('logs') / 'worker.log'

#: Bits can depend on how many threads a library shares a sum among; runs are spread instead.
ONE_THREAD = dict.fromkeys(
    ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'NUMBA_NUM_THREADS'), '1'
)

_PERIOD_S = 0.5
_LOCK_S = 30.0  # for the process before, whose runner was killed, to notice and end


class _Identity(TypedDict):
    task: str


class _RunFile(TypedDict):
    """What a run's process needs of `run.json`."""

    point: Point
    options: dict[str, Any]
    checkpoint: str | None
    identity: _Identity


class Progress(NamedTuple):
    """How far a run is."""

    steps: int
    share: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Do the runs in the folders given, after an option.

    Returns:
        0 done, 1 where one failed, 128 + n when ended by signal n.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words[:1] == [ALWAYS_IN_KERNEL]:
        use_kernel_always()
        del words[0]
    paths = [Path(each) for each in words]
    # A process of its own has done nothing else, so that its imports count.
    since_s = 0.0 if arguments is None else processor_s()
    with signals_noted(are_ignored_afterwards=arguments is None):
        if len(paths) == 1:
            return _do_run_in(paths[0], since_s)
        try:
            return _Together(paths, since_s).do()
        except Interrupted as interrupted:
            return interrupted.exit_status


def _do_run_in(path: Path, since_s: float) -> int:
    try:
        folder = _folder(path)
        with locked(folder.path, patience_s=_LOCK_S):
            try:
                do_run(folder)
            finally:
                # Where this fails, as on a full disk, the run itself says why.
                with contextlib.suppress(FileError):
                    add_processor_time(folder, since_s)
    except SpikelaneError as error:
        print(error, file=sys.stderr)
        return 1
    except Interrupted as interrupted:
        return interrupted.exit_status
    return 0


def do_run(folder: RunFolder) -> None:
    """Do the run in a folder, unless it is done.

    Raises:
        SpikelaneError: It failed.
    """
    if folder.metrics.exists():
        return
    begun = _prepare(folder)
    begun.task.run(begun.job.config, begun.options, folder, begun.job.show)


class _Begun(NamedTuple):
    """A run that can be done."""

    task: Task
    options: Any
    job: Job


def _prepare(folder: RunFolder) -> _Begun:
    """Begin the run in a folder; return what is to be done.

    Raises:
        SpikelaneError: It cannot be begun.
    """
    task, options, config = read_run(folder)
    folder.write_config(config)
    with contextlib.suppress(OSError):
        (folder.path / PROGRESS_FILE).unlink()
    return _Begun(task, options, Job(config, folder, _Reporter(folder.path / PROGRESS_FILE)))


class _Together:
    """Does several runs of one setting."""

    def __init__(self, paths: Sequence[Path], since_s: float) -> None:
        self._paths = paths
        self._since_s = since_s
        self._has_failed = False

    def do(self) -> int:
        """Do them; return the exit status."""
        jobs: list[Job] = []
        run_together = None
        with contextlib.ExitStack() as stack:
            for path in self._paths:
                try:
                    folder = _folder(path)
                    stack.enter_context(locked(folder.path, patience_s=_LOCK_S))
                    self._begin_log(folder)
                    if not folder.metrics.exists():
                        begun = _prepare(folder)
                        run_together = begun.task.run_together
                        jobs.append(begun.job)
                except SpikelaneError as error:
                    self._fail(RunFolder(path), error)
            if run_together is not None:
                try:
                    run_together(jobs, self._fail)
                finally:
                    for job in jobs:
                        with contextlib.suppress(FileError):
                            add_processor_time(job.folder, self._since_s, len(jobs))
        return 1 if self._has_failed else 0

    def _begin_log(self, folder: RunFolder) -> None:
        """Begin the log of a run; the first one's is this process's output."""
        if folder.path != self._paths[0]:
            write_text_atomically(folder.path / LOG, '')

    def _fail(self, folder: RunFolder, error: SpikelaneError) -> None:
        """Note why a run has failed."""
        self._has_failed = True
        if folder.path == self._paths[0]:
            print(error, file=sys.stderr)
            return
        with contextlib.suppress(SpikelaneError):  # as on a full disk
            write_text_atomically(folder.path / LOG, f'{error}\n')


def read_run(folder: RunFolder) -> tuple[Task, Any, RunConfig]:
    """Return what the run in a folder is, its options, and what determines it.

    Raises:
        SpikelaneError: `run.json` cannot be read, or something in it is not allowed.
    """
    values = folder.read_json(RUN_FILE, _RunFile)
    task = task_named(values['identity']['task'])
    options = task.options.from_mapping(values['options'])
    checkpoint = values['checkpoint']
    config = task.configure(
        Point(**values['point']),
        options,
        None if checkpoint is None else str((folder.path / checkpoint).resolve()),
    )
    return task, options, config


def read_progress(folder: RunFolder) -> Progress | None:
    """Return how far a run says it is, None where it has not said anything."""
    try:
        return Progress(**folder.read_json(PROGRESS_FILE, Progress))
    except FileError:
        return None


class _Reporter:
    """Writes how far a run is, every half a second."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._due_s = 0.0
        self._countdown = 0

    def __call__(self, steps: int, share: float) -> None:
        # Asking for the time at every step would cost more than all else here.
        self._countdown -= 1
        if self._countdown > 0 and share < 1.0:
            return
        self._countdown = 20
        now_s = time.monotonic()
        if now_s >= self._due_s or share >= 1.0:
            self._due_s = now_s + _PERIOD_S
            content = json.dumps(Progress(steps, share)._asdict()).encode()
            write_bytes_atomically(self._path, content, sync=False)


def _folder(path: Path) -> RunFolder:
    if not path.is_dir():
        raise FileError(
            f'{path}: expected a folder, got none; every machine that takes part must see the '
            'folder'
        )
    return RunFolder(path)


if __name__ == '__main__':
    sys.exit(main())
