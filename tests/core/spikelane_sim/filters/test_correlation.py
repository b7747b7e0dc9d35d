"""Events with supporters pass, others do not."""

import numpy as np
import pytest

from spikelane_sim.errors import ParameterError
from spikelane_sim.events import Events, make_events
from spikelane_sim.filters.correlation import (
    CORRELATION,
    CorrelationParameters,
    NEAREST_NEIGHBOUR,
    NearestNeighbourParameters,
)

MS = 1_000_000


def test_an_event_passes_if_one_of_its_eight_neighbours_had_one_within_the_window() -> None:
    """Not its own pixel, not one two pixels away, not too long ago; the end counts."""
    made = NEAREST_NEIGHBOUR.make(NearestNeighbourParameters(window_s=0.01), 8, 6)
    steps = [
        (0, 3, 3, False),  # the first
        (1 * MS, 3, 3, False),  # its own pixel
        (2 * MS, 5, 3, False),  # two columns away
        (3 * MS, 4, 3, True),  # between both
        (20 * MS, 0, 0, False),
        (30 * MS, 1, 1, True),  # 10 ms later
        (40 * MS + 1, 2, 2, False),  # 10 ms and 1 ns later
    ]
    for t_ns, x, y, passes in steps:
        assert made.passes(make_events([t_ns], x, y, 1)).tolist() == [passes], t_ns


@pytest.mark.parametrize(('x', 'y'), [(0, 0), (7, 0), (0, 5), (7, 5), (3, 0), (0, 3)])
def test_a_pixel_at_the_edge_has_the_neighbours_that_there_are(x: int, y: int) -> None:
    """What is on the other side of the image is no neighbour."""
    for other_x in range(8):
        for other_y in range(6):
            made = NEAREST_NEIGHBOUR.make(NearestNeighbourParameters(), 8, 6)
            events = make_events([0, 1000], [other_x, x], [other_y, y], 1)
            is_near = max(abs(other_x - x), abs(other_y - y)) == 1
            assert made.passes(events).tolist() == [False, is_near]


def test_events_of_one_time_support_each_other_in_any_order() -> None:
    """A corner of three passes with two supporters each; a lone pair and a lone event do not."""
    made = CORRELATION.make(CorrelationParameters(window_s=0.0, supporters=2), 16, 16)
    x = np.array([4, 5, 4, 10, 11, 1])
    y = np.array([4, 4, 5, 10, 10, 14])
    expected = np.array([True, True, True, False, False, False])
    for order in ([0, 1, 2, 3, 4, 5], [5, 3, 1, 4, 0, 2], [2, 1, 0, 5, 4, 3]):
        made.reset()
        events = make_events(50 * MS, x[order], y[order], 1)
        assert made.passes(events).tolist() == expected[order].tolist()


def test_supporters_are_pixels_not_events() -> None:
    """A neighbour that fires twice supports once."""
    made = CORRELATION.make(CorrelationParameters(window_s=1.0, supporters=2), 8, 8)
    events = make_events([1, 2, 3, 4, 5], [3, 3, 4, 5, 4], [3, 3, 3, 3, 3], 1)
    assert made.passes(events).tolist() == [False, False, False, False, True]


def test_only_the_same_polarity_supports_if_asked_for() -> None:
    """ON supports ON, OFF supports OFF."""
    events = make_events([1, 2, 3, 4], [3, 4, 4, 3], 3, [1, -1, 1, -1])
    for same, expected in ((False, [False, True, True, True]), (True, [False, False, True, True])):
        parameters = CorrelationParameters(supporters=1, same_polarity=same)
        assert CORRELATION.make(parameters, 8, 8).passes(events).tolist() == expected


def test_the_reach_widens_what_is_around_an_event() -> None:
    """Three columns away supports with a reach of 3, not of 2."""
    events = make_events([1, 2], [3, 6], [3, 3], 1)
    for reach, passes in ((2, False), (3, True)):
        parameters = CorrelationParameters(supporters=1, reach_px=reach)
        assert CORRELATION.make(parameters, 8, 8).passes(events).tolist() == [False, passes]


@pytest.mark.parametrize('supporters', [1, 2, 3])
def test_it_agrees_with_a_search_through_all_earlier_events(
    random_events: Events, supporters: int
) -> None:
    """However the events are divided, as long as those of one time stay together."""
    window_ns = 5 * MS
    parameters = CorrelationParameters(window_s=0.005, supporters=supporters)
    expected = [
        len(
            {
                (int(other['x']), int(other['y']))
                for other in random_events
                if 0 <= event['t'] - other['t'] <= window_ns
                and max(abs(int(other[c]) - int(event[c])) for c in 'xy') == 1
            }
        )
        >= supporters
        for event in random_events
    ]
    assert 0 < sum(expected) < len(expected)
    whole = CORRELATION.make(parameters, 16, 12)
    assert whole.passes(random_events).tolist() == expected
    divided = CORRELATION.make(parameters, 16, 12)
    cuts = np.flatnonzero(np.diff(random_events['t']))[::7] + 1
    pieces = [divided.passes(piece) for piece in np.split(random_events, cuts)]
    assert np.concatenate(pieces).tolist() == expected


def test_more_supporters_than_there_are_pixels_around_are_refused() -> None:
    """The message says how many there are."""
    with pytest.raises(ParameterError, match=r'supporters: expected at most 8, .* got 9'):
        CorrelationParameters(supporters=9)


@pytest.fixture
def random_events() -> Events:
    """Return events on a small image, many of them at the same time."""
    rng = np.random.default_rng(3)
    t_ns = np.sort(rng.integers(0, 60, 500)) * MS
    x, y = rng.integers(0, 16, 500), rng.integers(0, 12, 500)
    return make_events(t_ns, x, y, 2 * rng.integers(0, 2, 500) - 1)
