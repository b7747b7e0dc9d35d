"""Node `recorder`: real processes, stopped, killed and starved."""

from collections import Counter
from collections.abc import Callable, Iterator
import contextlib
import itertools
import os
from pathlib import Path
import random
import re
import resource
import signal
import struct
import subprocess
import sys
import time

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import KeyValue
from domain_coordinator import domain_id
from mcap.reader import make_reader
import pytest
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock
from spikelane_msgs.msg import RecorderState
from std_msgs.msg import Float64, String, UInt8MultiArray

from spikelane.bag.reader import BagReader
from spikelane.bag.repair import repair_bag
from spikelane_benches.recorder import measure_recorder
from spikelane_sim.errors import BagError

pytestmark = pytest.mark.ros

# Kept for as long as the tests run: nobody else who asks for one gets it.
_RESERVATION = contextlib.ExitStack()
DOMAIN = int(_RESERVATION.enter_context(domain_id()))
DEADLINE_S = 30.0
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Graph:
    """A node that publishes, and the recorder process that it is to be recorded by."""

    def __init__(self, folder: Path) -> None:
        self.bag = folder / 'bag'
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = rclpy.create_node('publisher', context=self.context)
        self.processes: list[subprocess.Popen[str]] = []

    def publisher(self, message_type: type, topic: str, qos: QoSProfile | int = 10):
        """Offer a topic."""
        return self.node.create_publisher(message_type, topic, qos)

    def record(
        self,
        parameters: dict[str, str] | None = None,
        file_limit: int | None = None,
        parameter_file: Path | None = None,
        **variables: str,
    ) -> subprocess.Popen[str]:
        """Start a recorder, with environment variables and a bound on its files' size [bytes]."""
        command = [sys.executable, '-m', 'spikelane.nodes.recorder', '--ros-args']
        if parameter_file is not None:
            command += ['--params-file', str(parameter_file)]
        for name, value in {
            'output': str(self.bag),
            'flush_period_s': '0.05',
            **(parameters or {}),
        }.items():
            command += ['-p', f'{name}:={value}']

        def limit() -> None:
            if file_limit is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (file_limit, file_limit))

        environment = {
            **os.environ,
            'ROS_DOMAIN_ID': str(DOMAIN),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            **variables,
        }
        process = subprocess.Popen(
            command,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=limit,
        )
        self.processes.append(process)
        return process

    def close(self) -> None:
        """End what a failed test has left."""
        for process in self.processes:
            if process.poll() is None:
                process.kill()
            process.communicate()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Graph]:
    """Give a graph in a domain of its own."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    graph = Graph(tmp_path)
    yield graph
    graph.close()


def wait_until(condition: Callable[[], object]) -> None:
    """Wait for a condition, at most until the deadline."""
    deadline = time.monotonic() + DEADLINE_S
    while not _holds(condition):
        assert time.monotonic() < deadline, 'the deadline has passed'
        time.sleep(0.01)


def _holds(condition: Callable[[], object]) -> bool:
    try:
        return bool(condition())
    except BagError:  # the bag is not there yet
        return False


def count_in(bag: Path, topic: str) -> int:
    """Return how many messages of a topic the bag has by now."""
    return sum(1 for _ in BagReader(bag).messages([topic]))


def publish(graph: Graph, publisher, values: range) -> None:
    """Publish numbers once the recorder has subscribed, and wait until they are in the bag.

    No faster than a queue of 10 bears. Waiting for acknowledgements instead would take 3 s, the
    middleware's heartbeat.
    """
    wait_until(publisher.get_subscription_count)
    for value in values:
        publisher.publish(Float64(data=float(value)))
        time.sleep(0.001)
    wait_until(lambda: count_in(graph.bag, publisher.topic_name) == len(values))


def stop(process: subprocess.Popen[str], number: int = signal.SIGINT) -> tuple[int, str]:
    """Send a signal; return exit status and what was printed."""
    process.send_signal(number)
    _, errors = process.communicate(timeout=DEADLINE_S)
    return process.returncode, errors


def decoded(bag: Path, topic: str) -> list[object]:
    """Return the contents of a topic as rosbags decodes them, its hash checked."""
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.topic == topic]
        return [
            reader.deserialize(raw, connection.msgtype).data
            for connection, _, raw in reader.messages(connections)
        ]


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_finishes_the_bag(graph: Graph, number: int) -> None:
    """Exit status 0, nothing lost, no traceback, and rosbags opens it."""
    publisher = graph.publisher(Float64, 'lane/distance')
    process = graph.record({'custom_data': '["seed=7"]'})
    before_ns = time.time_ns()
    publish(graph, publisher, range(50))
    status, errors = stop(process, number)
    assert status == 0
    assert 'Traceback' not in errors
    assert 'topics; new: /lane/distance' in errors
    assert f'to {graph.bag}, 0 lost' in errors
    assert decoded(graph.bag, '/lane/distance') == list(range(50))
    reader = BagReader(graph.bag)
    times = [(m.publish_time_ns, m.log_time_ns) for m in reader.messages(['/lane/distance'])]
    assert all(before_ns < sent <= got < time.time_ns() for sent, got in times)
    assert reader.damage == []
    assert reader.custom_data == {'seed': '7'}
    assert reader.topics['/lane/distance'].schema_text.endswith('float64 data\n')


@pytest.mark.parametrize(('number', 'status'), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_to_a_recorder_that_is_waited_for_is_told(
    graph: Graph, number: int, status: int
) -> None:
    """The drive of who waits is cut short; the bag is closed as ever."""
    publisher = graph.publisher(Float64, 'x')
    waiting = graph.node.create_subscription(
        RecorderState, 'recorder/state', lambda state: None, LATCHED
    )
    process = graph.record()
    publish(graph, publisher, range(5))
    wait_until(lambda: graph.node.count_publishers(waiting.topic_name))
    ended, errors = stop(process, number)
    assert ended == status
    name = signal.Signals(number).name
    assert f'ended by {name} while other nodes wait for what is recorded' in errors
    assert decoded(graph.bag, '/x') == list(range(5))


@pytest.mark.parametrize(
    ('reliability', 'status'),
    [(ReliabilityPolicy.RELIABLE, 1), (ReliabilityPolicy.BEST_EFFORT, 0)],
)
def test_lost_messages_are_counted_by_topic(
    graph: Graph, reliability: ReliabilityPolicy, status: int
) -> None:
    """Also of topics with several publishers; an error where they were sent reliably."""
    qos = QoSProfile(depth=1, reliability=reliability)
    alone, *both = (graph.publisher(Float64, name, qos) for name in ('alone', 'both', 'both'))
    publishers = (alone, *both)
    process = graph.record()
    wait_until(lambda: all(each.get_subscription_count() for each in publishers))
    numbers = itertools.count()

    def publish_spaced(rounds: int) -> None:
        """A publisher's message says its number, and by its fraction which publisher it is."""
        for number in itertools.islice(numbers, rounds):
            for fraction, publisher in enumerate(publishers):
                publisher.publish(Float64(data=number + fraction / 4))
            time.sleep(0.02)

    # A publisher may know the recorder before the recorder knows the publisher. What was sent in
    # between is not lost: the count begins with the first message that was recorded.
    publish_spaced(50)
    os.kill(process.pid, signal.SIGSTOP)
    for number in itertools.islice(numbers, 5000):
        for fraction, publisher in enumerate(publishers):
            publisher.publish(Float64(data=number + fraction / 4))
    process.send_signal(signal.SIGCONT)
    # What comes next shows what is missing: several rounds, as a full socket may drop the first.
    publish_spaced(50)
    time.sleep(0.3)
    ended, errors = stop(process)
    found = re.search(r'messages lost: /alone (\d+), /both (\d+)', errors)
    assert found, errors
    recorded = {0.0: [], 0.25: [], 0.5: []}
    for value in (*decoded(graph.bag, '/alone'), *decoded(graph.bag, '/both')):
        recorded[value % 1].append(int(value))
    first = {fraction: min(sent) for fraction, sent in recorded.items()}
    assert max(first.values()) < 50, 'the recorder did not meet the publishers in time'
    missing = {fraction: 5100 - first[fraction] - len(sent) for fraction, sent in recorded.items()}
    assert int(found[1]) == missing[0.0] > 0
    assert int(found[2]) == missing[0.25] + missing[0.5] > 0
    assert ended == status


