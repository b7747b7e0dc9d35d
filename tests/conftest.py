"""What tests of all kinds share: drives, and bags of them as other programs would write them."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
import itertools
from pathlib import Path
import re
import shutil
import signal
import subprocess
import time
from typing import Any, NamedTuple, Protocol

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

from spikelane.bag.writer import BagWriter
from spikelane_controllers.checkpoint import write_checkpoint
from spikelane_controllers.learning.results import FinishedRun, TrainingResults
from spikelane_controllers.learning.training import Termination
from spikelane_controllers.registry import make_controller, training_results
from spikelane_sim.codecs import encode
from spikelane_sim.contract import controller_rng, LaneState, Observation, WheelVelocities
from spikelane_sim.events import EVENT_DTYPE, Events
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

_MSGS = Path(__file__).parents[1] / 'msgs'
_TYPES = {
    'lane/state': 'spikelane_msgs/msg/LaneState',
    'event_camera/events': 'event_camera_msgs/msg/EventPacket',
    'wheel_velocities': 'spikelane_msgs/msg/WheelVelocities',
    'controller/state': 'spikelane_msgs/msg/ControllerState',
    'parameter_changes': 'rcl_interfaces/msg/ParameterEvent',
    'parameter_events': 'rcl_interfaces/msg/ParameterEvent',
}
#: Wall time of the first message, and from step to step [ns].
_BEGIN_NS, _STEP_NS = 10**18, 5_000_000


class Said(NamedTuple):
    """A message on the graph."""

    topic: str
    log_ns: int
    fields: Any


class Seen(NamedTuple):
    """An observation and its answer."""

    observation: Observation
    wheels: WheelVelocities | None


#: Why a test may be skipped, and how many tests may be for that at most. The programs and packages
#: that `setup/bootstrap test` installs are no reason.
SKIPS = {
    'ROS launch is not installed': 2,  # it is not on PyPI
    'no recordings of cameras at ': 30,  # they are not part of the repository
    'mounting a small disk needs root': 2,
    'mounting is not permitted here': 1,
    "colcon's setup files do not work in paths with a space": 2,
    'no other Python that is supported': 1,
}


#: Each may import those before it.
PACKAGES = ('spikelane_sim', 'spikelane_controllers', 'spikelane')


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option with which `colcon test` tests one package, see its setup.cfg."""
    parser.addoption(
        '--package', choices=PACKAGES, help='run the tests of one package: no other imports more'
    )


def pytest_configure(config: pytest.Config) -> None:
    """Declare the markers, for whatever file of settings pytest is run with."""
    config.addinivalue_line('markers', 'ros: needs a built workspace')
    config.addinivalue_line('markers', 'slow: takes more than ten seconds')


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out what is not a test of the package asked for."""
    package = config.getoption('package')
    if not package or collection_path.suffix != '.py':
        return None
    return _package_of(collection_path) != package or None


def _package_of(file: Path) -> str:
    """Return the last of the packages that a test imports, '' for none."""
    imports = re.findall(r'^ *(?:from|import) (\w+)', file.read_text(encoding='utf-8'), re.M)
    return next((name for name in PACKAGES[::-1] if name in imports), '')


def _excess_skips(session: pytest.Session) -> list[str]:
    """Return the skips that are not allowed, each with its place and its reason."""
    terminal = session.config.pluginmanager.get_plugin('terminalreporter')
    left, excess = dict(SKIPS), []
    for report in terminal.stats.get('skipped', []) if terminal else []:
        path, line, reason = report.longrepr
        reason = reason.removeprefix('Skipped: ')
        kind = next((start for start in SKIPS if reason.startswith(start)), '')
        left[kind] = left.get(kind, 0) - 1
        if left[kind] < 0:
            excess.append(f'{path}:{line}: {reason}')
    return excess


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail where more tests are skipped than may be; `-ra` lists them all with their reasons."""
    excess = _excess_skips(session)
    if excess and session.exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
    for skip in excess:
        print(f'\nskipped without a reason that is allowed: {skip}', end='')


