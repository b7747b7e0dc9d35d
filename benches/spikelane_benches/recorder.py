"""Does the recorder lose messages, and what does a message cost it? Measured on real processes."""

from __future__ import annotations

from collections import Counter
import contextlib
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

from spikelane.bag.reader import BagReader
from spikelane.interruption import check
from spikelane_sim.errors import BagError

# From a state message to an event packet [bytes].
SIZES = (250, 500, 1000, 3000)
_LOAD_PUBLISHER = Path(__file__).parent / 'nodes/load_publisher.py'
_START_TIMEOUT_S = 30.0
_STOP_TIMEOUT_S = 20.0
_LOOK_S = 0.1  # between two looks whether a signal has come


def measure_recorder(messages_per_s: float = 1000, seconds: float = 5) -> dict[str, Any]:
    """Record messages that another process publishes on four topics, round robin.

    Args:
        messages_per_s: Messages a second on all topics together.
        seconds: How long.

    Returns:
        `messages_per_s` (reached), `sent`, `recorded`, `lost`, `cpu_us_per_message` (processor
        time of the recorder during the load [µs]) and `cpu_idle_percent` (of one core, when
        nothing comes).

    Raises:
        BagError: One of the processes failed.
    """
    # Here and not above: the other measurements must work where there is no ROS.
    from spikelane.nodes.domain import own_domain

    with (
        own_domain() as domain,
        tempfile.TemporaryDirectory(prefix='spikelane_bench_') as folder,
    ):
        environment = os.environ | domain.environment
        bag = Path(folder) / 'bag'
        topics = [f'/load_{number}' for number in range(len(SIZES))]
        recorder = _start(
            ('-m', 'spikelane.nodes.recorder'), {'output': str(bag), 'topics': topics}, environment
        )
        try:
            _wait_for(bag / 'metadata.yaml', recorder)
            idle_s = _idle_cpu_s(recorder.pid)
            before_s = _cpu_s(recorder.pid)
            load = _load(messages_per_s, seconds, environment)
            used_s = _cpu_s(recorder.pid) - before_s
        finally:
            recorder.send_signal(signal.SIGINT)
            status = recorder.wait(_STOP_TIMEOUT_S)
        if status != 0:
            raise BagError(f'recorder: expected exit status 0, got {status}')
        recorded = Counter(message.topic for message in BagReader(bag).messages())
    return _result(load, recorded, used_s, idle_s)


def _result(
    load: dict[str, Any], recorded: Counter[str], used_s: float, idle_s: float
) -> dict[str, Any]:
    sent = sum(load['sent'].values())
    lost = sum(count - recorded[topic] for topic, count in load['sent'].items())
    return {
        'messages_per_s': round(sent / load['seconds'], 1),
        'sent': sent,
        'recorded': sum(recorded.values()),
        'lost': lost,
        'cpu_us_per_message': round(used_s / sent * 1e6, 1),
        'cpu_idle_percent': round(idle_s * 100, 1),
    }


def _start(
    node: tuple[str, ...], parameters: dict[str, Any], environment: dict[str, str]
) -> subprocess.Popen[str]:
    command = [sys.executable, *node, '--ros-args']
    for name, value in parameters.items():
        command += ['-p', f'{name}:={json.dumps(value)}']
    return subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )


def _wait_for(path: Path, process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + _START_TIMEOUT_S
    while not path.exists():
        if process.poll() is not None or time.monotonic() > deadline:
            raise BagError(f'recorder: expected it to start within {_START_TIMEOUT_S:g} s')
        check()
        time.sleep(0.02)


def _load(messages_per_s: float, seconds: float, environment: dict[str, str]) -> dict[str, Any]:
    count = round(messages_per_s * seconds)
    parameters = {'rate': float(messages_per_s), 'count': count, 'sizes': list(SIZES)}
    publisher = _start((str(_LOAD_PUBLISHER),), parameters, environment)
    try:
        output = _output(publisher, _START_TIMEOUT_S + 3 * seconds)
    finally:
        publisher.kill()
        publisher.wait()
    if publisher.returncode != 0:
        raise BagError(f'load_publisher: expected exit status 0, got {publisher.returncode}')
    load: dict[str, Any] = json.loads(output)
    return load


def _output(process: subprocess.Popen[str], timeout_s: float) -> str:
    """Wait for a process's end and return its output."""
    deadline_s = time.monotonic() + timeout_s
    while time.monotonic() < deadline_s:
        check()
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.communicate(timeout=_LOOK_S)[0]
    raise BagError('load_publisher: expected it to finish, it did not')


def _idle_cpu_s(pid: int) -> float:
    """Return the processor time of one second in which nothing comes [s]."""
    before_s = _cpu_s(pid)
    time.sleep(1.0)
    return _cpu_s(pid) - before_s


def _cpu_s(pid: int) -> float:
    """Return the processor time a process has used, all its threads, to the nanosecond [s]."""
    threads = Path(f'/proc/{pid}/task').glob('*/schedstat')
    return sum(int(thread.read_text().split()[0]) for thread in threads) * 1e-9
