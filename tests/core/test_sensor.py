"""From packets to steps: a simulator's as they are, a camera's cropped, scaled and binned."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

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

ROOT = Path(__file__).parents[2]
CAMERAS = ROOT.parent / 'shared' / 'data' / 'real_cameras'
if not CAMERAS.is_dir():
    CAMERAS = Path('/work/shared/data/real_cameras')
MS = 1_000_000
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
    # Of the one pixel's three, two, three, two events one is left.
    assert [len(step.events) for step in steps] == [1, 1, 1, 1]
    assert sensor.kept == 4


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