def _typestore() -> Any:
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in _TYPES.values():
        package, _, stem = name.split('/')
        if not (_MSGS / package).exists():  # one of ROS itself
            continue
        text = (_MSGS / package / 'msg' / f'{stem}.msg').read_text()
        store.register(get_types_from_msg(text, name))
    return store


def _check_events(events: Events, width: int, height: int) -> None:
    assert (events.dtype, events.ndim) == (EVENT_DTYPE, 1)
    assert (events['x'] < width).all()
    assert (events['y'] < height).all()
    assert np.isin(events['polarity'], (-1, 1)).all()
    assert (np.diff(events['t']) >= 0).all()


class Drives:
    """Makes drives, and bags of them.

    Attributes:
        types: Types of the messages.
        said: Makes a message on the graph.
        seen: Makes an observation with its answer.
    """

    said, seen = Said, Seen

    def __init__(self) -> None:
        self.types = _typestore()

    def drive(
        self,
        controller: str | Any,
        *,
        seed: int,
        episodes: Sequence[int],
        parameters: Mapping[str, Any] | None = None,
        from_time_zero: bool = False,
    ) -> list[Seen]:
        """Drive episodes of so many steps each, as a simulator and a controller node do.

        Args:
            controller: Its name, or a controller that is ready.
            seed: Seed of all randomness.
            episodes: Steps of each.
            parameters: Parameters of the controller.
            from_time_zero: Whether simulation time begins again with each episode.
        """
        if isinstance(controller, str):
            controller = make_controller(controller, parameters)
        seen = []
        simulation = SimulatorParameters.from_mapping({'robot.model': 'kinematic'})
        with Simulator(simulation) as simulator:
            for number, steps in enumerate(episodes):
                observation = simulator.reset(
                    None, seed if number == 0 else None, from_time_zero=from_time_zero
                )
                assert observation.lane is not None
                controller.reset(controller_rng(seed, observation.lane.episode))
                for step in range(steps + 1):
                    wheels = controller.step(observation)
                    seen.append(Seen(observation, wheels))
                    if step < steps:
                        observation = simulator.step(wheels)
        return seen

    def say(
        self,
        seen: Iterable[Seen],
        *,
        encoding: str = 'evt3',
        prefix: str = '/',
        first_number: int = 7,
    ) -> list[Said]:
        """Return what a graph says in a drive, in order."""
        said = []
        for number, (observation, wheels) in enumerate(seen):
            log_ns = _BEGIN_NS + number * _STEP_NS
            stamp_ns = observation.stamp_ns
            if observation.lane is not None:
                said.append(
                    Said(f'{prefix}lane/state', log_ns, self._lane(stamp_ns, observation.lane))
                )
            packet = self.packet(observation.events, stamp_ns, first_number + number, encoding)
            said.append(Said(f'{prefix}event_camera/events', log_ns + 1000, packet))
            if wheels is not None:
                answer = self.wheels(stamp_ns, wheels)
                said.append(Said(f'{prefix}wheel_velocities', log_ns + 2000, answer))
        return said

    def packet(self, events: Events, stamp_ns: int, number: int, encoding: str) -> Any:
        """Return the packet of a step."""
        packet = encode(encoding, events, stamp_ns, 128, 128)
        return self._make(
            'event_camera/events',
            self.header(stamp_ns),
            128,
            128,
            number,
            packet.time_base_ns,
            encoding,
            False,
            np.frombuffer(packet.data, np.uint8),
        )

    def wheels(self, stamp_ns: int, wheels: WheelVelocities) -> Any:
        """Return the message of an answer."""
        return self._make('wheel_velocities', self.header(stamp_ns), *wheels)

    def controller_state(self, stamp_ns: int, controller: str) -> Any:
        """Return the state message of a controller that shows nothing."""
        nothing = np.zeros(0, np.uint32)
        return self._make(
            'controller/state',
            self.header(stamp_ns),
            controller,
            1,
            0,
            -1,
            float('nan'),
            [],
            nothing,
            False,
        )

    def change(self, stamp_ns: int, node: str, **values: bool | float) -> Any:
        """Return the message of a change of parameters."""
        types = self.types.types
        changed = []
        for name, value in values.items():
            is_flag = isinstance(value, bool)
            number = 0.0 if is_flag else float(value)
            arrays = (np.zeros(0, each) for each in (np.uint8, bool, np.int64, np.float64))
            fields = (1 if is_flag else 3, is_flag and value, 0, number, '', *arrays, [])
            wrapped = types['rcl_interfaces/msg/ParameterValue'](*fields)
            changed.append(types['rcl_interfaces/msg/Parameter'](name, wrapped))
        stamp = types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
        return types['rcl_interfaces/msg/ParameterEvent'](stamp, node, [], changed, [])

    def header(self, stamp_ns: int) -> Any:
        """Return a header of this stamp."""
        stamp = self.types.types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
        return self.types.types['std_msgs/msg/Header'](stamp, 'world')

    def write(
        self,
        path: Path,
        said: Iterable[Said],
        *,
        compression: str = 'zstd',
        max_file_bytes: int = 0,
        facts: Mapping[str, str] | None = None,
    ) -> Path:
        """Write what was said with our own recorder's writer."""
        ids: dict[str, int] = {}
        with BagWriter(
            path,
            compression=compression,
            chunk_bytes=4096,
            max_file_bytes=max_file_bytes,
            custom_data=facts,
        ) as bag:
            for topic, log_ns, fields in said:
                name = _type_of(topic)
                if topic not in ids:
                    text = self.types.generate_msgdef(name, ros_version=2)[0]
                    ids[topic] = bag.add_topic(topic, name, text)
                data = bytes(self.types.serialize_cdr(fields, name))
                bag.write(ids[topic], log_ns, log_ns, data)
        return path

    def write_otherwise(
        self, path: Path, said: Iterable[Said], *, storage: str, mode: str = ''
    ) -> Path:
        """Write what was said with rosbags, in another storage or with rosbag2's compression."""
        plugin = StoragePlugin.SQLITE3 if storage == 'sqlite3' else StoragePlugin.MCAP
        writer = Writer(path, version=9, storage_plugin=plugin)
        if mode:
            writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
        with writer as bag:
            connections: dict[str, Any] = {}
            for topic, log_ns, fields in said:
                name = _type_of(topic)
                if topic not in connections:
                    connections[topic] = bag.add_connection(topic, name, typestore=self.types)
                bag.write(connections[topic], log_ns, self.types.serialize_cdr(fields, name))
        return path

    def _make(self, topic: str, *fields: Any) -> Any:
        return self.types.types[_TYPES[topic]](*fields)

    def _lane(self, stamp_ns: int, lane: LaneState) -> Any:
        return self._make(
            'lane/state',
            self.header(stamp_ns),
            lane.lane,
            lane.distance_m,
            lane.heading_error_rad,
            lane.position_m,
            lane.section,
            lane.progress_m,
            lane.laps,
            lane.episode,
            lane.step,
            lane.terminated,
            lane.reason,
        )


