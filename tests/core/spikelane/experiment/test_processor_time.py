"""Where the processor time of an experiment goes."""

from pathlib import Path
import time

import pytest

from spikelane.experiment.processor_time import (
    add_processor_time,
    cost_table,
    costs,
    processor_s,
    read_processor_time,
)
from spikelane.runs.folder import RunFolder


def write(root: Path, name: str, seconds: float) -> str:
    """Write the processor time of a run; return the name of its folder."""
    (root / name).mkdir()
    RunFolder(root / name).write_json('processor_time.json', {'processor_s': seconds})
    return name


def test_costs_are_summed_by_task_and_controller(tmp_path: Path) -> None:
    """The most expensive first; runs that are not begun, or whose time is lost, are left out."""
    (tmp_path / 'lost').mkdir()
    runs = [
        ('train', 'rstdp', write(tmp_path, 'a', 30.0)),
        ('train', 'dqn', write(tmp_path, 'b', 50.0)),
        ('train', 'rstdp', write(tmp_path, 'c', 10.0)),
        ('evaluate', 'dqn', 'lost'),
        ('evaluate', 'rstdp', None),
    ]
    names = ('task', 'controller', 'folder')
    results = {'runs': [dict(zip(names, run, strict=True)) for run in runs]}
    rows = costs(results, tmp_path, report=10.0)
    assert rows == [
        ('train dqn', 1, 50.0, 0.5),
        ('train rstdp', 2, 40.0, 0.4),
        ('report', 1, 10.0, 0.1),
    ]
    assert cost_table(rows) == (
        'processor time            runs          s   share\n'
        'train dqn                    1       50.0   50.0%\n'
        'train rstdp                  2       40.0   40.0%\n'
        'report                       1       10.0   10.0%\n'
        'all                                 100.0'
    )


def test_the_times_of_all_processes_of_a_run_are_added(tmp_path: Path) -> None:
    """Sleep is no work."""
    folder = RunFolder(tmp_path)
    assert read_processor_time(folder) is None
    write_s = processor_s()
    time.sleep(0.05)
    add_processor_time(folder, write_s - 7.0)
    first_s = read_processor_time(folder)
    assert first_s == pytest.approx(7.0, abs=0.04)
    add_processor_time(folder, processor_s() - 2.0)
    assert read_processor_time(folder) == pytest.approx(first_s + 2.0, abs=0.02)
