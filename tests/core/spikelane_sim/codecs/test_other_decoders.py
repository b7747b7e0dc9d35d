"""Decoders that we did not write, reading what we wrote (evt3 raw files)."""

from pathlib import Path

import numpy as np
import pytest

from spikelane_sim.codecs import Decoder, encode
from spikelane_sim.events import Events, make_events

HEADER = """\
% date 2024-01-01 00:00:00
% evt 3.0
% format EVT3;height=128;width=128
% generation 4.0
% geometry 128x128
% end
"""
STEP_NS = 50_000_000
FIRST_NS = 16_600_000_000


@pytest.fixture(name='recording')
def _recording(tmp_path: Path) -> tuple[Path, Events]:
    """A raw file of 20 packets, across the time coming round at 16.777216 s, and its events."""
    rng = np.random.default_rng(7)
    path, steps = tmp_path / 'recording.raw', []
    with path.open('wb') as file:
        file.write(HEADER.encode())
        for step in range(20):
            start_ns = FIRST_NS + step * STEP_NS
            t_ns = start_ns + np.sort(rng.integers(0, STEP_NS // 1000, 300)) * 1000
            places = rng.integers(0, 128, (2, 300))
            events = make_events(t_ns, *places, rng.choice([-1, 1], 300))
            file.write(encode('evt3', events, start_ns + STEP_NS, 128, 128).data)
            steps.append(events)
    return path, np.concatenate(steps)


@pytest.fixture(name='hour', scope='module')
def _hour(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Events]:
    """A raw file of an hour's packets, 72,000 steps, and its events.

    Many steps have no event, some for longer than the time takes to come round (20 s).
    """
    rng = np.random.default_rng(8)
    path, seen = tmp_path_factory.mktemp('hour') / 'hour.raw', []
    with path.open('wb') as file:
        file.write(HEADER.encode())
        for step in range(1, 72_001):
            stamp_ns = step * STEP_NS
            is_quiet = step // 400 % 3 == 1
            count = 0 if is_quiet else int(rng.integers(0, 4))
            t_ns = stamp_ns - np.sort(rng.integers(0, STEP_NS // 1000, count))[::-1] * 1000
            events = make_events(
                t_ns, *rng.integers(0, 128, (2, count)), rng.choice([-1, 1], count)
            )
            file.write(encode('evt3', events, stamp_ns, 128, 128).data)
            seen.append(events)
    return path, np.concatenate(seen)


def test_expelliarmus_reads_our_events(recording: tuple[Path, Events]) -> None:
    """Its times are too late by multiples of 4.096 ms (its issue 19), so modulo that."""
    expelliarmus = pytest.importorskip('expelliarmus')
    path, events = recording
    read = expelliarmus.Wizard(encoding='evt3').read(path)
    assert np.array_equal(read['x'], events['x'])
    assert np.array_equal(read['y'], events['y'])
    assert np.array_equal(read['p'] == 1, events['polarity'] == 1)
    assert np.array_equal(read['t'] % 4096, events['t'] // 1000 % 4096)


def test_faery_reads_our_events(recording: tuple[Path, Events]) -> None:
    """Times too, across the time coming round."""
    faery = pytest.importorskip('faery')
    path, events = recording
    read = faery.events_stream_from_file(path).to_array()
    assert np.array_equal(read['x'], events['x'])
    assert np.array_equal(read['y'], events['y'])
    assert np.array_equal(read['on'], events['polarity'] == 1)
    assert np.array_equal(read['t'], events['t'] // 1000)


def test_faery_reads_an_hour_of_our_packets(hour: tuple[Path, Events]) -> None:
    """It takes the time for come round only where TIME_HIGH goes from 4095 to 0."""
    faery = pytest.importorskip('faery')
    path, events = hour
    read = faery.events_stream_from_file(path).to_array()
    assert len(read) > 50_000
    assert np.array_equal(read['t'], events['t'] // 1000)
    assert np.array_equal(read['x'], events['x'])
    assert np.array_equal(read['on'], events['polarity'] == 1)


def test_our_decoder_reads_an_hour_of_our_packets_as_one(hour: tuple[Path, Events]) -> None:
    """As it does a camera's stream, cut anywhere."""
    path, events = hour
    data = path.read_bytes()[len(HEADER) :]
    decoder, read = Decoder(), []
    for begin in range(0, len(data), 1000):
        read.append(decoder.decode('evt3', data[begin : begin + 1000], 0, 0, 128, 128))
    assert np.array_equal(np.concatenate(read), events)