def _type_of(topic: str) -> str:
    return next(name for end, name in _TYPES.items() if topic.endswith(end))


@pytest.fixture(autouse=True)
def _signals_come() -> Iterator[None]:
    """Let signals come after each test as before it: processes inherit what is held back."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    yield
    signal.pthread_sigmask(signal.SIG_SETMASK, before)


@pytest.fixture(scope='session')
def chromium() -> str:
    """Give the browser that pages are tested in; `setup/bootstrap test` brings one."""
    found = shutil.which('chromium') or shutil.which('google-chrome')
    assert found, 'no Chromium: setup/bootstrap test'
    return found


@pytest.fixture(scope='session')
def check_events() -> Callable[[Events, int, int], None]:
    """Give what checks that events are what is relied on, for a sensor of a width and height."""
    return _check_events


@pytest.fixture(scope='session')
def drives() -> Drives:
    """Give what makes drives and bags of them."""
    return Drives()


@pytest.fixture(scope='session')
def braitenberg_drive(drives: Drives) -> list[Seen]:
    """Give three episodes that the Braitenberg controller drove with seed 5."""
    return drives.drive('braitenberg', seed=5, episodes=(30, 20, 25))


@pytest.fixture(scope='session')
def bag_of(
    drives: Drives, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[Iterable[Said]], Path]:
    """Give what writes a bag of ours into a folder of its own."""

    def write(said: Iterable[Said], **options: Any) -> Path:
        """Write a bag; return its folder."""
        return drives.write(tmp_path_factory.mktemp('drive') / 'bag', said, **options)

    return write


@pytest.fixture(scope='session')
def shown_at() -> Callable[[str, Path], dict[str, dict[str, dict[int, Any]]]]:
    """Give what asks a viewer's server what it has been sent, with a file to keep it in."""
    return _shown_at


