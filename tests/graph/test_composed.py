"""Simulator and controller composed in one process: the same runs, and the same endings."""

from collections.abc import Callable, Iterator
import functools
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

import pytest
from rosbags.highlevel import AnyReader

from spikelane.processes import end_with

pytestmark = pytest.mark.ros

DEADLINE_S = 280.0
STEPS = 120


def command_line(command: str, folder: Path, transport: str, *options: str) -> list[str]:
    """Return a command that drives the kinematic robot."""
    words = [sys.executable, '-m', 'spikelane.main', *command.split(), '--robot', 'kinematic']
    return [*words, '--transport', transport, '--out', str(folder), *options]


def run(command: str, folder: Path, transport: str, *options: str) -> str:
    """Run a command to its end; return what it printed."""
    ended = subprocess.run(
        command_line(command, folder, transport, '--json', *options),
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        env=os.environ | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
    )
    assert ended.stderr == ''
    return ended.stdout


@pytest.mark.parametrize('controller', ['braitenberg', 'rstdp'])
def test_a_composed_lap_is_the_lap_in_process_and_is_recorded_from_outside(
    tmp_path: Path, controller: str, every_step: tuple[str, ...]
) -> None:
    """The same bits; the recorder, a process of its own, gets each message of each step."""
    options = ('--seed', '3', '--param', f'simulator.episode.max_steps={STEPS}')
    options += ('--controller', controller)
    for transport in ('composed', 'inprocess'):
        run('lap', tmp_path / transport, transport, *options)
    composed, inprocess = (
        (tmp_path / each / 'trajectory.csv').read_bytes() for each in ('composed', 'inprocess')
    )
    assert composed == inprocess
    assert composed.count(b'\n') == STEPS + 2  # a heading, and the first observation
    assert {file.name for file in (tmp_path / 'composed/logs').iterdir()} == {
        'composed.log',
        'recorder.log',
    }
    with AnyReader([tmp_path / 'composed/bag']) as reader:
        counts = {each.topic: each.msgcount for each in reader.connections}
    assert {counts[topic] for topic in every_step} == {STEPS + 1}
    metrics = json.loads((tmp_path / 'composed/metrics.json').read_text())
    assert metrics['transport'] == 'composed'


def test_a_composed_training_is_the_training_in_process(tmp_path: Path) -> None:
    """The same checkpoint after several episodes, which the controller begins by itself."""
    options = ('--seed', '3', '--steps', '300', '--param', 'simulator.episode.max_steps=130')
    # A training that is recorded is driven step by step, not in the kernel of a fleet.
    for transport, others in (('composed', ()), ('inprocess', ('--record', 'dopamine'))):
        said = run('train rstdp', tmp_path / transport, transport, *options, *others)
        assert json.loads(said)['steps'] == 300
    composed, inprocess = (
        (tmp_path / each / 'checkpoint.safetensors').read_bytes()
        for each in ('composed', 'inprocess')
    )
    assert composed == inprocess


class Endless:
    """A composed lap without end, in its folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        endless = ('--param', 'simulator.episode.max_laps=0')
        with (folder / 'errors').open('wb') as errors:
            self.process = subprocess.Popen(
                command_line('lap', folder / 'lap', 'composed', *endless),
                stdout=subprocess.DEVNULL,
                stderr=errors,
                env=os.environ | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'},
                preexec_fn=functools.partial(end_with, os.getpid()),
            )

    def until(self, is_true: Callable[[], object]) -> None:
        """Wait for a condition."""
        deadline_s = time.monotonic() + DEADLINE_S
        while not is_true():
            assert time.monotonic() < deadline_s, self.errors
            assert self.process.poll() is None, self.errors
            time.sleep(0.05)

    @property
    def is_recorded(self) -> bool:
        """Whether the bag has something of the drive."""
        return sum(file.stat().st_size for file in self._folder.glob('lap/bag/*.mcap')) > 10_000

    @property
    def errors(self) -> str:
        """What the command wrote to its standard error."""
        return (self._folder / 'errors').read_text()

    def log(self, process: str) -> str:
        """Return what a process has said."""
        return (self._folder / f'lap/logs/{process}.log').read_text()

    @property
    def pid(self) -> int:
        """The process that has both nodes."""
        children = Path(f'/proc/{self.process.pid}/task/{self.process.pid}/children').read_text()
        (found,) = (
            int(each)
            for each in children.split()
            if b'nodes.composed' in Path(f'/proc/{each}/cmdline').read_bytes()
        )
        return found

    def wait(self) -> int:
        """Wait for the end; return the exit status."""
        return self.process.wait(DEADLINE_S)


@pytest.fixture
def endless(tmp_path: Path) -> Iterator[Endless]:
    """Give a lap that drives and is recorded."""
    lap = Endless(tmp_path)
    try:
        lap.until(lambda: lap.is_recorded)
        yield lap
    finally:
        if lap.process.poll() is None:
            lap.process.kill()
            lap.process.wait()


def test_ctrl_c_ends_a_composed_lap_and_its_recording(endless: Endless) -> None:
    """Exit status 130, no traceback, the bag is closed."""
    endless.process.send_signal(signal.SIGINT)
    assert endless.wait() == 130
    assert 'recorded' in endless.log('recorder')
    assert not any('Traceback' in endless.log(each) for each in ('composed', 'recorder'))


@pytest.mark.parametrize(
    ('number', 'ending'),
    [
        (signal.SIGTERM, 'status 143 (SIGTERM): '),
        (signal.SIGKILL, 'status -9 (SIGKILL): '),
    ],
)
def test_a_process_of_both_nodes_that_ends_is_named(
    endless: Endless, number: int, ending: str
) -> None:
    """Exit status 1 and one line; all that was published is recorded where it could be."""
    os.kill(endless.pid, number)
    assert endless.wait() == 1
    (line,) = endless.errors.splitlines()
    assert line.startswith(f'spikelane lap: composed ended with {ending}')
    if number == signal.SIGTERM:
        assert 'ended by SIGTERM in episode 1, after ' in line
    assert 'recorded' in endless.log('recorder')


@pytest.mark.parametrize(
    ('executable', 'topic'),
    [('simulator', '/lane/state'), ('braitenberg', '/wheel_velocities')],
)
def test_a_second_publisher_ends_a_composed_lap(
    endless: Endless, second_node: Any, executable: str, topic: str
) -> None:
    """Exit status 1 and a line that names the node and the topic."""
    with second_node(executable, endless.pid):
        assert endless.wait() == 1
        (line,) = endless.errors.splitlines()
        assert f'{topic}: expected one publisher, got 2: ' in line
        assert '/intruder' in line
