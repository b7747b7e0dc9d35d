"""A signal that comes while a node's executable starts ends it without a word."""

import functools
import os
from pathlib import Path
import signal
import subprocess
import sys

import pytest

from spikelane.executables import executables, find_executable
from spikelane.processes import end_with

pytestmark = pytest.mark.ros

DEADLINE_S = 120.0
#: In the place of a module: says that it is being imported, and does not come to an end.
ENDLESS = 'import sys, time; print("here", flush=True); time.sleep(600)\n'
#: Python runs it when it starts: only the node's own process says so, and goes on after a moment.
ENDLESS_START = """
import sys, time
if any('/lib/spikelane' in word for word in sys.orig_argv):
    print('here', flush=True)
    time.sleep(3)
"""


def interrupted(command: list[str], folder: Path, number: int) -> tuple[int, str]:
    """Start a command with modules from a folder first; interrupt it where one says so.

    Returns:
        Its exit status and its standard error.
    """
    path = f'{folder}{os.pathsep}{os.environ.get("PYTHONPATH", "")}'
    process = subprocess.Popen(
        command,
        env=os.environ | {'PYTHONPATH': path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=functools.partial(end_with, os.getpid()),
    )
    assert process.stdout is not None
    assert process.stdout.readline() == 'here\n'
    process.send_signal(number)
    _, errors = process.communicate(timeout=DEADLINE_S)
    return process.returncode, errors


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('node', executables())
def test_a_signal_amid_the_imports_ends_a_node(tmp_path: Path, node: str, number: int) -> None:
    """As the signal itself does, which a shell shows as 128 + n."""
    (tmp_path / 'rclpy').mkdir()
    (tmp_path / 'rclpy/__init__.py').write_text(ENDLESS)
    executable = str(find_executable(node))
    assert interrupted([executable], tmp_path, number) == (-number, '')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('module', ['rclpy', 'sitecustomize'])
def test_a_signal_ends_what_the_command_has_become(
    tmp_path: Path, module: str, number: int
) -> None:
    """Below `spikelane node` even one that comes while Python starts, before any code of ours."""
    (tmp_path / f'{module}.py').write_text(ENDLESS if module == 'rclpy' else ENDLESS_START)
    command = [sys.executable, '-m', 'spikelane.main', 'node', 'simulator']
    assert interrupted(command, tmp_path, number) == (-number, '')


def test_a_node_whose_signals_were_held_back_hears_them(tmp_path: Path) -> None:
    """Also where the executable is another package's and does not let them come itself."""
    code = (
        'import signal, sys\n'
        'signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))\n'
        'from rclpy.node import Node\n'
        'from spikelane_sim.nodes.running import run_node\n'
        'class Told(Node):\n'
        '    def __init__(self):\n'
        '        super().__init__("told")\n'
        '        self.create_timer(0.1, lambda: print("here", flush=True))\n'
        'sys.exit(run_node(Told, []))\n'
    )
    assert interrupted([sys.executable, '-c', code], tmp_path, signal.SIGINT) == (0, '')