def test_a_second_publisher_of_a_moment_loses_nothing(graph: Graph) -> None:
    """Each numbers its own messages, also when both have come and gone within a second."""
    first = graph.publisher(Float64, 'x')
    process = graph.record()
    publish(graph, first, range(5))
    second = graph.publisher(Float64, 'x')
    for _ in range(20):  # most of them before the recorder knows of it
        second.publish(Float64(data=-1.0))
    wait_until(second.get_subscription_count)
    for value, publisher in ((5.0, first), (6.0, second)):
        time.sleep(0.1)
        publisher.publish(Float64(data=value))
    last = struct.pack('<d', 6.0)
    wait_until(lambda: any(m.data.endswith(last) for m in BagReader(graph.bag).messages(['/x'])))
    graph.node.destroy_publisher(second)
    status, errors = stop(process)
    assert (status, 'lost:' in errors) == (0, False), errors


def test_a_second_signal_is_harmless(graph: Graph) -> None:
    """An impatient user, or a launcher that signals the group after the process."""
    publisher = graph.publisher(Float64, 'x')
    process = graph.record()
    publish(graph, publisher, range(5))
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGTERM)
    status, errors = stop(process)
    assert status == 0
    assert 'Traceback' not in errors
    assert decoded(graph.bag, '/x') == list(range(5))


