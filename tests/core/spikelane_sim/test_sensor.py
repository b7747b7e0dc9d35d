"""From packets to steps: a simulator's as they are, a camera's cropped, scaled and binned."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

from spikelane.bag.drive import RecordedDrive
from spikelane_sim.binning import (
    Crop,
    find_crop,
    first_per_pixel,
    scale_events,
    SensorParameters,
)
from spikelane_sim.codecs import encode
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import make_events
from spikelane_sim.sensor import ReceivedPacket, Sensor

ROOT = Path(__file__).parents[3]
CAMERAS = ROOT.parent / 'shared' / 'data' / 'real_cameras'
if not CAMERAS.is_dir():
    CAMERAS = Path('/work/shared/data/real_cameras')
MS = 1_000_000
DATA = ROOT / 'tests' / 'data' / 'cameras'
TYPE = 'event_camera_msgs/msg/EventPacket'


def packet(
    stamp_ns: int,
    sequence: int,
    t_ns: list[int],
    x: Any = 64,
    y: Any = 64,
    size: tuple[int, int] = (128, 128),
    time_base_ns: int = 0,
) -> ReceivedPacket:
    """Return a packet in mono, whose times count from a time base."""
    events = make_events(t_ns, x, y, 1)
    data = encode('mono', events, 0, *size).data
    return ReceivedPacket(stamp_ns, sequence, 'mono', data, time_base_ns, *size)


def camera(**parameters: Any) -> Sensor:
    """Return a sensor that takes all packets for a camera's."""
    return Sensor(SensorParameters(source='camera', **parameters), sums_events=True)


