"""`spikelane lap` over ROS: what it leaves, and that it is the lap driven in-process."""

from collections import Counter
import json
import os
from pathlib import Path
import subprocess
import sys
from typing import Any, NamedTuple

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import numpy as np
import pandas as pd
import pytest
from rosbags.highlevel import AnyReader
import xarray as xr
import yaml

import spikelane
from spikelane.main import run

pytestmark = pytest.mark.ros

#: A URDF that is no registered robot's.
OWN = Path(__file__).parents[2] / 'docs/examples/robot/small.urdf'
STEPS = 100
DEADLINE_S = 280
#: Hashes of the official definitions, and of std_msgs.
HASHES = {
    '/event_camera/events': (
        'RIHS01_d6fa176260b1f37e5a40845305315e150a0f18191241eb64f407442aa29844aa'
    ),
    '/lane/distance': 'RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a',
    '/tf': 'RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087',
}


class Lap(NamedTuple):
    """A command that has ended, and what it left."""

    status: int
    output: str
    errors: str
    folder: Path

    @property
    def result(self) -> dict[str, Any]:
        """The one JSON object printed."""
        return json.loads(self.output)

    @property
    def bag(self) -> Path:
        """The recording."""
        return self.folder / 'bag'

    def listed_topics(self) -> dict[str, dict[str, Any]]:
        """Return what metadata.yaml says of each topic."""
        metadata = yaml.safe_load((self.bag / 'metadata.yaml').read_text())
        topics = metadata['rosbag2_bagfile_information']['topics_with_message_count']
        return {each['topic_metadata']['name']: each for each in topics}


def drive(folder: Path, *options: str) -> Lap:
    """Run `spikelane lap` with the kinematic robot."""
    command = [sys.executable, '-m', 'spikelane.main', 'lap', '--robot', 'kinematic', '--json']
    ended = subprocess.run(
        [*command, '--out', str(folder), *options],
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        cwd=folder.parent,
        env=os.environ | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
    )
    return Lap(ended.returncode, ended.stdout, ended.stderr, folder)


def drive_short(folder: Path, *options: str) -> Lap:
    """Drive the first 100 steps with seed 3."""
    limit = f'simulator.episode.max_steps={STEPS}'
    return drive(folder, '--seed', '3', '--param', limit, *options)


@pytest.fixture(scope='module')
def short(tmp_path_factory: pytest.TempPathFactory) -> Lap:
    """Give 100 steps over ROS."""
    return drive_short(tmp_path_factory.mktemp('short') / 'lap', '--transport', 'ros')


def test_an_episode_that_is_no_lap_is_reported_as_such(short: Lap) -> None:
    """Exit status 1, and everything measured all the same."""
    assert short.status == 1, short.errors
    result = short.result
    assert (result['completed'], result['reason'], result['lap_time_s']) == (
        False,
        'step_limit',
        None,
    )
    assert (result['steps'], result['seed'], result['lane']) == (STEPS, 3, 'outer')
    assert (result['transport'], result['engine']) == ('ros', 'kinematic')
    assert short.errors == ''


def test_the_run_folder_is_complete(short: Lap) -> None:
    """Configuration, bag, trajectory, metrics, figures, and a log of each node."""
    assert {path.name for path in short.folder.iterdir()} >= {
        'bag',
        'config.yaml',
        'figures',
        'logs',
        'metrics.json',
        'trajectory.csv',
    }
    assert json.loads((short.folder / 'metrics.json').read_text()) == short.result
    assert Path(short.result['figure']).stat().st_size > 1000
    logs = {path.name: path.read_text() for path in (short.folder / 'logs').iterdir()}
    assert set(logs) == {'braitenberg.log', 'recorder.log', 'simulator.log'}
    assert not any('Traceback' in text or 'ERROR' in text for text in logs.values()), logs