def test_a_killed_recorder_leaves_what_was_flushed(graph: Graph) -> None:
    """At least all that came more than a flush period before."""
    publisher = graph.publisher(Float64, 'x')
    process = graph.record()
    publish(graph, publisher, range(20))
    process.kill()
    process.communicate()
    reader = BagReader(graph.bag)
    assert len(list(reader.messages(['/x']))) == 20
    assert reader.metadata is not None
    assert reader.metadata.message_count >= 20
    assert 'was cut or never closed' in reader.damage[0]
    assert sorted(path.name for path in graph.bag.iterdir()) == ['bag_0.mcap', 'metadata.yaml']


@pytest.mark.parametrize('after_s', [0.12, 0.37, 0.71])
def test_a_bag_is_whole_again_after_a_kill_at_any_moment(graph: Graph, after_s: float) -> None:
    """While messages come, also amid a flush; every other program reads what was saved."""
    publisher = graph.publisher(Float64, 'x', QoSProfile(depth=10000))
    process = graph.record({'chunk_bytes': '4096', 'custom_data': '["seed=7"]'})
    publish(graph, publisher, range(1))
    begin, sent = time.monotonic(), 1
    while time.monotonic() - begin < after_s:
        publisher.publish(Float64(data=float(sent)))
        sent += 1
        time.sleep(0.0005)
    process.kill()
    process.communicate()
    repair = repair_bag(graph.bag)
    assert repair.written == ('bag_0.mcap', 'metadata.yaml')
    values = decoded(graph.bag, '/x')
    assert values == list(range(len(values)))
    assert 0 < len(values) <= sent
    with (graph.bag / 'bag_0.mcap').open('rb') as stream:
        assert len(list(make_reader(stream).iter_messages(['/x']))) == len(values)
    again = BagReader(graph.bag)
    assert len(list(again.messages())) == repair.message_count
    assert (again.damage, again.custom_data['seed']) == ([], '7')
    assert 'reliability: reliable' in again.topics['/x'].offered_qos_profiles
    assert again.topics['/x'].type_hash.startswith('RIHS01_')


def test_all_topics_are_recorded_except_hidden_and_excluded_ones(graph: Graph) -> None:
    """Also one whose publisher comes later."""
    first = graph.publisher(Float64, 'first')
    hidden = graph.publisher(Float64, '_hidden')
    excluded = graph.publisher(Float64, 'excluded')
    process = graph.record({'exclude': '["/excluded"]'})
    publish(graph, first, range(3))
    later = graph.publisher(String, 'later')
    wait_until(later.get_subscription_count)
    later.publish(String(data='hello'))
    wait_until(lambda: count_in(graph.bag, '/later'))
    status, _ = stop(process)
    assert status == 0
    assert (hidden.get_subscription_count(), excluded.get_subscription_count()) == (0, 0)
    counts = Counter(message.topic for message in BagReader(graph.bag).messages())
    assert (counts['/first'], counts['/later']) == (3, 1)
    assert not {'/_hidden', '/excluded'} & set(counts)
    assert decoded(graph.bag, '/later') == ['hello']


def test_only_listed_topics_are_recorded(graph: Graph) -> None:
    """Relative names are resolved; one that never comes is named at the end."""
    wanted = graph.publisher(Float64, 'wanted')
    graph.publisher(Float64, 'other')
    process = graph.record({'topics': '["wanted", "/absent"]'})
    publish(graph, wanted, range(3))
    status, errors = stop(process)
    assert status == 0
    assert 'never published: /absent' in errors
    reader = BagReader(graph.bag)
    assert len(list(reader.messages())) == 3
    assert set(reader.topics) == {'/wanted'}


def test_best_effort_and_latched_offers_are_met(graph: Graph) -> None:
    """A latched message sent before the recorder started is recorded, with its offer."""
    latched = graph.publisher(String, 'robot_description', LATCHED)
    latched.publish(String(data='a robot'))
    sensor = graph.publisher(
        Float64, 'sensor', QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    )
    process = graph.record({'topics': '["/robot_description", "/sensor"]'})
    publish(graph, sensor, range(1))
    wait_until(lambda: count_in(graph.bag, '/robot_description'))
    status, _ = stop(process)
    assert status == 0
    assert decoded(graph.bag, '/robot_description') == ['a robot']
    assert decoded(graph.bag, '/sensor') == [0.0]
    topics = BagReader(graph.bag)
    list(topics.messages())
    offer = topics.topics['/robot_description'].offered_qos_profiles
    assert 'durability: transient_local' in offer
    assert 'reliability: best_effort' in topics.topics['/sensor'].offered_qos_profiles


