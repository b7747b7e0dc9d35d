"""The filters against those of dv-processing, on the same events.

Both agree where no neighbours fire in the same microsecond. dv-processing wants a supporter to be
less than its duration ago, where ours may be as old as the window; its maps begin with time 0
instead of long ago; and where neighbours fire in the same microsecond only those that come first
support the others.
"""

from datetime import timedelta
from pathlib import Path

import dv_processing as dv
import numpy as np
from numpy.typing import NDArray
import pytest

from spikelane.bag.drive import RecordedDrive
from spikelane.bag.events import recorded_events
from spikelane_sim.events import Events, make_events
from spikelane_sim.filters.correlation import NEAREST_NEIGHBOUR, NearestNeighbourParameters
from spikelane_sim.filters.hot_pixels import (
    HOT_PIXELS,
    HotPixelParameters,
    HotPixels,
    write_hot_pixels,
)
from spikelane_sim.filters.refractory import REFRACTORY, RefractoryParameters

CAMERAS = Path(__file__).parents[5] / 'shared' / 'data' / 'real_cameras'
if not CAMERAS.is_dir():
    CAMERAS = Path('/work/shared/data/real_cameras')

#: dv-processing's maps begin with time 0: a time at which that is long ago [us].
_LATER_US = 10_000_000
US = 1000


def store_of(events: Events) -> dv.EventStore:
    """Return events as dv-processing has them, later by _LATER_US."""
    store = dv.EventStore()
    for t_ns, x, y, polarity in events.tolist():
        store.push_back(t_ns // US + _LATER_US, x, y, polarity > 0)
    return store


def passed(made: dv.EventFilterBase, store: dv.EventStore) -> Events:
    """Return the events that a filter of dv-processing lets pass."""
    made.accept(store)
    found = made.generateEvents()
    places = found.coordinates()
    t_ns = (found.timestamps() - _LATER_US) * US
    polarity = np.where(found.polarities(), 1, -1)
    return make_events(t_ns, places[:, 0], places[:, 1], polarity)


def background_filter(size: tuple[int, int], window_us: int) -> dv.EventFilterBase:
    """Return dv-processing's filter that lets pass what ours does with a window."""
    return dv.noise.BackgroundActivityNoiseFilter(size, timedelta(microseconds=window_us + 1))


def neighbours_pass(events: Events, size: tuple[int, int], window_us: int) -> NDArray[np.bool_]:
    """Return which events our filter lets pass."""
    parameters = NearestNeighbourParameters(window_s=window_us / 1e6)
    return NEAREST_NEIGHBOUR.make(parameters, *size).passes(events)


@pytest.fixture
def random_events() -> Events:
    """Return events at different times, some pixels of which are busier."""
    rng = np.random.default_rng(5)
    t_us = np.cumsum(rng.integers(1, 20, 30_000))
    x = np.minimum(rng.exponential(12, 30_000).astype(int), 63)
    return make_events(
        t_us * US, x, rng.integers(0, 48, 30_000), 2 * rng.integers(0, 2, 30_000) - 1
    )


@pytest.mark.parametrize('window_us', [50, 500, 2000])
def test_the_same_events_have_a_neighbour(random_events: Events, window_us: int) -> None:
    """One after the other, over the whole image with its edges."""
    ours = random_events[neighbours_pass(random_events, (64, 48), window_us)]
    theirs = passed(background_filter((64, 48), window_us), store_of(random_events))
    assert 0 < len(ours) < len(random_events)
    assert np.array_equal(ours, theirs)


@pytest.mark.parametrize('period_us', [100, 1000, 5000])
def test_the_same_events_are_late_enough(random_events: Events, period_us: int) -> None:
    """dv-processing calls it a low-pass filter and is given the frequency."""
    made = REFRACTORY.make(RefractoryParameters(period_s=period_us / 1e6), 64, 48)
    ours = random_events[made.passes(random_events)]
    theirs = passed(dv.noise.LowPassFilter((64, 48), 1e6 / period_us), store_of(random_events))
    assert 0 < len(ours) < len(random_events)
    assert np.array_equal(ours, theirs)


def test_the_same_pixels_are_masked(random_events: Events, tmp_path: Path) -> None:
    """With a mask of the same pixels."""
    pixels = np.array([[0, 0], [1, 17], [63, 47]])
    write_hot_pixels(tmp_path / 'hot.json', HotPixels(64, 48, pixels))
    made = HOT_PIXELS.make(HotPixelParameters(file=str(tmp_path / 'hot.json')), 64, 48)
    mask = np.full((48, 64), 255, np.uint8)
    mask[pixels[:, 1], pixels[:, 0]] = 0
    ours = random_events[made.passes(random_events)]
    theirs = passed(dv.EventMaskFilter(mask), store_of(random_events))
    assert 0 < len(ours) < len(random_events)
    assert np.array_equal(ours, theirs)


@pytest.mark.parametrize(
    ('name', 'size', 'count', 'ours', 'theirs'),
    [
        ('test_data_evt3_trigger', (1280, 720), 82_469, 3224, 3224),
        ('test_data_libcaer_rollover', (640, 480), 334_331, 36_528, 36_320),
    ],
)
def test_the_same_events_of_a_real_camera_have_a_neighbour(
    name: str, size: tuple[int, int], count: int, ours: int, theirs: int
) -> None:
    """Both saw hardly more than noise; ours lets more pass only where neighbours fire together."""
    events = read_recording(name)
    assert len(events) == count
    passes = neighbours_pass(events, size, 20_000)
    found = passed(background_filter(size, 20_000), store_of(events))
    assert (passes.sum(), len(found)) == (ours, theirs)
    together = neighbours_pass(events, size, 0)
    assert np.isin(events[passes & ~together], found).all()
    assert np.isin(found, events[passes]).all()
    # One after the other, in the order in which the sensor read them out.
    events['t'] = np.arange(len(events)) * US
    passes = neighbours_pass(events, size, 20_000)
    found = passed(background_filter(size, 20_000), store_of(events))
    assert 0 < passes.sum() < len(events)
    assert np.array_equal(events[passes], found)


def read_recording(name: str) -> Events:
    """Return the events of a recording, in the sensor's time from its first event on."""
    if not CAMERAS.is_dir():
        pytest.skip(f'no recordings of cameras at {CAMERAS}')
    events = recorded_events(RecordedDrive(CAMERAS / name)).events
    events['t'] -= events['t'][0]
    assert (np.diff(events['t']) >= 0).all()
    return events
