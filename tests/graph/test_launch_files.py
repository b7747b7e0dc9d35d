"""The launch files, run by ROS's `launch`; skipped without it, as it is not on PyPI."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import functools
import importlib.util
import os
from pathlib import Path
import re
import signal
import socket
import subprocess
import sys
import time
from typing import NamedTuple

from domain_coordinator import domain_id
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from safetensors.numpy import load_file

from spikelane.processes import end_with
from spikelane.runs.configuration import Request
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.run import drive_lap
from spikelane.runs.lap.trajectory_bag import read_trajectory
from spikelane.viewer.server import WEB_PORT

pytestmark = pytest.mark.ros
pytest.importorskip('launch_ros', reason='ROS launch is not installed')

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / 'ros2_ws/src/spikelane/launch').glob('*.launch.py'))
DEADLINE_S = 120.0


#: A launch file of somebody else that puts one of ours into a namespace.
AROUND = """
from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import AnyLaunchDescriptionSource
from launch_ros.actions import PushRosNamespace


def generate_launch_description():
    included = IncludeLaunchDescription(AnyLaunchDescriptionSource('{file}'))
    return LaunchDescription([GroupAction([PushRosNamespace('outer'), included])])
"""


class Launch(NamedTuple):
    """A launch that runs, and where its output goes."""

    process: subprocess.Popen
    log: Path

    def wait(self) -> tuple[int, list[tuple[str, int]]]:
        """Wait for its end; return its status, and name and status of the nodes as they ended."""
        status = self.process.wait(DEADLINE_S)
        said = self.log.read_text()
        assert 'Traceback' not in said
        return status, [(n, int(s)) for n, s in re.findall(r'^ENDED (\S+) (-?\d+)$', said, re.M)]

    def until(self, text: str) -> None:
        """Wait until something is said."""
        deadline_s = time.monotonic() + DEADLINE_S
        while text not in self.log.read_text():
            assert time.monotonic() < deadline_s, self.log.read_text()
            assert self.process.poll() is None, self.log.read_text()
            time.sleep(0.1)


@contextlib.contextmanager
def launched(folder: Path, name: str | Path, *arguments: str) -> Iterator[Launch]:
    """Run a launch file, by its path or as one of ours, in a ROS domain of its own."""
    file = name
    if isinstance(name, str):
        file = ROOT / f'ros2_ws/src/spikelane/launch/{name}.launch.py'
    runner = Path(__file__).with_name('run_launch.py')
    log = folder / f'{file.stem}.log'
    with domain_id() as domain, log.open('wb') as output:
        process = subprocess.Popen(
            [sys.executable, str(runner), str(file), *arguments],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=os.environ
            | {
                'ROS_DOMAIN_ID': str(domain),
                'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                'ROS_LOG_DIR': str(folder / 'log'),
            },
            start_new_session=True,
            preexec_fn=functools.partial(end_with, os.getpid()),
        )
        try:
            yield Launch(process, log)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.mark.parametrize('file', FILES, ids=lambda file: file.name)
def test_every_argument_is_described(file: Path) -> None:
    """As `ros2 launch --show-args` shows them: a sentence each."""
    spec = importlib.util.spec_from_file_location('launch_file', file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    arguments = module.generate_launch_description().get_launch_arguments()
    assert len(arguments) >= 3
    for argument in arguments:
        description, *_ = argument.description.split(' Valid choices are: ')
        assert re.fullmatch(r'\S.{6,}\.', description), argument.name


@pytest.mark.parametrize(
    ('given', 'same'),
    [
        ((), {}),
        (
            ('period_ms:=10', 'speed:=2.5'),
            {'simulator.period_ms': 10, 'simulator.speed': 2.5},
        ),
    ],
    ids=['usual', 'fast'],
)
def test_a_lap_ends_by_itself_and_is_the_lap_driven_in_process(
    tmp_path: Path, given: tuple[str, ...], same: dict[str, float]
) -> None:
    """All end with status 0, the recorder last; the recorded path is the same to the last bit."""
    limits = ('max_steps:=100', 'seed:=3', 'controller:=rstdp', 'scenario:=2', 'lane:=inner')
    limits += given
    with launched(tmp_path, 'lap', *limits, f'bag:={tmp_path / "bag"}') as launch:
        status, endings = launch.wait()
    assert status == 0
    assert endings == [('/simulator', 0), ('/rstdp', 0), ('/recorder', 0)]
    parameters = {'simulator.episode.max_steps': 100, **same}
    config = LapConfig.make(Request('2', 'rstdp', 3, 'inprocess', parameters), 'inner')
    driven = drive_lap(config, lambda step, progress_m: None).trajectory
    recorded = read_trajectory(tmp_path / 'bag')
    assert len(recorded) == 101
    assert np.ptp(recorded.stamp_ns) == (1_000_000_000 if given else 5_000_000_000)
    for column in ('x_m', 'y_m', 'distance_m', 'left_rad_s', 'right_rad_s'):
        np.testing.assert_array_equal(getattr(recorded, column), getattr(driven, column))


def test_a_composed_lap_is_the_lap_of_two_processes(tmp_path: Path) -> None:
    """One process with both nodes, and the same recorded path to the last bit."""
    paths = []
    for composed, processes in (('false', 3), ('true', 2)):
        bag = tmp_path / f'bag_{composed}'
        given = ('max_steps:=60', 'seed:=3', 'controller:=rstdp', f'composed:={composed}')
        with launched(tmp_path, 'lap', *given, f'bag:={bag}') as launch:
            status, endings = launch.wait()
        assert status == 0
        assert len(endings) == processes
        assert endings[-1] == ('/recorder', 0)
        paths.append(read_trajectory(bag))
    for column in ('x_m', 'y_m', 'distance_m', 'left_rad_s', 'right_rad_s'):
        np.testing.assert_array_equal(*(getattr(path, column) for path in paths))


def test_composed_controllers_are_compared_in_namespaces(tmp_path: Path) -> None:
    """A process each, whose nodes have the parameters of their own names."""
    given = ('max_steps:=60', 'composed:=true', f'bag:={tmp_path / "bag"}')
    with launched(tmp_path, 'compare', *given) as launch:
        status, endings = launch.wait()
    assert status == 0
    assert len(endings) == 3
    counts = counts_in(tmp_path / 'bag')
    every = [f'/{name}/controller/state' for name in ('braitenberg', 'rstdp')]
    assert {topic: counts[topic] for topic in every} == dict.fromkeys(every, 61)


def counts_in(bag: Path) -> dict[str, int]:
    """Return how many messages of each topic a bag has."""
    with AnyReader([bag]) as reader:
        return {each.topic: each.msgcount for each in reader.connections}


def test_a_lap_has_a_namespace_of_its_own_or_is_put_into_one(tmp_path: Path) -> None:
    """All topics but /diagnostics are in it, and every step is recorded."""
    around = tmp_path / 'around.launch.py'
    around.write_text(AROUND.format(file=ROOT / 'ros2_ws/src/spikelane/launch/lap.launch.py'))
    given = ('max_steps:=60', 'namespace:=inner')
    for file, space in (('lap', '/inner'), (around, '/outer/inner')):
        bag = tmp_path / f'bag{space.count("/")}'
        with launched(tmp_path, file, *given, f'bag:={bag}') as launch:
            status, endings = launch.wait()
        assert status == 0
        assert endings == [
            (f'{space}/{name}', 0) for name in ('simulator', 'braitenberg', 'recorder')
        ]
        counts = counts_in(bag)
        outside = {topic for topic in counts if not topic.startswith(f'{space}/')}
        assert outside == {'/diagnostics'}
        every = [
            f'{space}/{name}' for name in ('clock', 'tf', 'lane/distance', 'controller/state')
        ]
        assert {topic: counts[topic] for topic in every} == dict.fromkeys(every, 61)


def test_a_comparison_may_be_put_into_a_namespace(tmp_path: Path) -> None:
    """Its recorder is met from the controllers' namespaces."""
    around = tmp_path / 'around.launch.py'
    around.write_text(AROUND.format(file=ROOT / 'ros2_ws/src/spikelane/launch/compare.launch.py'))
    with launched(tmp_path, around, 'max_steps:=60', f'bag:={tmp_path / "bag"}') as launch:
        status, endings = launch.wait()
    assert (status, endings[-1]) == (0, ('/outer/recorder', 0))
    counts = counts_in(tmp_path / 'bag')
    every = [f'/outer/{name}/clock' for name in ('braitenberg', 'rstdp')]
    assert {topic: counts[topic] for topic in every} == dict.fromkeys(every, 61)


