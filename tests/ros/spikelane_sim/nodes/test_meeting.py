"""Simulator, controller and recorder meet, in any order and namespace; losses are found."""

from collections.abc import Iterator
from pathlib import Path
import signal
from typing import Any

import pytest
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rosbags.highlevel import AnyReader
from spikelane_msgs.msg import Published
from std_msgs.msg import Float64

from spikelane.runs.lap.nodes.driving import recorded_topics
from spikelane_sim.nodes.meeting import LATCHED, meeting_parameters

pytestmark = pytest.mark.ros

STEPS = 40
EVERY_STEP = (
    'controller/state',
    'event_camera/events',
    'ground_truth/odom',
    'lane/distance',
    'lane/state',
    'wheel_velocities',
)


class Drive:
    """A recorded lap in a namespace, its nodes started by hand."""

    def __init__(self, graph: Any, space: str, bag: Path, steps: int) -> None:
        simulator, controller = meeting_parameters('braitenberg', is_recorded=True)
        limits = {'end_after_episodes': 1, 'episode.max_steps': steps, 'robot.engine': 'kinematic'}
        self._parameters: dict[str, dict[str, Any]] = {
            'simulator': simulator | limits,
            'braitenberg': controller,
            'recorder': {'output': bag, 'topics': list(recorded_topics('braitenberg'))},
        }
        self._graph, self._space = graph, space
        self.nodes: dict[str, Any] = {}

    def start(self, name: str) -> Any:
        """Start one of the nodes."""
        arguments = ['-r', f'__ns:={self._space}']
        for topic in ('/clock', '/tf', '/tf_static'):  # global, unless they are remapped
            arguments += ['-r', f'{topic}:={topic[1:]}']
        values = {
            key: f'[{", ".join(value)}]' if isinstance(value, list) else value
            for key, value in self._parameters[name].items()
        }
        self.nodes[name] = self._graph.start(name, values, *arguments)
        return self.nodes[name]

    def end(self) -> dict[str, int]:
        """Wait for the lap's end, end the others in order, and return all exit statuses."""
        statuses = {'simulator': self.nodes['simulator'].wait()}
        for name in ('braitenberg', 'recorder'):
            statuses[name] = self.nodes[name].stop()
        return statuses


@pytest.mark.parametrize(
    'order',
    [
        ('recorder', 'simulator', 'braitenberg'),
        ('braitenberg', 'simulator', 'recorder'),
        ('simulator', 'recorder', 'braitenberg'),
    ],
    ids='-'.join,
)
def test_a_lap_in_a_namespace_is_recorded_whole(
    graph: Any, tmp_path: Path, order: tuple[str, ...]
) -> None:
    """Every message of every step, whichever node is met last."""
    space = f'/{order[-1]}_last'
    drive = Drive(graph, space, tmp_path / 'bag', STEPS)
    *first, last = (drive.start for _ in order)
    for start, name in zip(first, order, strict=False):
        start(name)
    lacking = {
        'braitenberg': f'{space}/braitenberg to subscribe to {space}/lane/state',
        'recorder': f'a recorder that publishes {space}/recorder/state',
    }[order[-1]]
    graph.until(lambda: lacking in drive.nodes['simulator'].log, 'who is waited for to be named')
    last(order[-1])
    assert drive.end() == {'simulator': 0, 'braitenberg': 0, 'recorder': 0}
    assert ', 0 lost' in drive.nodes['recorder'].log
    with AnyReader([tmp_path / 'bag']) as reader:
        counts = {each.topic: each.msgcount for each in reader.connections}
    every = [f'{space}/{name}' for name in (*EVERY_STEP, 'clock', 'tf')]
    assert {topic: counts[topic] for topic in every} == dict.fromkeys(every, STEPS + 1)
    assert counts[f'{space}/tf_static'] == counts[f'{space}/robot_description'] == 1


def test_a_signal_to_all_amid_a_lap_leaves_no_status_0(graph: Any, tmp_path: Path) -> None:
    """As Ctrl-C does: the recorder too says that what it has is not the whole drive."""
    drive = Drive(graph, '/cut', tmp_path / 'bag', 10**6)
    for name in ('recorder', 'simulator', 'braitenberg'):
        drive.start(name)
    graph.until(
        lambda: sum(file.stat().st_size for file in tmp_path.glob('bag/*.mcap')) > 10_000,
        'a recording',
    )
    for node in drive.nodes.values():
        node.send(signal.SIGINT)
    assert {name: node.wait() for name, node in drive.nodes.items()} == dict.fromkeys(
        ('recorder', 'simulator', 'braitenberg'), 130
    )