def test_every_message_of_every_step_is_recorded(short: Lap, every_step: tuple[str, ...]) -> None:
    """Steps and the first observation; counted by rosbags, in the metadata, and decoded."""
    with AnyReader([short.bag]) as reader:
        counts = Counter(connection.topic for connection, _, _ in reader.messages())
        types = {each.topic: each.msgtype for each in reader.connections}
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
    assert {topic: counts[topic] for topic in every_step} == dict.fromkeys(every_step, STEPS + 1)
    assert counts['/tf_static'] == counts['/robot_description'] == 1
    assert counts['/diagnostics'] >= 1
    assert types['/event_camera/events'] == 'event_camera_msgs/msg/EventPacket'
    listed = {name: each['message_count'] for name, each in short.listed_topics().items()}
    # Offered, and nothing was changed.
    assert listed == {**counts, '/simulator/parameter_changes': 0}


def test_another_reader_sees_the_same_steps(short: Lap) -> None:
    """mcap-ros2-support decodes by the definitions in the file; stamps and answers agree."""
    stamps: dict[str, list[int]] = {}
    topics = ['/lane/state', '/event_camera/events', '/wheel_velocities', '/ground_truth/odom']
    with next(short.bag.glob('*.mcap')).open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages(topics):
            stamp = message.header.stamp
            stamps.setdefault(channel.topic, []).append(stamp.sec * 10**9 + stamp.nanosec)
    expected = [50_000_000 * n for n in range(1, STEPS + 2)]
    assert stamps == dict.fromkeys(topics, expected)


def test_type_hashes_are_the_official_ones(short: Lap) -> None:
    """They are those of the official definitions, for each message that is not ours."""
    listed = short.listed_topics()
    hashes = {name: listed[name]['topic_metadata']['type_description_hash'] for name in HASHES}
    assert hashes == HASHES


def test_transports_and_repetitions_give_the_same_trajectory(short: Lap, tmp_path: Path) -> None:
    """To the last bit: their files are equal."""
    again = drive_short(tmp_path / 'again', '--transport', 'ros')
    within = drive_short(tmp_path / 'within', '--transport', 'inprocess')
    trajectories = [(lap.folder / 'trajectory.csv').read_bytes() for lap in (short, again, within)]
    assert trajectories[0].count(b'\n') == STEPS + 2
    assert trajectories[0] == trajectories[1]
    assert trajectories[0] == trajectories[2]