def _shown_at(address: str, file: Path) -> dict[str, dict[str, dict[int, Any]]]:
    """Return what Rerun's own client is sent: values by entity, component and time [ns]."""
    # Here and not above: most tests need no Rerun.
    from rerun.recording import load_recording

    from spikelane.viewer.server import rerun_program

    command = [str(rerun_program()), address, '--save', str(file), '--bind', '127.0.0.1']
    client = subprocess.Popen([*command, '--port', 'auto'], stderr=subprocess.DEVNULL)
    size, since_s, deadline_s = -1, time.monotonic(), time.monotonic() + 60
    while time.monotonic() < min(since_s + 3, deadline_s):  # until nothing has come for a while
        now = file.stat().st_size if file.exists() else -1
        if now != size or now <= 0:
            size, since_s = now, time.monotonic()
        time.sleep(0.1)
    client.terminate()
    client.wait(60)
    found: dict[str, dict[str, dict[int, Any]]] = {}
    for chunk in load_recording(file).chunks():
        batch = chunk.to_record_batch()
        times = [0] * batch.num_rows
        if not chunk.is_static:
            times = batch.column('simulation').to_numpy(zero_copy_only=False).astype(int).tolist()
        for name in batch.schema.names:
            if ':' in name:
                values = zip(times, batch.column(name).to_pylist(), strict=True)
                entity = found.setdefault(chunk.entity_path, {})
                entity.setdefault(name, {}).update(values)
    return found


class FinishTraining(Protocol):
    """Writes the checkpoint of a training that has finished, and reads what it has to show."""

    def __call__(
        self,
        controller: str,
        ends: Sequence[Termination],
        *,
        steps: int,
        outcomes: Sequence[tuple[Any, ...]] = (),
        **config: Any,
    ) -> TrainingResults:
        """Finish a training whose episodes ended so."""


@pytest.fixture
def finish_training(tmp_path: Path) -> FinishTraining:
    """Give what finishes trainings, each in a folder of its own."""
    numbers = itertools.count()

    def finish(
        controller: str,
        ends: Sequence[Termination],
        *,
        steps: int,
        outcomes: Sequence[tuple[Any, ...]] = (),
        **config: Any,
    ) -> TrainingResults:
        folder = tmp_path / f'finished-{next(numbers)}'
        folder.mkdir()
        facts = {
            'config': {'scenario': '1', **config},
            'steps': steps,
            'terminations': [list(each) for each in ends],
            'outcomes': [list(each) for each in outcomes],
            'controller': {'updates': 0},
        }
        file = folder / 'checkpoint.safetensors'
        write_checkpoint(file, controller, {'a': np.zeros(2)}, facts)
        run = FinishedRun(controller, folder, facts['config'], {})
        return training_results(controller)(run)

    return finish