def test_controllers_are_compared_side_by_side(tmp_path: Path) -> None:
    """Each in its namespace and to its end; one bag has all of their steps."""
    given = ('max_steps:=60', 'controllers:=braitenberg,rstdp', f'bag:={tmp_path / "bag"}')
    with launched(tmp_path, 'compare', *given) as launch:
        status, endings = launch.wait()
    assert status == 0
    assert sorted(endings[:-1]) == [
        ('/braitenberg/braitenberg', 0),
        ('/braitenberg/simulator', 0),
        ('/rstdp/rstdp', 0),
        ('/rstdp/simulator', 0),
    ]
    assert endings[-1] == ('/recorder', 0)
    with AnyReader([tmp_path / 'bag']) as reader:
        topics = {connection.topic for connection in reader.connections}
        # An answer is sent again to whoever joins: steps are told by their stamps.
        stamps: dict[str, set[int]] = {}
        for connection, _, raw in reader.messages():
            if connection.topic.endswith(('/lane/state', '/wheel_velocities')):
                stamp = reader.deserialize(raw, connection.msgtype).header.stamp
                stamps.setdefault(connection.topic, set()).add(stamp.sec * 10**9 + stamp.nanosec)
    expected = {50_000_000 * n for n in range(1, 62)}
    for name in ('braitenberg', 'rstdp'):
        for topic in ('lane/state', 'wheel_velocities'):
            assert stamps[f'/{name}/{topic}'] == expected
        assert {f'/{name}/clock', f'/{name}/tf', f'/{name}/tf_static'} <= topics
    assert not topics & {'/clock', '/tf', '/tf_static'}