def test_its_bag_replayed_agrees_exactly(
    short: Lap, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The bag says what drove; the same metrics come of it."""
    assert run(['replay', str(short.bag), '--json', '--out', str(tmp_path / 'replay')]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result['agreement'], result['answers']) == (1.0, STEPS + 1)
    assert (result['controller'], result['seed'], result['notes']) == ('braitenberg', 3, [])
    (episode,) = result['episodes']
    assert {name: short.result[name] for name in episode if name != 'episode'} == {
        name: value for name, value in episode.items() if name != 'episode'
    }
    assert result['mean_abs_distance_m'] == short.result['mean_abs_distance_m']


def test_its_tables_are_those_of_the_lap_driven_from_python(short: Lap) -> None:
    """Events and spikes from the bag, too."""
    recorded = spikelane.load_run(short.folder)
    limit = {'simulator.episode.max_steps': STEPS}
    driven = spikelane.drive('braitenberg', seed=3, engine='kinematic', parameters=limit)
    for table in ('trajectory', 'events', 'spikes'):
        pd.testing.assert_frame_equal(getattr(recorded, table), getattr(driven, table))
    assert len(recorded.events) == short.result['events'] > 0
    assert len(recorded.spikes) == 2 * (STEPS + 1)


def test_learnt_weights_and_parameters_are_in_the_bag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """So that the bag alone is enough to replay it."""
    options = ('--controller', 'rstdp', '--scenario', '2', '--lane', 'inner')
    lap = drive_short(tmp_path / 'lap', *options, '--param', 'rstdp.steering.v_max=1.3')
    assert run(['replay', str(lap.bag), '--json', '--out', str(tmp_path / 'replay')]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result['agreement'], result['answers']) == (1.0, STEPS + 1)


def test_learnt_weights_are_recorded(tmp_path: Path) -> None:
    """Once at least, as they do not change while a lap is driven."""
    learnt = drive_short(tmp_path / 'learnt', '--transport', 'ros', '--controller', 'rstdp')
    assert learnt.listed_topics()['/controller/weights']['message_count'] >= 1


def test_a_recording_and_the_bag_hold_the_same_numbers(tmp_path: Path) -> None:
    """As in process; the bag's are read with another reader."""
    options = ('--controller', 'rstdp', '--record', 'all')
    over_ros, within = (
        drive_short(tmp_path / each, *options, '--transport', each)
        for each in ('ros', 'inprocess')
    )
    assert over_ros.errors == ''
    datasets = [xr.load_dataset(lap.folder / 'recording.nc') for lap in (over_ros, within)]
    assert datasets[0].identical(datasets[1])
    assert datasets[0]['weights'].shape == (STEPS + 1, 2, 32)
    assert float(np.abs(datasets[0]['traces'].diff('step')).max()) > 0
    with (over_ros.bag / 'bag_0.mcap').open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        steps = [each[3] for each in reader.iter_decoded_messages(['/controller/recorded'])]
    assert len(steps) == STEPS + 1
    quantities = [{each.name: each for each in step.quantities} for step in steps]
    for name, values in (('weights', 64), ('traces', 64), ('potentials', 100), ('dopamine', 2)):
        data = np.array([each[name].data for each in quantities])
        assert np.array_equal(data.ravel(), datasets[0][name].values.ravel())
        assert data.shape == (STEPS + 1, values)
    sources = [index for each in quantities for index in each['spikes'].sources]
    assert sources == datasets[0]['spikes_neuron'].values.tolist()
    assert len(sources) > 100
    assert quantities[0]['weights'].unit == 'pA'
    assert list(quantities[0]['weights'].axes) == ['neuron', 'input']


def test_another_seed_gives_another_trajectory(short: Lap, tmp_path: Path) -> None:
    """Else the comparison above would mean nothing."""
    other = drive_short(tmp_path / 'other', '--transport', 'inprocess', '--seed', '4')
    assert (other.folder / 'trajectory.csv').read_bytes() != (
        short.folder / 'trajectory.csv'
    ).read_bytes()


@pytest.mark.slow
def test_a_whole_lap_over_ros_is_the_lap_driven_in_process(
    tmp_path: Path, every_step: tuple[str, ...]
) -> None:
    """Scenario 1, outer lane: completed, exit status 0, nothing lost in 4,700 steps."""
    over_ros, within = (
        drive(tmp_path / transport, '--seed', '1', '--transport', transport)
        for transport in ('ros', 'inprocess')
    )
    assert (over_ros.status, within.status) == (0, 0), over_ros.errors
    assert (over_ros.folder / 'trajectory.csv').read_bytes() == (
        within.folder / 'trajectory.csv'
    ).read_bytes()
    result = over_ros.result
    assert result['completed'] is True
    assert 4400 < result['steps'] < 5000
    assert result['lap_time_s'] == pytest.approx(result['steps'] * 0.05)
    assert result['mean_abs_distance_m'] < 0.08
    # Operations are counted in one process alone.
    differing = {'transport', 'steps_per_s', 'folder', 'bag', 'figure', 'operations'}
    assert {k: v for k, v in result.items() if k not in differing} == {
        k: v for k, v in within.result.items() if k not in differing
    }
    with AnyReader([over_ros.bag]) as reader:
        counts = {each.topic: each.msgcount for each in reader.connections}
    assert {counts[topic] for topic in every_step} == {result['steps'] + 1}


def test_the_dqn_snn_drives_the_same_over_ros(tmp_path: Path) -> None:
    """With its shipped network: every spike it draws is the same, so is the trajectory."""
    over_ros, within = (
        drive_short(tmp_path / each, '--controller', 'dqn_snn', '--transport', each)
        for each in ('ros', 'inprocess')
    )
    assert over_ros.errors == ''
    trajectories = [(lap.folder / 'trajectory.csv').read_bytes() for lap in (over_ros, within)]
    assert trajectories[0].count(b'\n') == STEPS + 2
    assert trajectories[0] == trajectories[1]
    with AnyReader([over_ros.bag]) as reader:
        (connection,) = (c for c in reader.connections if c.topic == '/controller/state')
        states = [
            reader.deserialize(raw, connection.msgtype)
            for _, _, raw in reader.messages([connection])
        ]
    assert states[0].neurons == ['left', 'straight', 'right']
    assert {each.action for each in states} <= {0, 1, 2}
    assert sum(int(each.spikes.sum()) for each in states) > 0


@pytest.mark.parametrize(
    ('model', 'controller', 'engine', 'place'),
    [
        ('turtlebot4', 'braitenberg', 'kinematic', (0.164, 0.0, 0.2558)),
        ('turtlebot4', 'rstdp', 'rigid', (0.164, 0.0, 0.2558)),
        (str(OWN), 'braitenberg', 'pybullet', (0.05, 0.0, 0.2458)),
    ],
)
def test_another_robot_drives_as_in_process_and_is_described(
    tmp_path: Path, model: str, controller: str, engine: str, place: tuple[float, ...]
) -> None:
    """The same bits; its URDF and the place of its camera are on the topics."""
    robot = ('--robot', model, '--engine', engine, '--controller', controller)
    over_ros = drive_short(tmp_path / 'ros', *robot)
    in_process = drive_short(tmp_path / 'inprocess', *robot, '--transport', 'inprocess')
    assert (over_ros.status, over_ros.result['robot']) == (1, model), over_ros.errors
    assert over_ros.result['steps'] == STEPS
    trajectories = [each.folder / 'trajectory.csv' for each in (over_ros, in_process)]
    assert trajectories[0].read_bytes() == trajectories[1].read_bytes()
    said = {}
    with AnyReader([over_ros.bag]) as reader:
        for connection, _, raw in reader.messages():
            said[connection.topic] = reader.deserialize(raw, connection.msgtype)
    assert f'<robot name="{Path(model).stem}">' in said['/robot_description'].data
    camera = said['/tf_static'].transforms[0].transform.translation
    assert (camera.x, camera.y, camera.z) == place


def test_filters_act_alike_in_all_transports_and_in_a_replay(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a lap with noise: the same file to the last bit, and the bag says what filtered it."""
    filters = ('correlation', 'refractory')
    given = [
        'simulator.pixels.coppelia.noise_rate_hz=3.0',
        f'filter.chain={",".join(filters)}',
        'filter.correlation.window_s=0.05',
        'filter.refractory.period_s=0.04',
    ]
    options = [each for one in given for each in ('--param', one)]
    over = drive_short(tmp_path / 'over', '--transport', 'ros', *options)
    within = drive_short(tmp_path / 'within', '--transport', 'inprocess', *options)
    bare = drive_short(tmp_path / 'bare', '--transport', 'inprocess', *options[:2])
    files = [(lap.folder / 'trajectory.csv').read_bytes() for lap in (over, within, bare)]
    assert files[0].count(b'\n') == STEPS + 2
    assert files[0] == files[1]
    assert files[0] != files[2]
    assert run(['replay', str(over.bag), '--json', '--out', str(tmp_path / 'replay')]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result['agreement'], result['answers']) == (1.0, STEPS + 1)
    assert result['events']['passed'] < result['events']['on'] + result['events']['off']
    config = yaml.safe_load((over.folder / 'config.yaml').read_text())
    assert config['filter']['chain'] == 'correlation,refractory'
    unfiltered = yaml.safe_load((bare.folder / 'config.yaml').read_text())
    assert 'filter' not in unfiltered
