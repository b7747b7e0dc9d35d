"""Node `replay`: a bag through controller nodes, which answer as in-process."""

from collections.abc import Callable
import json
from pathlib import Path
import signal
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
import pytest
from spikelane_msgs.msg import WheelVelocities

from spikelane.bag.drive import RecordedDrive
from spikelane.runs.configuration import Request
from spikelane.runs.replay.config import ReplayConfig
from spikelane.runs.replay.metrics import Answer, summarise
from spikelane.runs.replay.run import replay
from spikelane_sim import messages

pytestmark = pytest.mark.ros

SEED = 5
CAMERAS = Path(__file__).parents[7] / 'shared' / 'data' / 'real_cameras'
if not CAMERAS.is_dir():
    CAMERAS = Path('/work/shared/data/real_cameras')


@pytest.fixture(scope='module')
def bag(drives, braitenberg_drive, bag_of) -> Path:
    """Give a bag of three episodes that Braitenberg drove with seed 5."""
    return bag_of(drives.say(braitenberg_drive))


def in_process(
    bag: Path, controller: str, seed: int, **options: Any
) -> tuple[list[Answer], dict[str, Any]]:
    """Return the answers of a replay within this process, and what is measured of it."""
    drive = RecordedDrive(bag)
    parameters = options.pop('parameters', {})
    result = replay(
        ReplayConfig.make(Request('1', controller, seed, parameters=parameters), bag, **options),
        drive,
    )
    return result.answers, summarise(drive, result.answers, result.sensor)


def over_ros(
    graph: Any,
    bag: Path,
    controller: str,
    space: str,
    node: dict[str, Any],
    is_ready: Callable[[], bool] = lambda: True,
    **parameters: Any,
) -> dict[str, Any]:
    """Replay a bag through a controller node; return the result that is printed.

    The replay begins when the node is there and `is_ready`.
    """
    remapped = ('-r', f'__ns:=/{space}')
    graph.start(controller, node, *remapped)
    graph.until(is_ready, f'what {space} needs')
    process = graph.start('replay', {'bag': bag, **parameters}, *remapped)
    graph.until(lambda: process.status is not None, 'the end of the replay')
    assert process.status == 0, process.log
    return json.loads(process.log.splitlines()[-1])


def test_who_drove_gives_the_same_answers(graph, bag: Path, tmp_path: Path) -> None:
    """In lockstep, over episodes; the result is that of the command, and in a file too."""
    output = tmp_path / 'result.json'
    result = over_ros(graph, bag, 'braitenberg', 'same', {'seed': SEED}, output=output)
    assert (result['agreement'], result['answers'], result['steps']) == (1.0, 78, 75)
    expected = in_process(bag, 'braitenberg', SEED)[1]
    assert {name: result[name] for name in expected} == expected
    assert result['mode'] == 'lockstep'
    assert json.loads(output.read_text()) == result


def test_another_controller_is_compared_as_in_process(graph, bag: Path) -> None:
    """Here the network with learnt weights."""
    result = over_ros(graph, bag, 'rstdp', 'other', {'seed': 1})
    assert 0 < result['agreement'] < 1
    assert result['equal'] == in_process(bag, 'rstdp', 1)[1]['equal']


def test_in_real_time_packets_come_as_recorded(graph, bag: Path) -> None:
    """78 steps, 5 ms apart when they were recorded; a tenth as fast that is 3.9 s."""
    result = over_ros(graph, bag, 'braitenberg', 'real', {'seed': SEED}, mode='realtime', rate=0.1)
    assert (result['agreement'], result['unanswered']) == (1.0, 0)
    assert result['wall_time_s'] >= 3.8


@pytest.fixture(scope='module')
def camera_bag() -> Path:
    """Give the recording of a real camera, 1280 x 720, packets of 12 ms."""
    if not CAMERAS.is_dir():
        pytest.skip(f'no recordings of cameras at {CAMERAS}')
    return CAMERAS / 'test_data_evt3_trigger'


