"""What a lap leaves, gathered in a loop, from a file and from a bag."""

from collections.abc import Iterator, Sequence
import math
from pathlib import Path
import time
import tracemalloc
from typing import Any

from mcap.writer import Writer
import numpy as np
import pytest
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
import yaml

from spikelane.runs.lap.step_messages import LaneStates, StepMessages
from spikelane.runs.lap.trajectory import (
    COLUMNS,
    read_csv,
    Trajectory,
    TrajectoryError,
    TrajectoryRecorder,
    write_csv,
)
from spikelane.runs.lap.trajectory_bag import EVENTS, LANE_STATE, ODOMETRY, read_trajectory, WHEELS
from spikelane_sim.contract import LaneState, Observation, RobotState, WheelVelocities
from spikelane_sim.errors import BagError
from spikelane_sim.events import make_events

MSGS = Path(__file__).parents[5] / 'msgs'
STEP_NS = 50_000_000

Row = tuple[Observation, RobotState, WheelVelocities | None]


def lane_state(step: int, episode: int = 1, reason: str = '') -> LaneState:
    """Return a lane state whose numbers have no short decimal form."""
    return LaneState(
        lane='outer',
        distance_m=0.1 * step - 0.2,
        heading_error_rad=-0.3 * step,
        position_m=0.5 + step / 3,
        section='A' if step < 2 else 'B',
        progress_m=step / 3,
        laps=step // 3,
        episode=episode,
        step=step,
        terminated=bool(reason),
        reason=reason,
    )


def row(step: int, stamp_ns: int, episode: int = 1, last: bool = False) -> Row:
    """Return one step: `step` events, heading 0.1 rad times the step, no command on the last."""
    half = 0.05 * step
    robot = RobotState(
        position=(3.0 + step / 7, 0.25, 0.138),
        orientation=(0.0, 0.0, math.sin(half), math.cos(half)),
        linear=(0.0, 0.0, 0.0),
        angular=(0.0, 0.0, 0.0),
        wheel_angles=(0.0, 0.0),
        wheel_velocities=(0.0, 0.0),
    )
    events = make_events([stamp_ns] * step, range(step), 5, 1)
    lane = lane_state(step, episode, 'laps_complete' if last else '')
    wheels = None if last else WheelVelocities(1.0 + step / 9, 1.0 - step / 9)
    return Observation(stamp_ns, events, lane), robot, wheels


def episode_rows(episode: int = 1, first_stamp_ns: int = STEP_NS) -> list[Row]:
    """Return four steps, the lap completed by the last."""
    return [
        row(step, first_stamp_ns + step * STEP_NS, episode, last=step == 3) for step in range(4)
    ]


def recorded(rows: list[Row]) -> Trajectory:
    """Return what a loop gathers of these rows."""
    recorder = TrajectoryRecorder()
    for observation, robot, wheels in rows:
        recorder.append(observation, robot, wheels)
    return recorder.trajectory()


def test_a_loop_gathers_its_rows() -> None:
    """Each column holds what was appended; a missing command is NaN."""
    trajectory = recorded(episode_rows())
    assert (trajectory.lane, trajectory.reason, len(trajectory)) == ('outer', 'laps_complete', 4)
    assert trajectory.stamp_ns.tolist() == [50_000_000, 100_000_000, 150_000_000, 200_000_000]
    assert trajectory.step.tolist() == [0, 1, 2, 3]
    assert trajectory.distance_m.tolist() == [-0.2, 0.1 - 0.2, 0.0, 0.1 * 3 - 0.2]
    assert trajectory.heading_error_rad.tolist() == [0.0, -0.3, -0.6, -0.3 * 3]
    assert trajectory.section.tolist() == ['A', 'A', 'B', 'B']
    assert trajectory.laps.tolist() == [0, 0, 0, 1]
    assert trajectory.x_m.tolist() == [3.0, 3 + 1 / 7, 3 + 2 / 7, 3 + 3 / 7]
    assert trajectory.y_m.tolist() == [0.25] * 4
    assert trajectory.heading_rad == pytest.approx([0.0, 0.1, 0.2, 0.3], abs=1e-15)
    assert trajectory.left_rad_s[:3].tolist() == [1.0, 1 + 1 / 9, 1 + 2 / 9]
    assert np.isnan(trajectory.left_rad_s[3])
    assert np.isnan(trajectory.right_rad_s[3])
    assert trajectory.events.tolist() == [0, 1, 2, 3]


