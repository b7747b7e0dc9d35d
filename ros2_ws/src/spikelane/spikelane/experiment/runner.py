"""Does an experiment's runs: each when what it needs is there, several at a time.

A run that is done is not done again, one that was interrupted goes on, one whose process was
killed is begun again a few times, and one that failed is reported while the others go on. Runs of
one setting are done together where the engine does that; one that was killed or failed there is
begun again alone, since another may be the cause. The folder of an experiment:

    <run>/          of each run, as the command that does it alone would leave it, and `run.json`
    log.jsonl       what happened and when, one JSON object a line, added to by every call
    results.json    all runs, and their results over the seeds
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
import dataclasses
from datetime import datetime, timezone
from enum import Enum
import json
import math
from pathlib import Path
import time
from typing import Any, NamedTuple

from spikelane.experiment.engine import Ended, Engine
from spikelane.experiment.plan import find_runs, make_run_folder, Plan, PlannedRun, write_run
from spikelane.experiment.processor_time import read_processor_time
from spikelane.experiment.worker import Progress, read_progress
from spikelane.interruption import check
from spikelane.runs.folder import RunFolder
from spikelane_sim.files import append_bytes

LOG_FILE = 'log.jsonl'

_POLL_S = 0.05
_LEAST = 4  # runs of one setting that are worth another process while others are at work
_PARTS = 4  # groups of runs for each process, so that all processes end at about the same time
_PROGRESS_S = 0.5


class RunStatus(Enum):
    """Where a run stands."""

    FOUND = 'found'  # was finished before
    WAITING = 'waiting'
    RUNNING = 'running'
    DONE = 'done'
    FAILED = 'failed'
    BLOCKED = 'blocked'  # what it needs failed

    @property
    def is_finished(self) -> bool:
        """Whether its results are there."""
        return self in (RunStatus.FOUND, RunStatus.DONE)


@dataclasses.dataclass
class Status:
    """How a run fares.

    Attributes:
        run: Which.
        state: Where it stands.
        folder: Its own; None before it is begun.
        is_begun: Whether an earlier process has left something to resume.
        is_continued: Whether the one at work, or the last one, went on with that.
        attempts: Processes started.
        together: Runs that its process does, or did last, this one included.
        message: Why it failed, '' where it did not.
        started_s: When its process was started, by the monotonic clock [s].
        first: What it said of its progress first, and when [s].
        last: What it said last, and when [s].
        took_s: Time in which one process did all of it [s], None where none has.
    """

    run: PlannedRun
    state: RunStatus = RunStatus.WAITING
    folder: RunFolder | None = None
    is_begun: bool = False
    is_continued: bool = False
    attempts: int = 0
    together: int = 1
    message: str = ''
    started_s: float = 0.0
    first: tuple[float, Progress] | None = None
    last: tuple[float, Progress] | None = None
    took_s: float | None = None

    @property
    def steps_per_s(self) -> float | None:
        """Its speed since its process first spoke, None before that is known."""
        rate = self._rate(lambda progress: progress.steps)
        return rate or None

    @property
    def left_s(self) -> float | None:
        """Time it will still take at its speed [s]."""
        rate = self._rate(lambda progress: progress.share)
        return (1.0 - self.last[1].share) / rate if rate and self.last else None

    def _rate(self, of: Callable[[Progress], float]) -> float:
        if self.first is None or self.last is None or self.last[0] <= self.first[0]:
            return 0.0
        return (of(self.last[1]) - of(self.first[1])) / (self.last[0] - self.first[0])


class Counts(NamedTuple):
    """How many runs stand where."""

    finished: int
    failed: int
    blocked: int
    total: int


class Runner:
    """Does the runs of a plan.

    Attributes:
        statuses: Statuses of the runs, by name, in the plan's order.
    """

    def __init__(self, plan: Plan, root: Path, retries: int) -> None:
        """Find out what there is to do.

        Args:
            plan: The runs.
            root: The experiment's folder.
            retries: How often a run is begun again whose process was killed.
        """
        self._root = root
        self._retries = retries
        self.statuses = {run.name: Status(run) for run in plan.runs}
        for name, found in find_runs(root, plan.runs).items():
            status = self.statuses[name]
            status.folder, status.is_begun = found.folder, True
            if found.is_finished:
                status.state = RunStatus.FOUND

    @property
    def counts(self) -> Counts:
        """How many runs stand where."""
        states = [status.state for status in self.statuses.values()]
        return Counts(
            sum(state.is_finished for state in states),
            states.count(RunStatus.FAILED),
            states.count(RunStatus.BLOCKED),
            len(states),
        )

    def run(self, engine: Engine, show: Callable[[Status | None], None]) -> Counts:
        """Do what is to be done.

        Args:
            engine: Does it; is stopped at the end, however that comes.
            show: Called with a run that has begun or ended, and with None every half a second.

        Raises:
            SpikelaneError: The experiment's folder cannot be written.
        """
        self._log('begin', total=self.counts.total, found=self.counts.finished)
        try:
            self._run(engine, show)
        except BaseException as error:
            self._log('interrupt', message=str(error) or type(error).__name__)
            raise
        finally:
            engine.stop()
        counts = self.counts
        self._log('finish', **counts._asdict())
        return counts

    def _run(self, engine: Engine, show: Callable[[Status | None], None]) -> None:
        shown_s = 0.0
        while True:
            for ended in engine.ended():
                self._end(ended)
                show(self.statuses[ended.name])
            self._start_ready(engine, show)
            if not engine.busy:
                return
            if time.monotonic() - shown_s >= _PROGRESS_S:
                self._read_progress()
                show(None)
                shown_s = time.monotonic()
            check()
            time.sleep(_POLL_S)

    def _start_ready(self, engine: Engine, show: Callable[[Status | None], None]) -> None:
        """Begin what can be begun, divided among all processes that there may be."""
        ready = list(self._ready()) if engine.busy < engine.slots else []
        most = _shares(ready, engine)
        while ready and engine.busy < engine.slots:
            group = _group(ready, self._at_work, most)
            self._start(group, engine)
            ready = [each for each in ready if each.state is RunStatus.WAITING]
            for status in group:
                show(status)

    @property
    def _at_work(self) -> set[str]:
        """The settings of the runs at work."""
        states = self.statuses.values()
        return {each.run.setting for each in states if each.state is RunStatus.RUNNING}

    def _ready(self) -> Iterator[Status]:
        """Yield the runs that can be begun; those that never can are marked."""
        for status in self.statuses.values():
            if status.state is not RunStatus.WAITING:
                continue
            before = self._before(status)
            if before is None or before.state.is_finished:
                yield status
            elif before.state in (RunStatus.FAILED, RunStatus.BLOCKED):
                status.state = RunStatus.BLOCKED
                status.message = f'needs {before.run.name}'
                self._log('block', status)

    def _start(self, group: Sequence[Status], engine: Engine) -> None:
        """Begin to do runs in one process."""
        folders = {each.run.name: self._prepare(each, len(group)) for each in group}
        engine.start(folders)

    def _prepare(self, status: Status, together: int) -> Path:
        """Make a run ready to be begun; return its folder."""
        before = self._before(status)
        before_folder = None if before is None else before.folder
        if status.folder is None:
            status.folder = make_run_folder(self._root, status.run, before_folder)
        else:
            write_run(status.folder, status.run, before_folder)
        status.attempts += 1
        status.together = together
        status.state = RunStatus.RUNNING
        status.started_s = time.monotonic()
        status.first = status.last = None
        facts = {'attempt': status.attempts, 'is_continued': status.is_begun}
        self._log('start', status, **facts, together=together)
        status.is_continued, status.is_begun = status.is_begun, True
        return status.folder.path

    def _end(self, ended: Ended) -> None:
        status = self.statuses[ended.name]
        wall_time_s = round(time.monotonic() - status.started_s, 3)
        status.message = ended.message
        assert status.folder is not None  # it was started
        if ended.status == 0 and status.folder.metrics.exists():
            status.state = RunStatus.DONE
            status.took_s = None if status.is_continued else wall_time_s
            time_s = read_processor_time(status.folder)
            self._log('done', status, wall_time_s=wall_time_s, processor_s=time_s)
        elif self._is_worth_another(ended, status):
            status.state = RunStatus.WAITING
            self._log('retry', status, wall_time_s=wall_time_s, message=ended.message)
        else:
            status.state = RunStatus.FAILED
            status.message = ended.message or 'ended without results'
            self._log('fail', status, wall_time_s=wall_time_s, message=status.message)

    def _is_worth_another(self, ended: Ended, status: Status) -> bool:
        """Return whether to begin a run again: one that was killed, or was not alone."""
        is_first_alone = status.together > 1 and ended.status > 0
        return is_first_alone or (ended.status < 0 and status.attempts <= self._retries)

    def _before(self, status: Status) -> Status | None:
        return None if status.run.before is None else self.statuses[status.run.before]

    def _read_progress(self) -> None:
        now_s = time.monotonic()
        for status in self.statuses.values():
            if status.state is not RunStatus.RUNNING or status.folder is None:
                continue
            progress = read_progress(status.folder)
            if progress is not None and (status.last is None or status.last[1] != progress):
                status.last = (now_s, progress)
                status.first = status.first or status.last

    def _log(self, event: str, status: Status | None = None, **facts: Any) -> None:
        run: dict[str, Any] = {}
        if status is not None:
            folder = None if status.folder is None else status.folder.path.name
            run = {'run': status.run.name, 'folder': folder}
        log_event(self._root, event, **run, **facts)


def _shares(ready: Sequence[Status], engine: Engine) -> dict[str, int]:
    """Return how many runs of each setting a process is given at most.

    If there are few settings, the runs of each are divided among the processes. Otherwise one
    process could be given all the long runs while the others have nothing to do. If there are
    many settings, a process does all runs of one, until few settings are left.
    """
    numbers = Counter(each.run.setting for each in ready)
    # A run without a setting is done alone.
    units = sum(1 if setting else number for setting, number in numbers.items())
    parts = min(engine.slots, max(_PARTS * engine.slots // max(units, 1), 1))
    least = _LEAST if engine.busy else 1
    return {
        setting: max(math.ceil(number / parts), least) if engine.does_together and setting else 1
        for setting, number in numbers.items()
    }


def _group(
    ready: Sequence[Status], at_work: Collection[str], most: Mapping[str, int]
) -> Sequence[Status]:
    """Return the next runs to be done in one process: one, and others of its setting.

    The first run is taken whose setting is not at work in another process, since that process
    may still be compiling the kernel. If there is no such run, the first one of all is taken.
    """
    others = (each for each in ready if not each.run.setting or each.run.setting not in at_work)
    first = next(others, ready[0])
    setting = first.run.setting
    if not setting or first.attempts:
        return [first]
    alike = [each for each in ready if each.run.setting == setting and not each.attempts]
    return alike[: min(most[setting], first.run.most_together)]


def log_event(root: Path, event: str, **facts: Any) -> None:
    """Add a line to an experiment's log, at once, so that a kill leaves whole lines.

    Raises:
        FileError: The log cannot be written.
    """
    entry = {
        'time': datetime.now(timezone.utc).isoformat(timespec='milliseconds'),
        'event': event,
        **facts,
    }
    append_bytes(root / LOG_FILE, (json.dumps(entry) + '\n').encode())
