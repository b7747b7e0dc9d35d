"""A signal ends a command with 128 + n at any moment: no traceback, nothing lost.

`python tests/core/spikelane/test_interruption.py 200` interrupts commands at 200 random moments.
"""

from __future__ import annotations

from collections.abc import Iterator
import os
from pathlib import Path
import random
import signal
import subprocess
import sys
import tempfile
import time

import pytest
import xarray as xr

from spikelane.interruption import check, GRACE_S, Interrupted, signals_noted
from spikelane_controllers.checkpoint import read_checkpoint

DEADLINE_S = 120.0
#: From the start of a command to the last moment at which it is interrupted [s].
LATEST_S = 6.0
ENDLESS = ('--param', 'simulator.episode.max_laps=0')
COMMANDS = {
    'lap': ('lap', '--transport', 'inprocess', '--robot', 'kinematic', *ENDLESS),
    'lap, recorded': (
        *('lap', '--transport', 'inprocess', '--robot', 'kinematic', '--controller', 'rstdp'),
        *('--record', 'all', *ENDLESS),
    ),
    'lap, physics': ('lap', '--transport', 'inprocess', *ENDLESS),
    'train rstdp': ('train', 'rstdp', '--robot', 'kinematic', '--steps', '1000000'),
    'evaluate': ('evaluate', '--robot', 'kinematic', '--seeds', '1000'),
    'transfer': ('transfer', '--robot', 'kinematic', '--states', '20000'),
}
#: Prints a line when signals are noted, and never looks for one.
WITHOUT_A_LOOP = """
import time
from spikelane.interruption import signals_noted
with signals_noted():
    print('ready', flush=True)
    time.sleep(60)
"""
#: Prints a line in the middle of a step that takes longer than a phase without a loop may.
A_LONG_STEP = """
import time
from spikelane.interruption import check, checking, GRACE_S, Interrupted, signals_noted
with signals_noted():
    try:
        with checking():
            print('ready', flush=True)
            time.sleep(GRACE_S + 1.0)
            check()
    except Interrupted:
        print('in order')
"""


def start(*arguments: str) -> subprocess.Popen[str]:
    """Start Python with default signal handlers."""
    return subprocess.Popen(
        [sys.executable, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def interrupted(folder: Path, name: str, number: int, after_s: float) -> tuple[int, str]:
    """Interrupt a command; return its exit status and its standard error."""
    process = start('-m', 'spikelane.main', *COMMANDS[name], '--out', str(folder))
    time.sleep(after_s)
    process.send_signal(number)
    _, errors = process.communicate(timeout=DEADLINE_S)
    return process.returncode, errors


def saved_steps(folder: Path) -> int:
    """Return the steps of the checkpoint of a training, 0 where there is none."""
    if not (folder / 'checkpoint.safetensors').exists():
        return 0
    return int(read_checkpoint(folder, 'rstdp').facts['steps'])


def is_as_expected(number: int, status: int, errors: str) -> bool:
    """Whether a command ended by a signal, or before it came, without a word.

    Before the command's first line it is the kernel that ends the process.
    """
    return status in (128 + number, -number, 0) and not errors


def test_a_signal_is_raised_once_and_by_check_alone() -> None:
    """The step is finished first; the second signal does not cut the clean-up short."""
    with signals_noted():
        check()
        os.kill(os.getpid(), signal.SIGTERM)
        sum(range(1000))
        with pytest.raises(Interrupted, match='ended by SIGTERM') as error:
            check()
        os.kill(os.getpid(), signal.SIGINT)
        sum(range(1000))
        check()
    assert error.value.exit_status == 143


def test_handlers_are_restored_after_the_block() -> None:
    """Those of the test runner."""
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with signals_noted():
        pass
    assert [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)] == before


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_phase_without_a_loop_ends_too(number: int) -> None:
    """After two seconds, with the same exit status and without a traceback."""
    process = start('-c', WITHOUT_A_LOOP)
    assert process.stdout is not None
    assert process.stdout.readline() == 'ready\n'
    start_s = time.monotonic()
    process.send_signal(number)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, errors) == (128 + number, '')
    assert time.monotonic() - start_s >= GRACE_S