def test_a_heading_of_a_tilted_body_is_where_it_points_on_the_ground() -> None:
    """Turned left by 90 degrees, then pitched down by 30 about its own axis."""
    observation, robot, wheels = row(0, STEP_NS)
    yaw, pitch = math.radians(45), math.radians(15)  # half the angles
    orientation = (
        -math.sin(yaw) * math.sin(pitch),
        math.cos(yaw) * math.sin(pitch),
        math.sin(yaw) * math.cos(pitch),
        math.cos(yaw) * math.cos(pitch),
    )
    trajectory = recorded([(observation, robot._replace(orientation=orientation), wheels)])
    assert trajectory.heading_rad == pytest.approx([math.pi / 2], abs=1e-12)


def test_appending_is_cheap() -> None:
    """At 8,000 steps a second, 3 us of 125; the best of ten rounds, as others use the machine."""
    observation, robot, wheels = row(1, STEP_NS)
    best_s = math.inf
    for _ in range(10):
        recorder = TrajectoryRecorder()
        begin_s = time.perf_counter()
        for _ in range(1000):
            recorder.append(observation, robot, wheels)
        best_s = min(best_s, (time.perf_counter() - begin_s) / 1000)
    assert best_s < 3e-6


def test_an_observation_of_a_real_camera_makes_no_trajectory() -> None:
    """It does not know where it is."""
    observation, robot, wheels = row(0, STEP_NS)
    with pytest.raises(TrajectoryError, match='expected a lane state'):
        TrajectoryRecorder().append(observation._replace(lane=None), robot, wheels)


def test_no_observation_makes_no_trajectory() -> None:
    """It has no lane."""
    with pytest.raises(TrajectoryError, match='at least one observation'):
        TrajectoryRecorder().trajectory()


def test_two_episodes_make_no_trajectory() -> None:
    """A recorder is for one."""
    with pytest.raises(TrajectoryError, match='expected one episode'):
        recorded(episode_rows(1) + episode_rows(2, 9 * STEP_NS))


def test_columns_of_different_lengths_are_refused() -> None:
    """The message has the lengths."""
    trajectory = recorded(episode_rows())
    columns: dict[str, Any] = {**trajectory.columns(), 'laps': trajectory.laps[:2]}
    with pytest.raises(TrajectoryError, match=r"expected columns of one length.*'laps': 2"):
        Trajectory(lane='outer', reason='', **columns)


def test_equality_is_to_the_last_bit() -> None:
    """Missing commands are equal to each other, a number one bit off is not."""
    one, other = recorded(episode_rows()), recorded(episode_rows())
    assert one.equals(other)
    other.distance_m[2] = np.nextafter(other.distance_m[2], 1)
    assert not one.equals(other)
    assert not one.equals(recorded(episode_rows()[:3]))


def test_csv_reads_back_to_the_last_bit(tmp_path: Path) -> None:
    """Whatever the floats are."""
    rng = np.random.default_rng(1)
    trajectory = recorded(episode_rows())
    trajectory.distance_m[:] = rng.standard_normal(4) * 10.0 ** rng.integers(-300, 300, 4)
    trajectory.y_m[0] = -0.0
    write_csv(trajectory, tmp_path / 'trajectory.csv')
    back = read_csv(tmp_path / 'trajectory.csv')
    assert back.equals(trajectory)
    assert math.copysign(1, back.y_m[0]) == -1


def test_csv_is_one_line_per_observation(tmp_path: Path) -> None:
    """A header, then what a spreadsheet can open."""
    write_csv(recorded(episode_rows()[:2]), tmp_path / 'trajectory.csv')
    lines = (tmp_path / 'trajectory.csv').read_text().splitlines()
    assert lines[0] == (
        'lane,stamp_ns,step,distance_m,heading_error_rad,position_m,progress_m,section,laps,'
        'x_m,y_m,heading_rad,left_rad_s,right_rad_s,events,reason'
    )
    assert lines[1] == 'outer,50000000,0,-0.2,-0.0,0.5,0.0,A,0,3.0,0.25,0.0,1.0,1.0,0,'
    assert len(lines) == 3


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('distance_m,', 'distance,', 'expected the columns lane, stamp_ns'),
        ('-0.2', 'left', r":2: distance_m: expected a number, got 'left'"),
        ('outer,100000000,', 'outer,', ':3: expected 16 values, got 15'),
    ],
)
def test_a_csv_of_another_kind_is_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    """The message has the line and what is wrong."""
    path = tmp_path / 'trajectory.csv'
    write_csv(recorded(episode_rows()[:2]), path)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(TrajectoryError, match=message):
        read_csv(path)