@pytest.mark.parametrize(
    ('given', 'same'),
    [
        ((), ()),
        (
            ('period_ms:=25', 'speed:=3'),
            ('--param', 'simulator.period_ms=25', '--param', 'simulator.speed=3'),
        ),
    ],
    ids=['usual', 'fast'],
)
def test_training_ends_by_itself_with_what_it_has_learnt(
    tmp_path: Path, given: tuple[str, ...], same: tuple[str, ...]
) -> None:
    """The weights are those that `spikelane train` in one process learns."""
    learning = ('steps:=300', 'seed:=5', f'output:={tmp_path / "over_launch"}', *given)
    with launched(tmp_path, 'train', *learning) as launch:
        status, endings = launch.wait()
    assert status == 0
    assert sorted(endings) == [('/rstdp', 0), ('/simulator', 0)]
    command = [sys.executable, '-m', 'spikelane.main', 'train', 'rstdp', '--steps', '300']
    command += ['--seed', '5', '--out', str(tmp_path / 'in_process'), *same]
    subprocess.run(command, check=True, capture_output=True)
    learnt, expected = (
        load_file(tmp_path / folder / 'checkpoint.safetensors')
        for folder in ('over_launch', 'in_process')
    )
    assert learnt.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(learnt[name], values)


def test_ctrl_c_ends_all(tmp_path: Path) -> None:
    """Amid a lap, as a terminal sends it: to all processes at once; the bag is closed.

    A node whose work it cuts short says so with 130.
    """
    with launched(tmp_path, 'lap', f'bag:={tmp_path / "bag"}') as launch:
        launch.until('recording 12 topics')
        time.sleep(1.0)
        os.killpg(launch.process.pid, signal.SIGINT)
        status, endings = launch.wait()
    assert sorted(name for name, _ in endings) == ['/braitenberg', '/recorder', '/simulator']
    assert {ended for _, ended in endings} <= {0, 130}
    assert status == 0
    with AnyReader([tmp_path / 'bag']) as reader:
        assert reader.message_count > 0


def test_a_recorder_that_cannot_record_ends_all(tmp_path: Path) -> None:
    """As where the bag is there already: nobody waits for it for ever."""
    (tmp_path / 'bag').mkdir()
    with launched(tmp_path, 'lap', f'bag:={tmp_path / "bag"}') as launch:
        assert launch.process.wait(DEADLINE_S) == 1
        said = launch.log.read_text()
    assert f'{tmp_path / "bag"}: expected a folder that does not exist yet' in said
    assert '/recorder ended with status 2; its output says why' in said