def test_a_type_that_is_not_installed_is_left_out_with_one_warning(
    graph: Graph, tmp_path: Path
) -> None:
    """The others are recorded."""
    hiding = tmp_path / 'hiding'
    (hiding / 'diagnostic_msgs').mkdir(parents=True)
    (hiding / 'diagnostic_msgs' / '__init__.py').touch()
    known = graph.publisher(Float64, 'known')
    graph.publisher(KeyValue, 'unknown')
    process = graph.record(
        {'topics': '["/known", "/unknown"]'},
        PYTHONPATH=os.pathsep.join([str(hiding), os.environ.get('PYTHONPATH', '')]),
    )
    publish(graph, known, range(3))
    status, errors = stop(process)
    assert status == 0
    warning = '/unknown is not recorded: its type diagnostic_msgs/msg/KeyValue is not installed'
    assert errors.count(warning) == 1
    assert decoded(graph.bag, '/known') == [0, 1, 2]


def test_a_file_that_may_not_grow_stops_the_recording_with_one_error(graph: Graph) -> None:
    """Exit status 1, one line, and every message of complete chunks is there."""
    publisher = graph.publisher(UInt8MultiArray, 'noise')
    process = graph.record(
        {'topics': '["/noise"]', 'flush_period_s': '1.0', 'chunk_bytes': '20000'},
        file_limit=300_000,
    )
    wait_until(publisher.get_subscription_count)
    message = UInt8MultiArray(data=random.Random(7).randbytes(5000))

    def is_over() -> bool:
        publisher.publish(message)
        return process.poll() is not None

    wait_until(is_over)
    _, errors = process.communicate()
    assert process.returncode == 1
    assert 'Traceback' not in errors
    assert errors.count('[ERROR]') == 1
    assert 'recording stopped' in errors
    assert len(list(BagReader(graph.bag).messages())) >= 40


def test_the_shipped_parameter_file_holds_the_defaults(graph: Graph) -> None:
    """It is accepted, and changes nothing but what the command line says."""
    file = Path(__file__).parents[4] / 'ros2_ws/src/spikelane/config/recorder.yaml'
    publisher = graph.publisher(Float64, 'x')
    process = graph.record(parameter_file=file)
    publish(graph, publisher, range(3))
    status, errors = stop(process)
    assert status == 0
    assert 'waiting for all topics' in errors
    assert decoded(graph.bag, '/x') == [0, 1, 2]


def test_simulation_time_becomes_the_log_time(graph: Graph) -> None:
    """Each message has the time of the clock message before it."""
    clock = graph.publisher(Clock, '/clock')
    publisher = graph.publisher(Float64, 'x')
    process = graph.record({'topics': '["/x", "/clock"]', 'use_sim_time': 'true'})
    wait_until(publisher.get_subscription_count)
    # The recording's, and the one by which every node follows simulation time.
    wait_until(lambda: clock.get_subscription_count() == 2)
    for step in range(1, 6):
        clock.publish(Clock(clock=Time(sec=step)))
        wait_until(lambda step=step: count_in(graph.bag, '/clock') == step)
        publisher.publish(Float64(data=float(step)))
        wait_until(lambda step=step: count_in(graph.bag, '/x') == step)
    status, _ = stop(process)
    assert status == 0
    times = [message.log_time_ns for message in BagReader(graph.bag).messages(['/x'])]
    assert times == [step * 10**9 for step in range(1, 6)]


def test_wrong_parameters_are_refused_with_one_line(graph: Graph) -> None:
    """Exit status 2 and what is allowed."""
    for parameters, expected in (
        ({'compression': 'gzip'}, 'expected one of zstd, none'),
        ({'chunk_bytes': '5'}, 'chunk_bytes'),
        ({'custom_data': '["seed"]'}, 'expected texts like seed=7'),
        ({'output': str(graph.bag.parent)}, 'expected a folder that does not exist yet'),
    ):
        process = graph.record(parameters)
        _, errors = process.communicate(timeout=DEADLINE_S)
        assert process.returncode == 2
        assert expected in errors
        assert 'Traceback' not in errors


def test_a_thousand_messages_a_second_arrive_whole() -> None:
    """Four topics of 250 to 3000 bytes from another process."""
    result = measure_recorder(1000, 3)
    assert result['sent'] == 3000
    assert result['lost'] == 0
    assert result['recorded'] == 3000