def test_a_csv_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    """So is one without a row."""
    with pytest.raises(TrajectoryError, match='cannot be read'):
        read_csv(tmp_path / 'trajectory.csv')
    (tmp_path / 'trajectory.csv').write_text(','.join(['lane', *COLUMNS, 'reason']) + '\n')
    with pytest.raises(TrajectoryError, match='expected at least one observation'):
        read_csv(tmp_path / 'trajectory.csv')


def said_of(rows: list[Row]) -> tuple[list[tuple[int, LaneState]], dict[str, dict[int, Any]]]:
    """Return lane states with stamps, and the values of the other messages by kind and stamp."""
    return [(o.stamp_ns, o.lane) for o, _, _ in rows if o.lane], {
        'pose': {o.stamp_ns: (*robot.position[:2], *robot.orientation) for o, robot, _ in rows},
        'wheels': {o.stamp_ns: wheels for o, _, wheels in rows if wheels},
        'events': {o.stamp_ns: (len(o.events),) for o, _, _ in rows},
    }


def put_together(
    states: list[tuple[int, LaneState]], values: dict[str, dict[int, Any]]
) -> Trajectory:
    """Put the messages together, recorded at the time of their stamps."""
    lane_states = LaneStates()
    for stamp_ns, state in states:
        lane_states.add(stamp_ns, stamp_ns, state)
    steps = StepMessages(lane_states)
    for kind, of in values.items():
        for stamp_ns, value in of.items():
            steps.add(kind, stamp_ns, stamp_ns, lambda value=value: value)
    return steps.trajectory()


def test_messages_are_put_together_by_stamp() -> None:
    """The trajectory is the one that a loop gathers."""
    rows = episode_rows()
    assert put_together(*said_of(rows)).equals(recorded(rows))


def test_incomplete_steps_at_the_ends_are_cut() -> None:
    """A recorder started late and was killed: the reason is not known any more."""
    states, values = said_of(episode_rows())
    del values['events'][1 * STEP_NS], values['pose'][4 * STEP_NS]
    trajectory = put_together(states, values)
    assert trajectory.step.tolist() == [1, 2]
    assert trajectory.reason == ''


@pytest.mark.parametrize('what', ['pose', 'events'])
def test_a_message_lost_between_others_is_an_error(what: str) -> None:
    """Metrics over a lap with holes would be of another lap."""
    states, values = said_of(episode_rows())
    del values[what][3 * STEP_NS]
    with pytest.raises(TrajectoryError, match=rf'{what} of step 2 \(150000000 ns\) is lost'):
        put_together(states, values)


def test_messages_that_share_no_stamp_are_an_error() -> None:
    """There is no observation to keep."""
    states, values = said_of(episode_rows())
    with pytest.raises(TrajectoryError, match='of 4 lane states, got none'):
        put_together(states, values | {'pose': {}})


def test_a_long_drive_takes_little_memory() -> None:
    """200 bytes a step at most, half of which are the trajectory's own numbers."""
    observation, robot, wheels = row(1, STEP_NS)
    recorder = TrajectoryRecorder()
    recorder.append(observation, robot, wheels)
    tracemalloc.start()
    for stamp_ns in range(20_000):
        recorder.append(observation._replace(stamp_ns=stamp_ns), robot, wheels)
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # The last rows are not packed yet.
    assert kept < 20_000 * 200 + 4096 * 1000


# --- bags -----------------------------------------------------------------------------------


