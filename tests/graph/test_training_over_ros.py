"""`spikelane train` over ROS: the training in-process, bit for bit, however it is stopped."""

import functools
import json
import os
from pathlib import Path
import signal
import socket
import subprocess
import sys
import time
from typing import Any

import pytest

from spikelane.nodes.domain import own_domain
from spikelane.processes import end_with
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_sim.errors import CheckpointError

pytestmark = pytest.mark.ros

STEPS = 650
DEADLINE_S = 120.0
#: Uneven weights that lead off the lane soon: several episodes, ended in either way.
SWERVING = (
    'simulator.episode.max_distance_m=0.005',
    'simulator.episode.max_steps=130',
    'rstdp.initial_weights.low_pa=100',
    'rstdp.initial_weights.high_pa=500',
)


def start(folder: Path, transport: str, *options: str) -> subprocess.Popen[str]:
    """Start `spikelane train`."""
    command = [sys.executable, '-m', 'spikelane.main', 'train', 'rstdp', '--seed', '3', '--json']
    command += ['--robot', 'kinematic', '--transport', transport, '--out', str(folder)]
    for each in SWERVING:
        command += ['--param', each]
    return subprocess.Popen(
        [*command, '--steps', str(STEPS), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
        preexec_fn=functools.partial(end_with, os.getpid()),
    )


def train(folder: Path, transport: str, *options: str) -> dict[str, Any]:
    """Train to the end; return the result."""
    process = start(folder, transport, *options)
    output, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0, errors
    return dict(json.loads(output))


def wait_for_steps(process: subprocess.Popen[str], folder: Path) -> None:
    """Wait until a training has saved a hundred steps."""
    deadline_s = time.monotonic() + DEADLINE_S
    while saved_steps(folder) < 100:
        if process.poll() is not None or time.monotonic() > deadline_s:
            logs = {path.name: path.read_text() for path in folder.glob('logs/*')}
            process.kill()
            raise AssertionError((process.returncode, process.communicate(), logs))
        time.sleep(0.01)


def checkpoint_bytes(folder: Path) -> bytes:
    """Return the checkpoint."""
    return (folder / 'checkpoint.safetensors').read_bytes()


@pytest.fixture(scope='module')
def inprocess(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the folder of a training in-process."""
    folder = tmp_path_factory.mktemp('train') / 'inprocess'
    train(folder, 'inprocess')
    return folder


def test_over_ros_it_is_the_same_training(inprocess: Path, tmp_path: Path) -> None:
    """Checkpoint, episodes and metrics."""
    folder = tmp_path / 'ros'
    result = train(folder, 'ros')
    assert checkpoint_bytes(folder) == checkpoint_bytes(inprocess)
    assert (folder / 'episodes.csv').read_text() == (inprocess / 'episodes.csv').read_text()
    other = json.loads((inprocess / 'metrics.json').read_text())
    differing = {'transport', 'wall_time_s', 'folder', 'checkpoint', 'figures'}
    assert {k: v for k, v in result.items() if k not in differing} == {
        k: v for k, v in other.items() if k not in differing
    }
    assert result['transport'] == 'ros'
    assert result['lane_losses'] > 0
    logs = {path.name: path.read_text() for path in (folder / 'logs').iterdir()}
    assert set(logs) == {'simulator.log', 'rstdp.log'}
    assert not any('Traceback' in text or 'ERROR' in text for text in logs.values()), logs


def test_over_ros_episodes_have_the_same_changing_conditions(tmp_path: Path) -> None:
    """They are drawn anew in each, also the course, and change again while driving."""
    changing = [
        'randomisation.enabled=true',
        'randomisation.courses=[scenario_1, random:1-3]',
        'perturbation.changes=[camera.yaw_deg=5, pixels.dead_share=0.3, link.latency_ms=50]',
        'perturbation.episode=2',
        'perturbation.time_s=1.0',
    ]
    options = [word for each in changing for word in ('--param', f'simulator.{each}')]
    folders = {transport: tmp_path / transport for transport in ('inprocess', 'ros')}
    results = {name: train(folder, name, *options) for name, folder in folders.items()}
    assert checkpoint_bytes(folders['ros']) == checkpoint_bytes(folders['inprocess'])
    assert results['ros']['episodes'] == results['inprocess']['episodes'] > 2


@pytest.mark.parametrize(
    ('number', 'status', 'transport'),
    [(signal.SIGKILL, -9, 'inprocess'), (signal.SIGINT, 130, 'ros')],
)
def test_stopped_it_goes_on_over_either_transport(
    inprocess: Path, tmp_path: Path, number: int, status: int, transport: str
) -> None:
    """After a kill of the command or Ctrl-C; nothing is left that writes to the folder."""
    folder = tmp_path / 'stopped'
    process = start(folder, 'ros')
    wait_for_steps(process, folder)
    process.send_signal(number)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode in (status, 0), errors  # 0 where it was quicker than the signal
    result = train(folder, transport, '--resume')
    assert result['steps'] == STEPS
    assert checkpoint_bytes(folder) == checkpoint_bytes(inprocess)


@pytest.mark.parametrize(('node', 'number'), [('rstdp', 2), ('rstdp', 15), ('simulator', 15)])
def test_a_training_whose_node_is_told_to_end_has_failed(
    tmp_path: Path, node: str, number: int
) -> None:
    """Exit status 1 and one line, no results; it can be resumed."""
    folder = tmp_path / 'cut'
    process = start(folder, 'ros', '--steps', '1000000')
    wait_for_steps(process, folder)
    os.kill(child(process.pid, node), number)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1, errors
    assert len(errors.splitlines()) == 1
    # Between two episodes the simulator is not in the middle of a drive, and ends with 0.
    statuses = [128 + number] + [0] * (node == 'simulator')
    ended = [f'spikelane train: {node} ended with status {status}' for status in statuses]
    assert errors.startswith(tuple(ended)), errors
    if node == 'rstdp':
        assert ' of 1000000 steps; resume goes on from the last checkpoint' in errors
    assert not (folder / 'metrics.json').exists()
    steps = saved_steps(folder)
    result = train(folder, 'inprocess', '--resume', '--steps', str(steps + 50))
    assert result['steps'] == steps + 50


def test_nodes_that_outlive_the_command_keep_their_domain(tmp_path: Path) -> None:
    """A simulator left over from a killed command would answer the next one's controller."""
    folder = tmp_path / 'killed'
    process = start(folder, 'ros', '--steps', '1000000')
    wait_for_steps(process, folder)
    nodes = [child(process.pid, name) for name in ('simulator', 'rstdp')]
    domains = {domain_of(node) for node in nodes}
    for node in nodes:
        os.kill(node, signal.SIGSTOP)
    try:
        process.kill()
        process.communicate(timeout=DEADLINE_S)
        with own_domain() as other:
            assert {other.number} != domains
    finally:
        for node in nodes:
            os.kill(node, signal.SIGKILL)
    (domain,) = domains
    deadline_s = time.monotonic() + DEADLINE_S
    while not is_free(domain):
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def is_free(domain: int) -> bool:
    """Return whether nobody has reserved a ROS domain, in the way of ROS's domain_coordinator."""
    with socket.socket() as port:
        try:
            port.bind(('', 32768 + domain))
        except OSError:
            return False
    return True


def domain_of(pid: int) -> int:
    """Return the ROS domain of a process."""
    variables = Path(f'/proc/{pid}/environ').read_bytes().decode().split('\0')
    (domain,) = (each for each in variables if each.startswith('ROS_DOMAIN_ID='))
    return int(domain.partition('=')[2])


def child(parent: int, name: str) -> int:
    """Return the child process that runs a node."""
    for task in Path(f'/proc/{parent}/task').iterdir():
        for pid in (task / 'children').read_text().split():
            if any(Path(part).name == name for part in command_of(int(pid))[:2]):
                return int(pid)
    raise AssertionError(f'{name} does not run')


def command_of(pid: int) -> list[str]:
    """Return a process's program and arguments."""
    return Path(f'/proc/{pid}/cmdline').read_bytes().decode().split('\0')


def saved_steps(folder: Path) -> int:
    """Return the steps in the checkpoint, -1 where there is none."""
    try:
        return int(read_checkpoint(folder, 'rstdp').facts['steps'])
    except CheckpointError:
        return -1