@pytest.mark.parametrize(
    ('controller', 'how'),
    [
        ('braitenberg', {'mode': 'lockstep'}),
        ('rstdp', {'mode': 'lockstep'}),
        ('rstdp', {'mode': 'realtime'}),
    ],
)
def test_a_real_camera_is_answered_packet_by_packet(
    graph, camera_bag: Path, controller: str, how: dict[str, Any]
) -> None:
    """As in-process, bit for bit, with the stamps of steps of 50 ms."""
    space = f'{controller}_{how["mode"]}'
    got: list[WheelVelocities] = []
    answers_of = graph.node.create_subscription(
        WheelVelocities, f'/{space}/wheel_velocities', got.append, 1000
    )
    node = {'seed': SEED, 'use_lane_state': 'false', 'reliability': 'best_effort'}
    if how['mode'] == 'lockstep':
        del node['reliability']
    # In real time nobody waits for an observer: it is there before the first packet.
    result = over_ros(
        graph,
        camera_bag,
        controller,
        space,
        node,
        lambda: answers_of.get_publisher_count() == 1,
        **how,
    )
    assert (result['agreement'], result['observations']) == (None, 25)
    assert (result['events']['on'], result['events']['off']) == (41439, 41030)
    assert result['unfinished'] == {'packets': 0, 'events': 80}
    expected = in_process(camera_bag, controller, SEED)[0]
    graph.until(lambda: len(got) >= 25, 'all answers')
    # The last one is sent again as subscribers come and go.
    answers = {
        messages.to_stamp_ns(each.header.stamp): messages.wheels_from_message(each) for each in got
    }
    assert answers == {each.stamp_ns: each.replayed for each in expected}


@pytest.mark.parametrize(
    ('parameters', 'error'),
    [
        ({}, "error: bag: expected the path of a bag, got ''"),
        (
            {'bag': '/nowhere'},
            'error: /nowhere: expected an .mcap or .db3 file or a bag folder, found no',
        ),
        ({'bag': '/nowhere', 'rate': 0}, 'error: rate: expected'),
    ],
)
def test_wrong_use_is_one_line(graph, parameters: dict[str, Any], error: str) -> None:
    """Exit status 2."""
    process = graph.start('replay', parameters)
    assert process.wait() == 2
    assert error in process.log
    assert 'Traceback' not in process.log


def test_it_waits_for_a_controller_until_it_is_told_to_end(graph, bag: Path) -> None:
    """And says so; a signal ends it without a result, which the exit status tells."""
    process = graph.start('replay', {'bag': bag}, '-r', '__ns:=/alone')
    graph.until(lambda: 'waiting for 1 subscribers of event_camera/events' in process.log)
    assert process.stop(signal.SIGINT) == 130
    assert 'ended by SIGINT after 0 steps: there is no result' in process.log
    assert 'Traceback' not in process.log


def test_a_part_that_no_camera_has_ends_the_controller(graph, camera_bag: Path) -> None:
    """With one line, as any wrong parameter."""
    remapped = ('-r', '__ns:=/narrow')
    parameters = {'use_lane_state': 'false', 'sensor.crop_width': 5000}
    controller = graph.start('braitenberg', parameters, *remapped)
    replaying = graph.start('replay', {'bag': camera_bag}, *remapped)
    assert controller.wait() == 2
    assert 'sensor: crop_left, crop_top, crop_width: expected a part of 1280 x 720' in (
        controller.log
    )
    assert replaying.stop() == 130


def test_a_real_cameras_events_are_filtered_as_in_process(graph, camera_bag: Path) -> None:
    """Before they are scaled: hardly any is left of a still scene's noise; rates are told."""
    filters = {'filter.chain': 'refractory,correlation', 'filter.correlation.supporters': 1}
    said: list[dict[str, str]] = []

    def take(message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            if status.name == 'braitenberg' and int(values.get('events_in', 0)):
                said.append(values)

    graph.node.create_subscription(DiagnosticArray, '/diagnostics', take, 100)
    node = {'seed': SEED, 'use_lane_state': 'false', **filters}
    graph.start('braitenberg', node, '-r', '__ns:=/filtered')
    how = {'mode': 'realtime', 'rate': 0.5, **filters}
    process = graph.start('replay', {'bag': camera_bag, **how}, '-r', '__ns:=/filtered')
    graph.until(lambda: process.status is not None, 'the end of the replay')
    result = json.loads(process.log.splitlines()[-1])
    options = {'use_lane_state': False, 'parameters': filters}
    expected = in_process(camera_bag, 'braitenberg', SEED, **options)[1]
    assert result['events'] == expected['events']
    assert expected['events']['passed'] == 3135
    assert 0 < expected['events']['kept'] <= 3135
    # Nodes of other tests, in other namespaces, have the same name in the diagnostics.
    counts = {'events_in': '82469', 'events_out': '3135'}
    graph.until(lambda: any(counts.items() <= v.items() for v in said), 'the count of all events')
    assert any(0 < float(v['events_out_per_s']) < float(v['events_in_per_s']) for v in said)
