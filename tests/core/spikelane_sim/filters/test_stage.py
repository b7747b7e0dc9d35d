"""The stage of filters: their order, when they forget, and what is counted."""

import copy
from pathlib import Path
import pickle

import numpy as np
import pytest

from spikelane_sim.contract import LaneState, Observation
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import Events, make_events
from spikelane_sim.filters import FilterParameters, FilterStage
from spikelane_sim.filters.hot_pixels import HotPixels, write_hot_pixels

MS = 1_000_000


def stage(chain: str, **parameters: object) -> FilterStage:
    """Return filters of a small image."""
    return FilterStage(FilterParameters.from_mapping({'chain': chain, **parameters}), 16, 12)


def lane(episode: int, step: int) -> LaneState:
    """Return where an episode stands."""
    return LaneState('outer', 0.0, 0.0, 0.0, 'A', 0.0, 0, episode, step, False, '')


def test_by_default_all_events_pass() -> None:
    """They are the very same ones."""
    events = make_events([3, 2, 1], 3, 4, 1)
    made = FilterStage(FilterParameters(), 16, 12)
    assert made.filter(events) is events
    assert (made.events_in, made.events_out) == (3, 3)


def test_filters_see_what_those_before_let_pass(tmp_path: Path) -> None:
    """A masked pixel supports nobody behind the mask, but does so in front of it."""
    file = tmp_path / 'hot.json'
    write_hot_pixels(file, HotPixels(16, 12, np.array([[4, 4]])))
    events = make_events([1, 2, 3], [4, 5, 9], [4, 4, 9], 1)
    found = {}
    for chain in ('hot_pixels,nearest_neighbour', 'nearest_neighbour, hot_pixels'):
        made = stage(chain, **{'hot_pixels.file': str(file)})
        found[chain] = made.filter(events)['x'].tolist()
        assert made.events_in == 3
        assert made.events_out == len(found[chain])
    assert list(found.values()) == [[], [5]]


@pytest.mark.parametrize(
    ('first', 'second', 'passes'),
    [
        (lane(1, 3), lane(1, 4), True),
        (lane(1, 3), lane(1, 3), True),  # time alone was reset
        (lane(1, 3), lane(2, 0), False),
        (lane(1, 3), lane(2, 7), False),
        (lane(1, 3), lane(1, 0), False),
        (lane(1, 3), lane(1, 2), False),
    ],
)
def test_an_episode_begins_without_events(
    first: LaneState, second: LaneState, passes: bool
) -> None:
    """What was seen in the one before supports nothing."""
    made = stage('nearest_neighbour')
    made.observe(Observation(50 * MS, make_events(50 * MS, [3], 3, 1), first))
    seen = made.observe(Observation(100 * MS, make_events(100 * MS, [4], 3, 1), second))
    assert len(seen.events) == passes
    assert (seen.stamp_ns, seen.lane) == (100 * MS, second)


def test_time_that_goes_back_makes_the_filters_forget() -> None:
    """As after a reset of time alone."""
    made = stage('refractory', **{'refractory.period_s': 1.0})
    assert len(made.filter(make_events([500 * MS], 3, 3, 1))) == 1
    assert len(made.filter(make_events([600 * MS], 3, 3, 1))) == 0
    assert len(made.filter(make_events([100 * MS], 3, 3, 1))) == 1


def test_a_copy_goes_on_as_the_original_does() -> None:
    """Deep copies and pickles, in the middle of an episode."""
    rng = np.random.default_rng(7)
    chain = 'refractory,correlation'
    made = stage(chain, **{'refractory.period_s': 0.02, 'correlation.window_s': 0.01})
    made.filter(steps(rng, 0))
    copies = [copy.deepcopy(made), pickle.loads(pickle.dumps(made))]  # noqa: S301
    later = steps(rng, 100 * MS)
    expected = made.filter(later)
    assert 0 < len(expected) < len(later)
    for each in copies:
        assert np.array_equal(each.filter(later), expected)


def steps(rng: np.random.Generator, start_ns: int) -> Events:
    """Return events of 100 ms."""
    t_ns = start_ns + np.sort(rng.integers(0, 100, 300)) * MS
    return make_events(t_ns, rng.integers(0, 16, 300), rng.integers(0, 12, 300), 1)


@pytest.mark.parametrize(
    ('chain', 'reason'),
    [
        ('median', "filter.chain: expected one of .*correlation.*, got 'median'"),
        ('correlation,', "filter.chain: expected one of .*, got ''"),
        ('correlation,correlation', 'chain: expected each filter once'),
    ],
)
def test_a_chain_that_cannot_be_is_refused(chain: str, reason: str) -> None:
    """With the names there are."""
    with pytest.raises(ParameterError, match=reason):
        FilterParameters(chain=chain)


def test_an_image_that_is_too_large_to_be_filtered_is_refused() -> None:
    """Before any memory is taken; without filters there is nothing to take."""
    FilterStage(FilterParameters(), 65_535, 65_535)
    with pytest.raises(ParameterError, match='pixels whose events are filtered'):
        FilterStage(FilterParameters(chain='refractory'), 65_535, 65_535)