def times(steps: list[Any]) -> list[tuple[int, list[int]]]:
    """Return the steps' stamps and the times of their events [ms]."""
    return [(step.stamp_ns // MS, (step.events['t'] // MS).tolist()) for step in steps]


def test_events_are_binned_by_their_own_time() -> None:
    """From the first event on, which is at its packet's stamp; a step comes with the next event.

    The third and the fifth step have none.
    """
    sensor = camera(one_per_pixel=False)
    assert sensor.add(packet(1000 * MS, 0, [7 * MS, 30 * MS])) == []
    steps = sensor.add(packet(1040 * MS, 1, [56 * MS, 57 * MS, 58 * MS, 106 * MS]))
    assert times(steps) == [(1050, [1000, 1023, 1049])]
    steps = sensor.add(packet(1200 * MS, 2, [157 * MS]))
    assert times(steps) == [(1100, [1050, 1051, 1099]), (1150, [])]
    steps = sensor.add(packet(1300 * MS, 3, [300 * MS]))
    assert times(steps) == [(1200, [1150]), (1250, [])]


def test_a_packet_may_span_many_steps() -> None:
    """All but the last are complete."""
    sensor = camera()
    steps = sensor.add(packet(MS, 0, [n * 20 * MS for n in range(11)]))
    assert [step.stamp_ns // MS for step in steps] == [51, 101, 151, 201]
    assert sensor.on == 11
    # The pixel fires three, two, three and two times; one event of each step is left.
    assert [len(step.events) for step in steps] == [1, 1, 1, 1]
    assert sensor.events_in_steps == 4


def test_what_comes_after_the_last_complete_step_is_counted() -> None:
    """Events from the step's end on, and packets that do not complete another."""
    sensor = camera()
    unfinished = []
    for number, t_ms in enumerate(([0, 20, 51, 60], [70], [], [90, 100], [101])):
        sensor.add(packet(number * MS, number, [t * MS for t in t_ms]))
        unfinished.append((sensor.unfinished_packets, sensor.unfinished_events))
    assert unfinished == [(0, 2), (1, 3), (2, 3), (0, 1), (1, 2)]


def test_nothing_comes_after_a_simulators_step() -> None:
    """Each packet is a step."""
    sensor = Sensor(has_lane=True)
    sensor.add(packet(50 * MS, 0, [10 * MS]))
    assert (sensor.unfinished_packets, sensor.unfinished_events) == (0, 0)


def test_a_step_keeps_the_first_event_of_each_pixel() -> None:
    """In the order of time."""
    events = make_events([1, 2, 3, 4], [5, 4, 5, 4], [0, 9, 0, 8], [1, 1, -1, -1])
    kept = first_per_pixel(events, 6, 10)
    assert kept['t'].tolist() == [1, 2, 4]
    assert kept['polarity'].tolist() == [1, 1, -1]


@pytest.mark.parametrize(
    ('size', 'parameters', 'crop'),
    [
        ((1280, 720), {}, Crop(280, 0, 720, 720)),
        ((640, 480), {}, Crop(80, 0, 480, 480)),
        ((480, 640), {}, Crop(0, 80, 480, 480)),
        ((346, 260), {'crop_width': 128}, Crop(109, 66, 128, 128)),
        ((346, 260), {'crop_left': 0, 'crop_top': 4, 'crop_width': 256}, Crop(0, 4, 256, 256)),
        ((64, 64), {}, Crop(0, 0, 64, 64)),
    ],
)
def test_the_largest_square_in_the_middle_is_used(
    size: tuple[int, int], parameters: dict[str, int], crop: Crop
) -> None:
    """Unless another part is asked for."""
    assert find_crop(*size, SensorParameters(**parameters), 128, 128) == crop


def test_a_part_that_is_not_in_the_image_is_refused() -> None:
    """In one sentence with what came."""
    parameters = SensorParameters(source='camera', crop_left=200, crop_width=128)
    with pytest.raises(ParameterError, match=r'part of 320 x 240 px, got 128 x 128 px from \(200'):
        Sensor(parameters).add(packet(MS, 0, [1], size=(320, 240)))


def test_events_are_scaled_by_whole_numbers() -> None:
    """Corners of a 1280 x 720 image's square go to corners; what is outside is left out."""
    x, y = [279, 280, 285, 286, 999, 1000], [0, 0, 5, 6, 719, 0]
    scaled = scale_events(make_events(range(6), x, y, 1), Crop(280, 0, 720, 720), 128, 128)
    assert scaled['t'].tolist() == [1, 2, 3, 4]
    assert scaled['x'].tolist() == [0, 0, 1, 127]
    assert scaled['y'].tolist() == [0, 0, 1, 127]


def test_a_wanted_shape_is_kept() -> None:
    """Twice as wide as high, of a camera of 640 x 480."""
    assert find_crop(640, 480, SensorParameters(), 256, 128) == Crop(0, 80, 640, 320)


def simulated(stamp_ns: int, sequence: int) -> ReceivedPacket:
    """Return a packet of a simulator's step."""
    events = make_events([stamp_ns] * 3, [3, 3, 200], [7, 7, 100], 1)
    encoded = encode('evt3', events, stamp_ns, 256, 128)
    return ReceivedPacket(stamp_ns, sequence, 'evt3', encoded.data, encoded.time_base_ns, 256, 128)


@pytest.mark.parametrize('has_lane', [True, False])
def test_the_steps_of_a_simulator_are_taken_as_they_are(has_lane: bool) -> None:
    """Told by its lane states or by the time base of the first packet."""
    sensor = Sensor(width=256, has_lane=has_lane)
    for n in range(1, 4):
        (step,) = sensor.add(simulated(n * 50 * MS, n))
        assert step.stamp_ns == n * 50 * MS
        assert step.events['x'].tolist() == [3, 3, 200]
    assert sensor.is_camera is False


@pytest.mark.parametrize('has_lane', [True, False])
def test_a_simulator_of_another_size_is_refused(has_lane: bool) -> None:
    """It is not scaled; unless nobody looks at it."""
    with pytest.raises(ParameterError, match=r'image of 128 x 128 px, .* got 256 x 128 px'):
        Sensor(has_lane=has_lane).add(simulated(50 * MS, 1))
    (step,) = Sensor(has_lane=has_lane, any_size=True).add(simulated(50 * MS, 1))
    assert step.events['x'].tolist() == [3, 3, 200]


def test_lane_states_do_not_go_with_a_camera() -> None:
    """Its steps have other stamps."""
    with pytest.raises(ParameterError, match='expected auto or simulator where lane states'):
        Sensor(SensorParameters(source='camera'), has_lane=True)


def test_a_long_pause_begins_anew() -> None:
    """No flood of empty steps; what was gathered is dropped."""
    sensor = camera()
    sensor.add(packet(1000 * MS, 0, [0]))
    assert sensor.add(packet(3000 * MS, 1, [1900 * MS, 1949 * MS])) == []
    assert times(sensor.add(packet(3051 * MS, 2, [1951 * MS])))[0][0] == 3050
    assert sensor.restarts == 1


def test_a_pause_inside_a_packet_does_not_go_back_in_time() -> None:
    """Steps have rising stamps all the same."""
    sensor = camera(longest_pause_s=0.1)
    steps = sensor.add(packet(1000 * MS, 0, [0, 60 * MS, 500 * MS, 560 * MS]))
    assert [step.stamp_ns // MS for step in steps] == [1050, 1110]


def test_a_stamp_that_goes_back_begins_anew() -> None:
    """As in a replay that is repeated."""
    sensor = camera()
    for _ in range(2):
        sensor.add(packet(1000 * MS, 5, [0]))
        assert times(sensor.add(packet(1060 * MS, 6, [60 * MS]))) == [(1050, [1000])]
    assert sensor.lost == 0


def test_a_time_that_goes_back_a_little_from_packet_to_packet_is_the_latest_one() -> None:
    """Cameras do that."""
    sensor = camera(one_per_pixel=False)
    sensor.add(packet(1000 * MS, 0, [0, 30 * MS]))
    steps = sensor.add(packet(1030 * MS, 1, [20 * MS, 55 * MS]))
    assert times(steps) == [(1050, [1000, 1030, 1030])]


def test_lost_and_faulty_packets_are_told() -> None:
    """A camera's faulty packet is no step, a simulator's is one without events."""
    said: list[Any] = []
    sensor = Sensor(SensorParameters(source='camera'), on_fault=said.append, on_loss=said.append)
    sensor.add(packet(1000 * MS, 0, [0]))
    sensor.add(packet(1020 * MS, 3, [20 * MS]))
    bad = packet(1040 * MS, 4, [40 * MS])
    assert sensor.add(bad._replace(data=b'123')) == []
    assert said == [2, 'mono packet: expected words of 8 bytes, got 3 bytes']
    assert (sensor.lost, sensor.faulty) == (2, 1)
    sensor = Sensor(width=256, has_lane=True)
    (step,) = sensor.add(simulated(50 * MS, 1)._replace(encoding='evt9'))
    assert len(step.events) == 0


def recorded(name: str) -> Iterator[ReceivedPacket]:
    """Yield the packets of a real camera's recording, where there is one."""
    if not CAMERAS.is_dir():
        pytest.skip(f'no recordings of cameras at {CAMERAS}')
    store = get_typestore(Stores.ROS2_JAZZY)
    text = (ROOT / 'msgs/event_camera_msgs/msg/EventPacket.msg').read_text()
    store.register(get_types_from_msg(text, TYPE))
    with Reader(CAMERAS / name) as reader:
        for _, _, raw in reader.messages():
            m: Any = store.deserialize_cdr(raw, TYPE)
            stamp_ns = m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
            size = (m.width, m.height, m.is_bigendian)
            yield ReceivedPacket(stamp_ns, m.seq, m.encoding, m.events, m.time_base, *size)


@pytest.mark.parametrize(
    ('name', 'counts', 'steps'),
    [
        # 14.224870 to 15.476187 s: 25 whole steps of 50 ms.
        ('test_data_evt3_trigger', (105, 41439, 41030, 42078718, 31656267), 25),
        # 1.999986 s: 39 whole steps.
        ('test_data_libcaer_rollover', (201, 181908, 152423, 111651612, 82801007), 39),
    ],
)
def test_real_cameras_give_the_known_counts_in_steps(
    name: str, counts: tuple[int, ...], steps: int
) -> None:
    """All of their events, whatever of them is used; steps of 128 x 128 at 50 ms."""
    sensor = Sensor(sums_events=True)
    given = [step for each in recorded(name) for step in sensor.add(each)]
    assert sensor.is_camera is True
    assert (sensor.packets, sensor.on, sensor.off, sensor.sum_x, sensor.sum_y) == counts
    assert (sensor.faulty, sensor.lost, sensor.restarts) == (0, 0, 0)
    assert len(given) == steps
    assert set(np.diff([step.stamp_ns for step in given]).tolist()) == {50 * MS}
    for step in given:
        events = step.events
        assert events['x'].max() < 128
        assert events['y'].max() < 128
        assert len(np.unique(events[['x', 'y']])) == len(events)
        assert step.stamp_ns - 50 * MS <= events['t'][0]
        assert events['t'][-1] < step.stamp_ns
        assert np.all(np.diff(events['t']) >= 0)


def test_the_steps_of_a_real_camera_hold_all_events_of_the_square() -> None:
    """Where none is left out for its pixel, and the last step is not there."""
    sensor = Sensor(SensorParameters(one_per_pixel=False))
    packets = list(recorded('test_data_evt3_trigger'))
    given = [step for each in packets for step in sensor.add(each)]
    whole = Sensor(SensorParameters(one_per_pixel=False), width=1280, height=720)
    wide = [step for each in packets for step in whole.add(each)]
    for step, all_of_it in zip(given, wide, strict=True):
        x = all_of_it.events['x'].astype(int)
        inside = (x >= 280) & (x < 1000)
        assert step.events['x'].tolist() == [(each - 280) * 8 // 45 for each in x[inside]]
        assert len(step.events) == int(inside.sum())


def of_bag(name: str, **parameters: Any) -> tuple[Sensor, list[Any]]:
    """Return what a camera's recorded packets give: the sensor, and its steps."""
    sensor = Sensor(SensorParameters(**parameters), sums_events=True)
    drive = RecordedDrive(DATA / f'{name}.mcap')
    return sensor, [step for each in drive.packets() for step in sensor.add(each.packet)]


@pytest.mark.parametrize(
    ('name', 'on', 'off', 'steps', 'counted'),
    [
        ('plain', 2019, 1981, 19, {}),
        ('reserved_words', 2019, 1981, 19, {'reserved': 800}),
        ('event_outside', 2019, 1981, 19, {'outside': 1}),
        ('stamps_back_1ms', 4000, 0, 19, {}),
        ('stamps_back_1us', 4000, 0, 19, {}),
        # 1 s of events, 4 s of time words alone, 1 s of events: 5.95 s in all.
        ('time_words', 8000, 0, 119, {}),
    ],
)
def test_one_bad_word_of_a_camera_costs_one_word(
    name: str, on: int, off: int, steps: int, counted: dict[str, int]
) -> None:
    """All else of the recording is there, in steps of 50 ms without a gap."""
    sensor, given = of_bag(name)
    assert (sensor.on, sensor.off, len(given)) == (on, off, steps)
    assert set(np.diff([step.stamp_ns for step in given]).tolist()) == {50 * MS}
    counts = {'reserved': 0, 'outside': 0, 'mistimed': 0, 'faulty': 0, 'lost': 0, 'restarts': 0}
    assert {kind: getattr(sensor, kind) for kind in counts} == counts | counted
    assert list(sensor.notes) == list(counted)
    assert all(str(count) in sensor.notes[kind] for kind, count in counted.items())


@pytest.mark.parametrize('bit', range(12))
def test_a_damaged_time_word_restarts_nothing(bit: int) -> None:
    """A flipped bit in the tenth of 20 TIME_HIGH words of a packet costs an event at most."""
    sensor, steps = camera(), 0
    for number, recorded in enumerate(RecordedDrive(DATA / 'plain.mcap').packets()):
        words = np.frombuffer(recorded.packet.data, '<u2').copy()
        if number == 100:
            words[np.flatnonzero(words >> 12 == 8)[9]] ^= 1 << bit
        steps += len(sensor.add(recorded.packet._replace(data=words.tobytes())))
    assert (sensor.restarts, steps) == (0, 19)
    assert sensor.on + sensor.off + sensor.mistimed == 4000
    assert sensor.mistimed <= 1


def test_a_still_scene_gives_empty_steps() -> None:
    """80 of 119 steps, in a row, have no event."""
    empty = [len(step.events) == 0 for step in of_bag('time_words')[1]]
    assert sum(empty) == 80 - 1
    assert empty.index(True) == 20
    assert all(empty[20:99])


def test_time_words_before_the_first_event_begin_the_steps() -> None:
    """A camera before a scene that is still from the start: TIME_HIGH 0x0A each 40.96 ms."""
    sensor, steps = camera(), []
    for n in range(1, 5):
        data = np.array([0x8000 | 10 * n, 0x6000], '<u2').tobytes()
        steps += sensor.add(ReceivedPacket(1000 * MS * n, n, 'evt3', data, 0, 128, 128))
    # 122.88 ms from the first packet to the last.
    assert [(step.stamp_ns // MS, len(step.events)) for step in steps] == [(1050, 0), (1100, 0)]


def evt3_packet(stamp_ns: int, sequence: int, words: str, height: int = 128) -> ReceivedPacket:
    """Return a packet of a camera."""
    return ReceivedPacket(stamp_ns, sequence, 'evt3', bytes.fromhex(words), 0, 128, height)


@pytest.mark.parametrize(
    ('packets', 'reason'),
    [
        # A driver that was started again: the numbers go back, the stamps do not.
        ([(1000, 70, 0), (1010, 1, 10)], "the packets' numbers went back"),
        ([(1000, 1, 0), (499, 2, 10)], 'the stamps went back by more than 0.5 s'),
        ([(1000, 1, 60), (1010, 2, 9)], "the sensor's time went back"),
        ([(1000, 1, 0), (1010, 2, 1001)], "the sensor's time went on by more than 1 s at once"),
    ],
)
def test_every_restart_is_counted_and_told(
    packets: list[tuple[int, int, int]], reason: str
) -> None:
    """By the sensor's own time, the packets' numbers, and stamps beyond a tolerance."""
    sensor = camera()
    for stamp_ms, sequence, t_ms in packets:
        sensor.add(packet(stamp_ms * MS, sequence, [t_ms * MS]))
    assert sensor.restarts == 1
    assert sensor.notes == {'restarts': f"the camera's steps restarted (count: 1): {reason} (1)"}


@pytest.mark.parametrize('back_ms', [1, 499, 500])
def test_stamps_that_go_back_within_the_tolerance_change_nothing(back_ms: int) -> None:
    """The steps go on by the sensor's time; more is allowed where asked for."""
    for sensor, back in ((camera(), back_ms), (camera(stamp_tolerance_s=2.0), 4 * back_ms)):
        sensor.add(packet(9000 * MS, 1, [0]))
        assert sensor.add(packet((9000 - back) * MS, 2, [40 * MS])) == []
        steps = sensor.add(packet((9020 - back) * MS, 3, [60 * MS]))
        assert times(steps) == [(9050, [9000])]
        assert (sensor.restarts, sensor.notes) == (0, {})


def test_another_size_is_another_camera_and_is_told() -> None:
    """What is gathered of the one before is dropped."""
    sensor = camera()
    sensor.add(packet(1000 * MS, 1, [0], size=(128, 128)))
    sensor.add(packet(1010 * MS, 2, [10 * MS], size=(256, 256)))
    assert sensor.notes == {
        'restarts': "the camera's steps restarted (count: 1): another encoding or image size (1)"
    }


def test_the_time_base_survives_packets_that_cannot_be_decoded() -> None:
    """Half a word, or an impossible size: what follows needs no TIME_HIGH, and goes on."""
    sensor = camera(one_per_pixel=False)
    sensor.add(evt3_packet(1000 * MS, 1, '0080 0060 0500 0128'))
    assert sensor.add(evt3_packet(1001 * MS, 2, '0128 01')) == []
    assert sensor.add(evt3_packet(1001 * MS, 3, '0128', height=0)) == []
    assert sensor.add(evt3_packet(1001 * MS, 4, '0128', height=5000)) == []
    assert sensor.add(evt3_packet(1002 * MS, 5, 'd067 0500 0128')) == []  # 2000 us
    (step,) = sensor.add(evt3_packet(1060 * MS, 6, '0f80 0060'))
    assert (step.events['t'] / MS).tolist() == [1000, 1002]
    assert (sensor.faulty, sensor.restarts, sensor.lost) == (3, 0, 0)
    assert list(sensor.notes.values()) == [
        '1 event packets cannot be decoded; left out: evt3 packet: expected words of '
        '2 bytes, got 3 bytes',
        '2 event packets cannot be decoded; left out: evt3 packet: expected a sensor '
        'of 1 x 1 to 2048 x 2048 px, got 128 x 0',
    ]


def test_a_simulator_that_is_reset_is_no_camera_that_began_anew() -> None:
    """Its packets stand for themselves, wherever their stamps are."""
    sensor = Sensor(width=256)
    for n, stamp in enumerate((500, 550, 50, 100)):
        (step,) = sensor.add(simulated(stamp * MS, n))
        assert step.stamp_ns == stamp * MS
    assert (sensor.restarts, sensor.notes) == (0, {})
