"""Child processes: how they begin and how they end."""

from __future__ import annotations

from collections.abc import Callable
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time

import pytest

from spikelane import processes as module
from spikelane.processes import ProcessError, Processes

#: Says that it is ready, then does nothing; deaf to the signals in its arguments.
SLEEPER = """
import signal, sys, time
for name in sys.argv[1:]:
    signal.signal(getattr(signal, name), signal.SIG_IGN)
print('ready', flush=True)
time.sleep(60)
"""

#: Starts a sleeper, and is itself to be killed.
PARENT = """
import os, sys, time
from pathlib import Path
from spikelane.processes import Processes
processes = Processes()
processes.start('sleeper', [sys.executable, '-c', sys.argv[1]], Path(sys.argv[2]), os.environ)
print(processes._children['sleeper'].pid, flush=True)
time.sleep(60)
"""


def wait_until(is_so: Callable[[], bool]) -> None:
    """Wait up to half a minute."""
    deadline_s = time.monotonic() + 30
    while not is_so():
        assert time.monotonic() < deadline_s, 'waited in vain'
        time.sleep(0.01)


def start(children: Processes, name: str, log: Path, code: str, *arguments: str) -> None:
    """Start Python code as a child."""
    children.start(name, [sys.executable, '-c', code, *arguments], log, os.environ)


def start_sleepers(children: Processes, folder: Path, **deaf_to: list[str]) -> None:
    """Start sleepers and wait until all are asleep."""
    for name, signals in deaf_to.items():
        start(children, name, folder / name, SLEEPER, *signals)
    for name in deaf_to:
        wait_until(lambda name=name: 'ready' in (folder / name).read_text())


@pytest.fixture
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give children a second to obey a signal."""
    endings = tuple((how, 1.0) for how, _ in module._ENDINGS)
    monkeypatch.setattr(module, '_ENDINGS', endings)


def test_the_gentle_signal_comes_first_and_has_the_most_time() -> None:
    """A recorder needs some to put its file in order."""
    assert module._ENDINGS == (
        (signal.SIGINT, 10.0),
        (signal.SIGTERM, 3.0),
        (signal.SIGKILL, 3.0),
    )


@pytest.mark.usefixtures('_impatient')
def test_a_child_gets_the_next_signal_where_it_is_deaf_to_one(tmp_path: Path) -> None:
    """All children get it at once: four that ignore signals take no longer than one."""
    with Processes() as children:
        start_sleepers(
            children,
            tmp_path,
            good=[],
            deaf=['SIGINT'],
            deafer=['SIGINT', 'SIGTERM'],
            deafest=['SIGINT', 'SIGTERM', 'SIGHUP'],
        )
        children.check()
        start_s = time.monotonic()
        children.stop('good', 'deaf', 'deafer', 'deafest')
        assert 2.0 <= time.monotonic() - start_s < 4.0
        assert children.statuses() == {'good': -2, 'deaf': -15, 'deafer': -9, 'deafest': -9}


def test_only_the_children_named_are_stopped(tmp_path: Path) -> None:
    """The block's end stops the others; stopping twice is no harm."""
    with Processes() as children:
        start_sleepers(children, tmp_path, one=[], other=[])
        children.stop('one')
        children.stop('one')
        assert children.statuses() == {'one': -2, 'other': None}
    assert children.statuses() == {'one': -2, 'other': -2}


def test_an_error_in_the_block_stops_the_children_and_goes_on(tmp_path: Path) -> None:
    """Nothing is left behind, nothing swallowed."""
    children = Processes()

    def fail() -> None:
        with children:
            start_sleepers(children, tmp_path, one=[])
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert children.statuses() == {'one': -2}


def test_a_crash_is_noticed_with_the_last_lines(tmp_path: Path) -> None:
    """Five of them, from both outputs."""
    code = 'for n in range(9): print("line", n, flush=True)\nraise SystemExit("fell over")'
    with Processes() as children:
        start(children, 'node', tmp_path / 'log', code)
        wait_until(lambda: children.statuses()['node'] is not None)
        with pytest.raises(ProcessError) as error:
            children.check()
    assert str(error.value) == (
        'node ended with status 1: fell over (log: line 5 | line 6 | line 7 | line 8)'
    )
    assert error.value.exit_status == 1


def test_a_child_that_ends_without_an_error_is_noticed_too(tmp_path: Path) -> None:
    """It should not have."""
    with Processes() as children:
        start(children, 'node', tmp_path / 'log', '')
        wait_until(lambda: children.statuses()['node'] is not None)
        with pytest.raises(ProcessError, match=r'^node ended with status 0: it said nothing$'):
            children.check()


