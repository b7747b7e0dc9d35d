"""A lap whose recorder is stopped for a while waits for it: nothing is lost."""

import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import pytest
from rosbags.highlevel import AnyReader

pytestmark = pytest.mark.ros

STEPS = 3000
ASLEEP_S = 4.0
DEADLINE_S = 280.0


def start(folder: Path, transport: str) -> subprocess.Popen[str]:
    """Start a lap of 3,000 steps at the most, of all topics that there are."""
    command = [sys.executable, '-m', 'spikelane.main', 'lap', '--robot', 'kinematic', '--json']
    command += ['--seed', '3', '--param', f'simulator.episode.max_steps={STEPS}']
    return subprocess.Popen(
        [*command, '--transport', transport, '--out', str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def recorder_of(process: subprocess.Popen[str]) -> int:
    """Return the recorder that a lap has started."""
    for task in Path(f'/proc/{process.pid}/task').iterdir():
        for pid in (task / 'children').read_text().split():
            command = Path(f'/proc/{pid}/cmdline').read_bytes().decode().split('\0')
            if any(Path(part).name == 'recorder' for part in command[:2]):
                return int(pid)
    raise AssertionError('no recorder runs')


def test_a_recorder_that_is_stopped_for_seconds_records_it_all(
    tmp_path: Path, every_step: tuple[str, ...]
) -> None:
    """The simulator waits and says so; the trajectory is the one driven in-process."""
    process = start(tmp_path / 'ros', 'ros')
    deadline_s = time.monotonic() + DEADLINE_S
    # The first second of driving is flushed to the disk.
    while sum(file.stat().st_size for file in tmp_path.glob('ros/bag/*.mcap')) < 10_000:
        assert time.monotonic() < deadline_s
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    recorder = recorder_of(process)
    os.kill(recorder, signal.SIGSTOP)
    time.sleep(ASLEEP_S)
    assert process.poll() is None
    os.kill(recorder, signal.SIGCONT)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, errors) == (1, '')  # the limit of steps is no lap
    within = start(tmp_path / 'inprocess', 'inprocess')
    assert within.wait(DEADLINE_S) == 1
    trajectories = [
        (tmp_path / transport / 'trajectory.csv').read_bytes()
        for transport in ('ros', 'inprocess')
    ]
    assert trajectories[0] == trajectories[1]
    assert trajectories[0].count(b'\n') == STEPS + 2
    with AnyReader([tmp_path / 'ros' / 'bag']) as reader:
        counts = {each.topic: each.msgcount for each in reader.connections}
    assert {topic: counts[topic] for topic in every_step} == dict.fromkeys(every_step, STEPS + 1)
    assert ', 0 lost' in (tmp_path / 'ros' / 'logs' / 'recorder.log').read_text()