@pytest.mark.parametrize(
    ('name', 'given', 'reason'),
    [
        ('lap', ('lane:=middle',), "lane: expected outer or inner, got 'middle'"),
        ('lap', ('controller_file:={odd}',), 'lowest_rows: expected'),
        ('compare', ('lane:=middle',), "lane: expected outer or inner, got 'middle'"),
        ('train', ('output:={learnt}',), 'expected a folder without a checkpoint, or to resume'),
    ],
)
def test_a_node_that_fails_ends_all_with_its_reason(
    tmp_path: Path, name: str, given: tuple[str, ...], reason: str
) -> None:
    """With status 1, and without a bag of nothing."""
    places = {'odd': tmp_path / 'odd.yaml', 'learnt': tmp_path / 'learnt'}
    places['odd'].write_text('/**: {ros__parameters: {lowest_rows: 0}}\n')
    places['learnt'].mkdir()
    (places['learnt'] / 'checkpoint.safetensors').touch()
    bag = () if name == 'train' else (f'bag:={tmp_path / "bag"}',)
    with launched(tmp_path, name, *(each.format(**places) for each in given), *bag) as launch:
        assert launch.process.wait(DEADLINE_S) == 1
        said = launch.log.read_text()
    assert reason in said
    assert 'ended with status' in said
    assert not (tmp_path / 'bag').exists()


def test_a_viewer_that_cannot_show_ends_all(tmp_path: Path) -> None:
    """As where its port is in use."""
    with socket.socket() as taken:
        # Where somebody else has it, it is in use as well.
        with contextlib.suppress(OSError):
            taken.bind(('127.0.0.1', WEB_PORT))
            taken.listen()
        given = ('viewer:=true', f'bag:={tmp_path / "bag"}')
        with launched(tmp_path, 'lap', *given) as launch:
            assert launch.process.wait(DEADLINE_S) == 1
            said = launch.log.read_text()
    assert f'web_port: expected a free port, got {WEB_PORT}' in said
    assert '/viewer ended with status ' in said


def test_the_viewer_says_where_to_look_and_ends_on_ctrl_c(tmp_path: Path) -> None:
    """On this machine alone, on a port that may be chosen."""
    with launched(tmp_path, 'view', 'port:=39393') as launch:
        launch.until('open http://127.0.0.1:39393?url=')
        os.killpg(launch.process.pid, signal.SIGINT)
        status, endings = launch.wait()
    assert (status, endings) == (0, [('/viewer', 0)])


@pytest.mark.parametrize(
    ('robot', 'without'), [('p3dx', ('camera', 'base', 'joystick')), ('turtlebot4', ('camera',))]
)
def test_a_real_robot_is_driven_by_its_parameters(
    tmp_path: Path, robot: str, without: tuple[str, ...]
) -> None:
    """Without the drivers, which are not here: the controller waits for events, until Ctrl-C."""
    with launched(tmp_path, robot, *(f'{name}:=false' for name in without)) as launch:
        launch.until('ready: answers /event_camera/events')
        os.killpg(launch.process.pid, signal.SIGINT)
        status, endings = launch.wait()
    assert (status, endings) == (0, [('/rstdp', 0)])
    assert 'wheel_velocities to cmd_vel' in launch.log.read_text()


@pytest.mark.parametrize(
    ('given', 'reason'),
    [
        ('seed:=many', "seed: expected a whole number, got 'many'"),
        ('period_ms:=0.01', "period_ms: expected a whole number, got '0.01'"),
        ('speed:=fast', "speed: expected a positive number, got 'fast'"),
        ('speed:=-1', "speed: expected a positive number, got '-1'"),
    ],
)
def test_a_wrong_argument_is_told(tmp_path: Path, given: str, reason: str) -> None:
    """By name, with what is allowed; nothing is started."""
    with launched(tmp_path, 'lap', given) as launch:
        assert launch.process.wait(DEADLINE_S) == 1
        assert reason in launch.log.read_text()