def test_a_loop_that_leaves_something_may_finish_a_long_step() -> None:
    """As on a busy machine or a slow disk: what is done on its way out is done."""
    process = start('-c', A_LONG_STEP)
    assert process.stdout is not None
    assert process.stdout.readline() == 'ready\n'
    process.send_signal(signal.SIGTERM)
    said, errors = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, said, errors) == (0, 'in order\n', '')


def test_ctrl_c_amid_the_first_imports_shows_no_traceback(tmp_path: Path) -> None:
    """It ends the process, as the shell expects it."""
    (tmp_path / 'argparse.py').write_text(
        'import time; print("ready", flush=True); time.sleep(60)'
    )
    code = f'import sys; sys.path.insert(0, {str(tmp_path)!r})\n'
    process = start('-c', f'{code}from spikelane_entry import main; main()')
    assert process.stdout is not None
    assert process.stdout.readline() == 'ready\n'
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, errors) == (-signal.SIGINT, '')


@pytest.mark.parametrize('name', COMMANDS)
def test_a_command_ends_at_a_random_moment(tmp_path: Path, name: str) -> None:
    """With exit status 143 and no word, whatever it is doing."""
    after_s = random.Random(name).uniform(1.0, LATEST_S)
    status, errors = interrupted(tmp_path / 'run', name, signal.SIGTERM, after_s)
    assert is_as_expected(signal.SIGTERM, status, errors), (after_s, status, errors)


def test_an_interrupted_training_can_be_resumed(tmp_path: Path) -> None:
    """Its checkpoint and recording are whole; there are no results before it is done."""
    folder = tmp_path / 'run'
    recorded = (*COMMANDS['train rstdp'], '--record', 'spikes,weights')
    process = start('-m', 'spikelane.main', *recorded, '--out', str(folder))
    deadline_s = time.monotonic() + DEADLINE_S
    while saved_steps(folder) == 0:  # the first checkpoint is written before anything is driven
        assert time.monotonic() < deadline_s
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, errors) == (143, '')
    steps = saved_steps(folder)
    assert not (folder / 'metrics.json').exists()
    with xr.open_dataset(folder / 'recording.nc') as recording:
        assert recording.attrs['complete'] == 0
        assert recording.sizes['step'] >= steps
    assert not list(folder.glob('.*.part'))
    resumed = ('train', 'rstdp', '--robot', 'kinematic', '--steps', str(steps + 50))
    process = start('-m', 'spikelane.main', *resumed, '--out', str(folder), '--resume')
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0, errors
    assert saved_steps(folder) == steps + 50


def moments(count: int, seed: int = 0) -> Iterator[tuple[str, int, float]]:
    """Yield commands, signals and moments [s] at random."""
    rng = random.Random(seed)
    for _ in range(count):
        number = rng.choice([signal.SIGINT, signal.SIGTERM])
        yield rng.choice(list(COMMANDS)), number, rng.uniform(0.0, LATEST_S)


def main() -> int:
    """Interrupt as often as the command line says; return how often it went wrong."""
    wrong = 0
    statuses: dict[int, int] = {}
    for name, number, after_s in moments(int(sys.argv[1])):
        with tempfile.TemporaryDirectory() as folder:
            status, errors = interrupted(Path(folder) / 'run', name, number, after_s)
        statuses[status] = statuses.get(status, 0) + 1
        if not is_as_expected(number, status, errors):
            wrong += 1
            print(f'{name}, signal {number} after {after_s:.2f} s: {status}, {errors}')
    print(f'{sys.argv[1]} moments, {wrong} wrong; exit statuses {dict(sorted(statuses.items()))}')
    return wrong


if __name__ == '__main__':
    sys.exit(main())
