"""Where the processor time of an experiment goes, by task and controller."""

from __future__ import annotations

from collections.abc import Mapping
import os
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

from spikelane.runs.folder import RunFolder
from spikelane_sim.files import FileError

TIME_FILE = 'processor_time.json'


class _Time(TypedDict):
    processor_s: float


class Cost(NamedTuple):
    """What the runs of a kind cost.

    Attributes:
        kind: Task and controller.
        runs: Number of runs.
        processor_s: Their processor time [s].
        share: Its share in the whole.
    """

    kind: str
    runs: int
    processor_s: float
    share: float


def processor_s() -> float:
    """Return the processor time of this process and of those that it has waited for [s]."""
    return sum(os.times()[:4])


def add_processor_time(folder: RunFolder, since_s: float, runs: int = 1) -> None:
    """Add what this process took to the processor time of the run in a folder.

    Args:
        folder: The run's; several processes can have worked on it, one after the other.
        since_s: `processor_s` when the work began [s].
        runs: Number of runs that this process did together; each is given an equal part.

    Raises:
        FileError: The file cannot be written.
    """
    before_s = read_processor_time(folder) or 0.0
    taken_s = (processor_s() - since_s) / runs
    folder.write_json(TIME_FILE, _Time(processor_s=round(before_s + taken_s, 3)))


def read_processor_time(folder: RunFolder) -> float | None:
    """Return the processor time of a run [s], None where it is not known.

    That of a process that was killed is lost.
    """
    try:
        return float(folder.read_json(TIME_FILE, _Time)['processor_s'])
    except FileError:
        return None


def costs(results: Mapping[str, Any], root: Path, **others_s: float) -> list[Cost]:
    """Return what an experiment cost, the most expensive kind of runs first.

    Args:
        results: Its results (`experiment_results`). Runs whose time is not known are left out.
        root: Its folder.
        others_s: Processor time of other work [s], by what it was.
    """
    found: dict[str, list[float]] = {}
    for run in results['runs']:
        time_s = run['folder'] and read_processor_time(RunFolder(root / run['folder']))
        if time_s is not None:
            found.setdefault(f'{run["task"]} {run["controller"]}', []).append(time_s)
    found |= {kind: [time_s] for kind, time_s in others_s.items()}
    whole_s = sum(map(sum, found.values())) or 1.0
    rows = [
        Cost(kind, len(times_s), round(sum(times_s), 3), round(sum(times_s) / whole_s, 4))
        for kind, times_s in found.items()
    ]
    return sorted(rows, key=lambda row: -row.processor_s)


def cost_table(rows: list[Cost]) -> str:
    """Return costs as a table for people."""
    lines = [f'{"processor time":24} {"runs":>5} {"s":>10} {"share":>7}']
    lines += [
        f'{row.kind:24} {row.runs:5} {row.processor_s:10,.1f} {row.share:7.1%}' for row in rows
    ]
    whole_s = sum(row.processor_s for row in rows)
    return '\n'.join([*lines, f'{"all":24} {"":5} {whole_s:10,.1f}'])