@pytest.mark.parametrize(
    ('intruder', 'topics'),
    [('simulator', ('lane/state', 'event_camera/events')), ('braitenberg', ('wheel_velocities',))],
)
def test_a_second_publisher_ends_a_lap_and_is_named_by_all(
    graph: Any, tmp_path: Path, intruder: str, topics: tuple[str, ...]
) -> None:
    """With its node and its topic, and status 1."""
    space = f'/second_{intruder}'
    drive = Drive(graph, space, tmp_path / 'bag', 10**6)
    for name in ('recorder', 'simulator', 'braitenberg'):
        drive.start(name)
    graph.until(
        lambda: sum(file.stat().st_size for file in tmp_path.glob('bag/*.mcap')) > 10_000,
        'a recording',
    )
    other = graph.start(intruder, {}, '-r', f'__ns:={space}', '-r', '__node:=intruder')
    both = ', '.join(sorted([f'{space}/intruder', f'{space}/{intruder}']))
    expected = [f'{space}/{topic}: expected one publisher, got 2: {both}' for topic in topics]
    assert drive.nodes['simulator'].wait() == 1
    assert drive.nodes['braitenberg'].wait() == 1
    recorder = drive.nodes['recorder']
    # It looks for second publishers from time to time, and would else be stopped too early.
    graph.until(lambda: all(text in recorder.log for text in expected), "the recorder's word")
    assert recorder.stop() == 1
    for node in drive.nodes.values():
        assert all(text in node.log for text in expected), node.log
    other.stop()


@pytest.fixture
def said(graph: Any) -> Iterator[Publisher]:
    """Give what tells the recorder what was published."""
    publisher = graph.node.create_publisher(Published, 'recorder/published', LATCHED)
    yield publisher
    graph.node.destroy_publisher(publisher)


def until_received(graph: Any, *publishers: Publisher) -> None:
    """Wait until the recorder has all that was published."""
    for each in publishers:
        graph.until(each.get_subscription_count, 'the recorder')
        graph.until(lambda each=each: each.wait_for_all_acked(Duration()), 'the messages')


@pytest.mark.parametrize(
    ('first', 'last', 'lost'), [(1, 5, 0), (1, 6, 1), (1, 8, 3)], ids=['none', 'one', 'three']
)
@pytest.mark.parametrize('topic', ['/clock', '/tf', '/lane/distance', '/controller/state'])
def test_what_is_lacking_at_the_end_is_named(
    graph: Any, said: Publisher, tmp_path: Path, topic: str, first: int, last: int, lost: int
) -> None:
    """A loss on one topic alone, where no gap shows it."""
    publisher = graph.node.create_publisher(Float64, topic, 10)
    recorder = graph.start('recorder', {'output': tmp_path / 'bag', 'topics': f'[{topic}]'})
    graph.until(publisher.get_subscription_count, 'the recorder')
    for value in range(5):
        publisher.publish(Float64(data=float(value)))
    name = publisher.topic_name
    message = Published(node='/test', topics=[name], first=[first], last=[last])
    message.state = Published.COMPLETE
    said.publish(message)
    until_received(graph, publisher, said)
    assert recorder.stop() == (1 if lost else 0)
    assert (f'messages lost: {name} {lost}' in recorder.log) is (lost > 0)
    graph.node.destroy_publisher(publisher)


def test_what_was_sent_before_the_recorder_came_is_lacking_if_it_was_waited_for(
    graph: Any, said: Publisher, tmp_path: Path
) -> None:
    """The first numbers are missing, and a topic that was never met."""
    publisher = graph.node.create_publisher(Float64, '/early', 10)
    for _ in range(2):
        publisher.publish(Float64())
    recorder = graph.start('recorder', {'output': tmp_path / 'bag', 'topics': '[/early, /never]'})
    graph.until(publisher.get_subscription_count, 'the recorder')
    publisher.publish(Float64())
    message = Published(node='/test', topics=['/early', '/never'], first=[1, 1], last=[3, 4])
    message.state = Published.COMPLETE
    said.publish(message)
    until_received(graph, publisher, said)
    assert recorder.stop() == 1
    assert 'messages lost: /early 2, /never 4' in recorder.log
    graph.node.destroy_publisher(publisher)


@pytest.mark.parametrize('state', [Published.PUBLISHING, Published.CUT_SHORT])
def test_a_recording_of_a_drive_that_was_cut_short_does_not_end_with_0(
    graph: Any, said: Publisher, tmp_path: Path, state: int
) -> None:
    """The nodes whose work was not done are named."""
    said.publish(Published(node='/drive/simulator', state=state))
    recorder = graph.start('recorder', {'output': tmp_path / 'bag'})
    until_received(graph, said)
    graph.until(lambda: 'recording' in recorder.log, 'the recording')
    assert recorder.stop() == 130
    assert 'ended by SIGINT before the work of /drive/simulator was done' in recorder.log


def test_a_node_that_waits_for_nobody_names_a_second_publisher_and_goes_on(graph: Any) -> None:
    """Once, and not again while it is the same."""
    simulator = graph.start('simulator', {'robot.engine': 'kinematic'}, '-r', '__ns:=/free')
    for name in ('one', 'two'):
        graph.start('braitenberg', {}, '-r', '__ns:=/free', '-r', f'__node:={name}')
    expected = '/free/wheel_velocities: expected one publisher, got 2: /free/one, /free/two'
    graph.until(lambda: expected in simulator.log, 'the warning')
    assert simulator.status is None