def typestore() -> Any:
    """Return Jazzy's types and ours, from the texts in msgs."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for package, name in (
        ('spikelane_msgs', 'LaneState'),
        ('spikelane_msgs', 'WheelVelocities'),
        ('event_camera_msgs', 'EventPacket'),
    ):
        text = (MSGS / package / 'msg' / f'{name}.msg').read_text()
        store.register(get_types_from_msg(text, f'{package}/msg/{name}'))
    return store


STORE = typestore()
TYPES = {
    LANE_STATE: 'spikelane_msgs/msg/LaneState',
    ODOMETRY: 'nav_msgs/msg/Odometry',
    WHEELS: 'spikelane_msgs/msg/WheelVelocities',
    EVENTS: 'event_camera_msgs/msg/EventPacket',
}


def header(stamp_ns: int) -> Any:
    """Return a header of this stamp."""
    stamp = STORE.types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 1_000_000_000))
    return STORE.types['std_msgs/msg/Header'](stamp, 'world')


def lane_message(stamp_ns: int, lane: LaneState) -> Any:
    """Return the message of a lane state."""
    return STORE.types[TYPES[LANE_STATE]](
        header=header(stamp_ns),
        lane=lane.lane,
        distance=lane.distance_m,
        heading_error=lane.heading_error_rad,
        position=lane.position_m,
        section=lane.section,
        progress=lane.progress_m,
        laps=lane.laps,
        episode=lane.episode,
        step=lane.step,
        terminated=lane.terminated,
        reason=lane.reason,
    )


def odometry_message(stamp_ns: int, robot: RobotState) -> Any:
    """Return the message of a pose, at rest."""
    types = STORE.types
    vector = types['geometry_msgs/msg/Vector3'](0.0, 0.0, 0.0)
    pose = types['geometry_msgs/msg/Pose'](
        types['geometry_msgs/msg/Point'](*robot.position),
        types['geometry_msgs/msg/Quaternion'](*robot.orientation),
    )
    twist = types['geometry_msgs/msg/Twist'](vector, vector)
    return types[TYPES[ODOMETRY]](
        header(stamp_ns),
        'base_link',
        types['geometry_msgs/msg/PoseWithCovariance'](pose, np.zeros(36)),
        types['geometry_msgs/msg/TwistWithCovariance'](twist, np.zeros(36)),
    )


def packet_message(stamp_ns: int, count: int) -> Any:
    """Return a packet of so many ON events in mono: dt, x, y and polarity in 64 bits each."""
    words = [x << 32 | 5 << 48 | 1 << 63 for x in range(count)]
    content = np.array(words, '<u8').view(np.uint8)
    return STORE.types[TYPES[EVENTS]](
        header(stamp_ns), 128, 128, 0, stamp_ns, 'mono', False, content
    )


def messages(rows: list[Row]) -> Iterator[tuple[str, Any]]:
    """Yield what the graph says in these steps."""
    for observation, robot, wheels in rows:
        stamp_ns = observation.stamp_ns
        assert observation.lane is not None
        yield EVENTS, packet_message(stamp_ns, len(observation.events))
        yield ODOMETRY, odometry_message(stamp_ns, robot)
        yield LANE_STATE, lane_message(stamp_ns, observation.lane)
        if wheels is not None:
            yield WHEELS, STORE.types[TYPES[WHEELS]](header(stamp_ns), wheels.left, wheels.right)


def schema(kind: str) -> str:
    """Return a type's text as rosbag2 stores it: the file's, then those of what it uses."""
    package, _, name = kind.split('/')
    file = MSGS / package / 'msg' / f'{name}.msg'
    if not file.exists():
        text: str = STORE.generate_msgdef(kind, ros_version=2)[0]
        return text
    used: str = STORE.generate_msgdef('std_msgs/msg/Header', ros_version=2)[0]
    return f'{file.read_text()}\n{"=" * 80}\nMSG: std_msgs/Header\n{used}'


def metadata(path: Path, topics: Sequence[str], count: int) -> dict[str, Any]:
    """Return what rosbag2 writes next to the recording."""
    known = {
        topic: {
            'name': topic,
            'type': TYPES[topic],
            'serialization_format': 'cdr',
            'offered_qos_profiles': [],
            'type_description_hash': '',
        }
        for topic in topics
    }
    start = {'nanoseconds_since_epoch': 10**18}
    file = {'path': path.name, 'starting_time': start, 'duration': {'nanoseconds': count * 1000}}
    return {
        'version': 9,
        'storage_identifier': 'mcap',
        'duration': file['duration'],
        'starting_time': start,
        'message_count': count,
        'topics_with_message_count': [
            {'topic_metadata': known[topic], 'message_count': 1} for topic in topics
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [path.name],
        'files': [{**file, 'message_count': count}],
        'custom_data': None,
        'ros_distro': 'jazzy',
    }


def write_bag(path: Path, rows: list[Row], without: str = '') -> Path:
    """Write a bag of these steps, a microsecond of wall time between messages."""
    path.mkdir()
    topics = [topic for topic in TYPES if topic != without]
    said = [(topic, message) for topic, message in messages(rows) if topic != without]
    with (path / f'{path.name}_0.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start(profile='ros2', library='test')
        channels = {
            topic: writer.register_channel(
                topic,
                'cdr',
                writer.register_schema(TYPES[topic], 'ros2msg', schema(TYPES[topic]).encode()),
                {'offered_qos_profiles': '[]'},
            )
            for topic in topics
        }
        for number, (topic, message) in enumerate(said):
            log_ns = 10**18 + number * 1000
            data = bytes(STORE.serialize_cdr(message, TYPES[topic]))
            writer.add_message(channels[topic], log_ns, data, log_ns)
        writer.finish()
    information = metadata(path / f'{path.name}_0.mcap', topics, len(said))
    text = yaml.safe_dump({'rosbag2_bagfile_information': information}, sort_keys=False)
    (path / 'metadata.yaml').write_text(text)
    return path


def test_a_bag_gives_the_trajectory_of_the_loop(tmp_path: Path) -> None:
    """Bit for bit."""
    rows = episode_rows()
    assert read_trajectory(write_bag(tmp_path / 'bag', rows)).equals(recorded(rows))


def test_one_of_several_episodes_can_be_chosen(tmp_path: Path) -> None:
    """Each is cut out by the number in its lane states."""
    first, second = episode_rows(1), episode_rows(2, 9 * STEP_NS)
    bag = write_bag(tmp_path / 'bag', first + second)
    assert read_trajectory(bag, episode=1).equals(recorded(first))
    assert read_trajectory(bag, episode=2).equals(recorded(second))


def test_stamps_may_come_again_after_a_reset_of_time(tmp_path: Path) -> None:
    """The messages recorded next to the lane state are meant."""
    first, second = episode_rows(1), episode_rows(2)
    second = [(o, r._replace(position=(1.0, 2.0, 0.1)), w) for o, r, w in second]
    bag = write_bag(tmp_path / 'bag', first + second)
    assert read_trajectory(bag, episode=1).equals(recorded(first))
    assert read_trajectory(bag, episode=2).equals(recorded(second))


@pytest.mark.parametrize('again', [0, 1, 2])
def test_an_observation_that_was_sent_again_counts_once(tmp_path: Path, again: int) -> None:
    """A subscriber that joins late is sent the observation that still waits for its answer."""
    rows = episode_rows()
    bag = write_bag(tmp_path / 'bag', [*rows[: again + 1], *rows[again:]])
    assert read_trajectory(bag).equals(recorded(rows))


def test_an_episode_that_was_reset_and_not_driven_is_passed_over(tmp_path: Path) -> None:
    """A simulator resets itself as it starts; the reset of the lap has the same number."""
    rows = episode_rows(1, 2 * STEP_NS)
    bag = write_bag(tmp_path / 'bag', [row(0, STEP_NS), *rows])
    assert read_trajectory(bag).equals(recorded(rows))
    assert read_trajectory(bag, episode=1).equals(recorded(rows))


def test_several_episodes_want_a_choice(tmp_path: Path) -> None:
    """The message has those there are."""
    bag = write_bag(tmp_path / 'bag', episode_rows(1) + episode_rows(2, 9 * STEP_NS))
    with pytest.raises(BagError, match='expected one episode, got 1, 2'):
        read_trajectory(bag)
    with pytest.raises(BagError, match='expected episode 3, got 1, 2'):
        read_trajectory(bag, episode=3)


@pytest.mark.parametrize('topic', [LANE_STATE, ODOMETRY, WHEELS, EVENTS])
def test_a_missing_topic_is_named(tmp_path: Path, topic: str) -> None:
    """A bag of some topics only cannot tell how the robot drove."""
    bag = write_bag(tmp_path / 'bag', episode_rows(), without=topic)
    with pytest.raises(BagError, match=f'{topic}.* missing'):
        read_trajectory(bag)


def test_a_bag_that_is_none_is_one_sentence(tmp_path: Path) -> None:
    """It is not there, or its file ends in the middle."""
    with pytest.raises(BagError, match='cannot be read'):
        read_trajectory(tmp_path / 'bag')
    bag = write_bag(tmp_path / 'bag', episode_rows())
    mcap = next(bag.glob('*.mcap'))
    mcap.write_bytes(mcap.read_bytes()[:-100])
    with pytest.raises(BagError, match='cannot be read'):
        read_trajectory(bag)
