"""Pictures of events and weights."""

from __future__ import annotations

import numpy as np
import pytest

from spikelane.viewer.pictures import event_colours, FadingImage, in_colour, weights_picture
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.events import make_events, no_events


def test_on_is_blue_and_off_is_red() -> None:
    """By polarity, in the events' order."""
    events = make_events([1, 2], [0, 0], [0, 0], [1, -1])
    assert event_colours(events).tolist() == [[0, 64, 255], [255, 64, 0]]


def test_what_was_seen_fades() -> None:
    """Seven tenths are left in the next picture; what is seen anew is bright."""
    image = FadingImage()
    first = image.add(make_events([1], [2], [1], [1]), 4, 3)
    assert first.shape == (3, 4, 3)
    assert first[1, 2].tolist() == [0, 64, 255]
    assert np.count_nonzero(first) == 2
    second = image.add(make_events([2], [0], [0], [-1]), 4, 3)
    assert second[1, 2].tolist() == [0, 44, 178]
    assert second[0, 0].tolist() == [255, 64, 0]


def test_another_sensor_begins_with_black() -> None:
    """Nothing is left of the picture of the first."""
    image = FadingImage()
    image.add(make_events([1], [2], [1], [1]), 4, 3)
    assert not image.add(no_events(), 5, 6).any()


@pytest.mark.parametrize(
    ('shape', 'expected'),
    [((7,), (1, 7)), ((2, 5), (2, 5)), ((2, 32), (4, 17)), ((3, 2, 4), (2, 14))],
)
def test_weights_of_any_shape_are_laid_out(
    shape: tuple[int, ...], expected: tuple[int, int]
) -> None:
    """Every value is there once; the images of neurons stand side by side, one cell apart."""
    weights = np.arange(np.prod(shape), dtype=np.float32).reshape(shape)
    picture = weights_picture(weights)
    assert picture.shape == expected
    assert sorted(picture[~np.isnan(picture)].tolist()) == list(range(int(np.prod(shape))))


def test_the_weights_of_a_neuron_are_an_image_of_its_cells() -> None:
    """Four rows of eight; the second neuron's begin beyond the gap."""
    picture = weights_picture(np.arange(64.0).reshape(2, 32))
    assert picture[1, :8].tolist() == [8, 9, 10, 11, 12, 13, 14, 15]
    assert np.isnan(picture[:, 8]).all()
    assert picture[0, 9] == 32


def test_no_weights_are_refused() -> None:
    """There is nothing to show."""
    with pytest.raises(SpikelaneError, match=r'^weights: expected values, got none in shape \(0,'):
        weights_picture(np.zeros((0, 3)))


def test_colours_run_from_the_smallest_to_the_largest_value() -> None:
    """The ends of matplotlib's viridis; a gap is black, and equal values are no error."""
    colours = in_colour(np.array([[3.0, np.nan, 5.0]]))
    assert colours[0].tolist() == [[68, 1, 84], [0, 0, 0], [253, 231, 36]]
    assert in_colour(np.full((1, 2), 7.0))[0].tolist() == [[68, 1, 84]] * 2
