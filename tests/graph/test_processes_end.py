"""`spikelane lap` interrupted, killed, and with a node that crashes: no process is left."""

from collections.abc import Callable, Iterator
import functools
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time
from typing import Any
import uuid

import pytest
from rosbags.highlevel import AnyReader

from spikelane.processes import end_with

pytestmark = pytest.mark.ros

DEADLINE_S = 60.0
NODES = ('simulator', 'braitenberg', 'recorder')


class Command:
    """A lap without end, and all processes that came of it, told by a mark they inherit."""

    def __init__(self, folder: Path) -> None:
        self._mark = f'SPIKELANE_TEST={uuid.uuid4()}'
        self._folder = folder
        name, _, value = self._mark.partition('=')
        command = [sys.executable, '-m', 'spikelane.main', 'lap', '--out', str(folder / 'lap')]
        endless = ['--robot', 'kinematic', '--param', 'simulator.episode.max_laps=0']
        with (folder / 'errors').open('wb') as errors:
            self._process = subprocess.Popen(
                [*command, *endless],
                stdout=subprocess.DEVNULL,
                stderr=errors,
                env=os.environ | {name: value},
                start_new_session=True,
                # Where the tests run in the background, SIGINT may be ignored.
                preexec_fn=functools.partial(end_with, os.getpid()),
            )

    @property
    def errors(self) -> str:
        """What it wrote to its standard error."""
        return (self._folder / 'errors').read_text()

    def log(self, node: str) -> str:
        """Return what a node has said."""
        return (self._folder / 'lap' / 'logs' / f'{node}.log').read_text()

    def pids(self, node: str = '') -> list[int]:
        """Return the processes with the mark that run, all or those of a node."""
        found = []
        for process in Path('/proc').iterdir():
            try:
                environment = (process / 'environ').read_bytes()
                command = (process / 'cmdline').read_bytes().decode().split('\0')
            except (NotADirectoryError, FileNotFoundError, ProcessLookupError, PermissionError):
                continue
            is_node = any(Path(part).name == node for part in command[:2])
            # A zombie has no environment.
            if self._mark.encode() in environment.split(b'\0') and (is_node or not node):
                found.append(int(process.name))
        return found

    def bag_bytes(self) -> int:
        """Return the size of the recording, 0 where there is none yet."""
        return sum(file.stat().st_size for file in (self._folder / 'lap').glob('bag/*.mcap'))

    def recorded(self, topic: str) -> int:
        """Return how many messages of a topic are in the bag."""
        with AnyReader([self._folder / 'lap' / 'bag']) as reader:
            return sum(each.msgcount for each in reader.connections if each.topic == topic)

    def until(self, condition: Callable[[], object], what: str) -> None:
        """Wait for a condition."""
        deadline_s = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < deadline_s, f'waited for {what}; {self.errors}'
            time.sleep(0.05)

    def signal(self, number: int) -> None:
        """Send a signal to the command alone."""
        self._process.send_signal(number)

    def wait(self) -> int:
        """Wait for the command's end; return its exit status."""
        return self._process.wait(DEADLINE_S)

    def is_running(self) -> bool:
        """Tell whether the command runs."""
        return self._process.poll() is None

    def kill(self) -> None:
        """End whatever a failed test has left."""
        for pid in self.pids():
            os.kill(pid, signal.SIGKILL)
        self._process.wait()


@pytest.fixture
def command(tmp_path: Path) -> Iterator[Command]:
    """Give a command whose robot drives and is recorded."""
    command = Command(tmp_path)
    try:
        # The first second of driving is flushed to the disk.
        command.until(
            lambda: command.bag_bytes() > 10_000 or not command.is_running(), 'a recording'
        )
        assert command.is_running(), command.errors
        assert [len(command.pids(node)) for node in NODES] == [1, 1, 1]
        yield command
    finally:
        command.kill()


@pytest.mark.parametrize(('number', 'status'), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_to_the_command_ends_all(command: Command, number: int, status: int) -> None:
    """Exit status 128 + n without a traceback; the nodes end quietly and the bag is closed."""
    command.signal(number)
    assert command.wait() == status
    assert command.pids() == []
    assert 'Traceback' not in command.errors
    assert not any('Traceback' in command.log(node) for node in NODES)
    assert 'recorded' in command.log('recorder')


def test_the_nodes_of_a_killed_command_end(command: Command) -> None:
    """They are told by the kernel, and the recorder closes the bag."""
    command.signal(signal.SIGKILL)
    assert command.wait() == -signal.SIGKILL
    command.until(lambda: not command.pids(), 'the nodes to end')
    assert 'recorded' in command.log('recorder')
    assert not any('Traceback' in command.log(node) for node in NODES)


@pytest.mark.parametrize('node', ['simulator', 'braitenberg'])
def test_a_node_that_crashes_ends_all(command: Command, node: str) -> None:
    """Exit status 1 and one line that names the node; the recording is closed."""
    os.kill(command.pids(node)[0], signal.SIGKILL)
    assert command.wait() == 1
    assert command.pids() == []
    lines = command.errors.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith(f'spikelane lap: {node} ended')
    assert 'recorded' in command.log('recorder')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('node', NODES)
def test_a_node_that_is_told_to_end_ends_all(command: Command, node: str, number: int) -> None:
    """Exit status 1 and one line that names the node; all that was published is recorded."""
    os.kill(command.pids(node)[0], number)
    assert command.wait() == 1
    assert command.pids() == []
    lines = command.errors.splitlines()
    assert len(lines) == 1
    name = signal.Signals(number).name
    assert lines[0].startswith(f'spikelane lap: {node} ended with status {128 + number} ({name})')
    if node == 'simulator':
        found = re.search(r'ended by SIG\w+ in episode 1, after (\d+) steps', lines[0])
        assert found, lines
        assert command.recorded('/lane/state') == int(found[1]) + 1
    assert 'recorded' in command.log('recorder')


@pytest.mark.parametrize(
    ('executable', 'topic'),
    [('simulator', '/lane/state'), ('braitenberg', '/wheel_velocities')],
)
def test_a_second_publisher_ends_a_lap(
    command: Command, second_node: Any, executable: str, topic: str
) -> None:
    """Exit status 1 and a line that names the node and the topic."""
    with second_node(executable, command.pids('simulator')[0]):
        assert command.wait() == 1
        (line,) = command.errors.splitlines()
        assert f'{topic}: expected one publisher, got 2: ' in line
        assert '/intruder' in line


def test_a_simulator_that_ends_while_it_is_reset_is_named(tmp_path: Path) -> None:
    """It is named instead of the request that it could not fulfil without a controller."""
    command = Command(tmp_path)
    log = tmp_path / 'lap' / 'logs' / 'simulator.log'
    try:
        command.until(lambda: command.pids('braitenberg'), 'the controller')
        controller = command.pids('braitenberg')[0]
        os.kill(controller, signal.SIGSTOP)
        waiting = 'waiting for /braitenberg to subscribe to '
        command.until(lambda: log.exists() and waiting in log.read_text(), 'the reset')
        os.kill(command.pids('simulator')[0], signal.SIGTERM)
        os.kill(controller, signal.SIGCONT)
        assert command.wait() == 1
        errors = command.errors.splitlines()
        assert len(errors) == 1
        expected = 'spikelane lap: simulator ended with status 143 (SIGTERM): '
        assert errors[0].startswith(expected)
        assert command.pids() == []
    finally:
        command.kill()
