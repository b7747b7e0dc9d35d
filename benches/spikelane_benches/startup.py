"""How long a command takes to start: processor time of fresh processes up to a point."""

from __future__ import annotations

from collections.abc import Sequence
import os
import statistics
import subprocess
import sys
import tempfile
from typing import Any

import numba

import spikelane_sim.compiled  # noqa: F401  # Numba as it is loaded for all kernels here

_HELP = 'from spikelane_entry import main; main()'

#: The first step of the loop says how much processor time has passed, and ends the process.
_LAP = """
import os, sys, time
from spikelane.main import run
from spikelane_sim.simulator import Simulator
def end(*_):
    os.write(1, str(time.process_time()).encode())
    os._exit(0)
Simulator.step = end
run(sys.argv[1:])
"""

_NUMBA = """
import time
from spikelane_benches.startup import return_nothing
return_nothing()
print(time.process_time())
"""


@numba.njit(cache=True)
def return_nothing() -> None:
    """Do nothing: the first call of a kernel loads Numba's libraries."""


def measure_startup(repeats: int = 7) -> dict[str, Any]:
    """Start commands again and again.

    Args:
        repeats: Counted ones; one before them writes the caches of Python and Numba.

    Returns:
        Medians of the processor time [s]: `help_s` of `spikelane --help`; `lap_s` of a lap in this
        process up to its first step, with all kernels loaded; `numba_s` of Numba with one empty
        kernel; and `beyond_numba_s`, the difference of the last two.
    """
    return_nothing()
    with tempfile.TemporaryDirectory() as folder:
        lap = ['lap', '--transport', 'inprocess', '--engine', 'kinematic', '--out']
        found = [
            (_whole_s(_HELP, '--help'), _told_s(_LAP, *lap, f'{folder}/{i}'), _told_s(_NUMBA))
            for i in range(repeats + 1)
        ]
    help_s, lap_s, numba_s = (statistics.median(each) for each in zip(*found[1:], strict=True))
    return {
        'help_s': round(help_s, 3),
        'lap_s': round(lap_s, 3),
        'numba_s': round(numba_s, 3),
        'beyond_numba_s': round(lap_s - numba_s, 3),
    }


def _told_s(code: str, *words: str) -> float:
    """Return the processor time that a program prints [s]."""
    return float(_start(code, words).stdout)


def _whole_s(code: str, *words: str) -> float:
    """Return the processor time of a program up to its end [s]."""
    tell = 'lambda: os.write(2, str(time.process_time()).encode())'
    return float(_start(f'import atexit, os, time\natexit.register({tell})\n{code}', words).stderr)


def _start(code: str, words: Sequence[str]) -> subprocess.CompletedProcess[bytes]:
    environment = os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)}
    command = [sys.executable, '-c', code, *words]
    return subprocess.run(command, check=True, capture_output=True, env=environment)