@pytest.mark.parametrize(
    ('ends', 'expected'),
    [
        (
            'os.kill(0, signal.SIGTERM)',
            'node ended with status -15 (SIGTERM) while it was starting',
        ),
        (
            'import time; os.kill(0, signal.SIGINT); time.sleep(9)',
            '-2 (SIGINT) while it was start',
        ),
        ('os._exit(143)', 'node ended with status 143 (SIGTERM) while it was starting'),
        ('print("cut short"); exit(143)', 'node ended with status 143 (SIGTERM): cut short'),
        ('os.kill(0, signal.SIGKILL)', 'node ended with status -9 (SIGKILL): it said nothing'),
    ],
)
def test_the_signal_that_ended_a_child_is_named(tmp_path: Path, ends: str, expected: str) -> None:
    """What has started handles those that ask it to end, and says something."""
    with Processes() as children:
        start(children, 'node', tmp_path / 'log', f'import os, signal; {ends}')
        wait_until(lambda: children.statuses()['node'] is not None)
        with pytest.raises(ProcessError, match=re.escape(expected)):
            children.check()


def test_all_that_ended_with_an_error_are_named_but_those_told_to(tmp_path: Path) -> None:
    """A child that is told to end may report that it was cut short."""
    obedient = SLEEPER.replace('signal.SIG_IGN', 'lambda number, frame: sys.exit(128 + number)')
    with Processes() as children:
        start(children, 'told', tmp_path / 'told', obedient, 'SIGINT')
        start(children, 'one', tmp_path / 'one', 'raise SystemExit("no")')
        start(children, 'two', tmp_path / 'two', 'raise SystemExit(143)')
        wait_until(lambda: 'ready' in (tmp_path / 'told').read_text())
        wait_until(lambda: None not in (children.statuses()[name] for name in ('one', 'two')))
        children.stop('told')
        assert children.statuses()['told'] == 130
        with pytest.raises(ProcessError) as error:
            children.check_endings()
    assert str(error.value) == (
        'one ended with status 1: no; two ended with status 143 (SIGTERM) while it was starting'
    )


def test_an_end_can_be_waited_for(tmp_path: Path) -> None:
    """A wrong one, or one that does not come, is an error."""
    with Processes() as children:
        start(children, 'good', tmp_path / 'good', '')
        start(children, 'bad', tmp_path / 'bad', 'raise SystemExit(3)')
        start(children, 'slow', tmp_path / 'slow', SLEEPER)
        children.wait('good', 30.0)
        with pytest.raises(ProcessError, match=r'slow: expected it to end within 0\.1 s'):
            children.wait('slow', 0.1)
        with pytest.raises(ProcessError, match='bad ended with status 3'):
            children.wait('bad', 30.0)


@pytest.mark.parametrize('log', ['log', 'file/below/log'])
def test_what_cannot_be_started_is_named(tmp_path: Path, log: str) -> None:
    """The program is not there, or the log has no place."""
    (tmp_path / 'file').write_text('')
    with Processes() as children:
        with pytest.raises(ProcessError, match=r'^node: cannot be started: '):
            children.start('node', ['/nowhere/node'], tmp_path / log, {})
        children.stop('node')
        assert children.statuses() == {}


def test_a_child_has_the_environment_given_and_a_group_of_its_own(tmp_path: Path) -> None:
    """A Ctrl-C in the terminal reaches the parent only."""
    code = 'import os; print(os.environ.get("SOME"), os.environ.get("HOME"), os.getpgid(0))'
    with Processes() as children:
        children.start('node', [sys.executable, '-c', code], tmp_path / 'log', {'SOME': 'x'})
        pid = children._children['node'].pid
        children.wait('node', 30.0)
    assert (tmp_path / 'log').read_text() == f'x None {pid}\n'


def test_a_parent_that_ignores_signals_has_children_that_do_not(tmp_path: Path) -> None:
    """As where `nohup` or a script's `&` started it."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with Processes() as children:
            start_sleepers(children, tmp_path, one=[])
            children.stop('one')
            assert children.statuses() == {'one': -2}
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_child_ends_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    """Though the parent could do nothing about it."""
    environment = os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)}
    log = tmp_path / 'log'
    with subprocess.Popen(
        [sys.executable, '-c', PARENT, SLEEPER, str(log)],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    ) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        wait_until(lambda: 'ready' in log.read_text())
        assert is_running(pid)
        parent.kill()
        parent.wait()
        wait_until(lambda: not is_running(pid))


def is_running(pid: int) -> bool:
    """Whether there is such a process; one that has ended and waits for its parent is none."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except (FileNotFoundError, ProcessLookupError):
        return False
