"""Images of counts from events made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from spikelane_sim.encoding import (
    count_events,
    EncodingParameters,
    StateImage,
    StateImageParameters,
)
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import Events, make_events, no_events

SPIKING = EncodingParameters()


def at(*pixels: tuple[int, int]) -> Events:
    """Make one event at each (column, row)."""
    x_px, y_px = np.array(pixels).T
    return make_events(0, x_px, y_px, 1)


def cells(counts: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> dict[tuple[int, int], int]:
    """Return the cells (row, column) that are not zero."""
    return {(int(r), int(c)): int(counts[r, c]) for r, c in zip(*np.nonzero(counts), strict=True)}


def test_the_image_of_the_spiking_controllers_has_four_rows_of_eight() -> None:
    """Row 0 is the top one."""
    assert count_events(no_events(), SPIKING).shape == (4, 8)


@pytest.mark.parametrize(
    ('pixel', 'cell'),
    [
        ((0, 40), (0, 0)),
        ((15, 55), (0, 0)),
        ((16, 55), (0, 1)),
        ((15, 56), (1, 0)),
        ((127, 40), (0, 7)),
        ((0, 103), (3, 0)),
        ((112, 88), (3, 7)),
        ((111, 87), (2, 6)),
        ((127, 103), (3, 7)),
        ((63, 71), (1, 3)),
        ((64, 72), (2, 4)),
    ],
)
def test_a_pixel_belongs_to_one_cell(pixel: tuple[int, int], cell: tuple[int, int]) -> None:
    """Cells of 16 x 16 pixels below row 40."""
    assert cells(count_events(at(pixel), SPIKING)) == {cell: 1}


@pytest.mark.parametrize('row', [0, 39, 104, 127])
def test_cropped_rows_are_not_counted(row: int) -> None:
    """40 rows at the top and 24 at the bottom."""
    assert not count_events(at((0, row), (127, row)), SPIKING).any()


@pytest.mark.parametrize('pixel', [(128, 50), (65_535, 50), (0, 65_535), (65_535, 65_535)])
def test_events_outside_the_sensor_are_not_counted(pixel: tuple[int, int]) -> None:
    """They do no harm either."""
    assert not count_events(at(pixel), SPIKING).any()


def test_both_polarities_and_repeated_events_count() -> None:
    """Three events of one pixel are three."""
    events = make_events([0, 1, 2], 20, 60, [1, -1, 1])
    assert cells(count_events(events, SPIKING)) == {(1, 1): 3}


def test_cells_that_do_not_fill_the_sensor_are_refused() -> None:
    """64 rows are left, which 10 does not divide."""
    with pytest.raises(ParameterError, match='fill the 128 x 64 px left after cropping, got 10'):
        EncodingParameters(cell=10)


def test_a_sensor_cropped_away_is_refused() -> None:
    """Nothing would be left."""
    with pytest.raises(ParameterError, match='128 x 0 px left'):
        EncodingParameters(crop_top=104)


def test_the_state_image_has_sixteen_rows_of_32_and_begins_empty() -> None:
    """Cells have 4 x 4 pixels; 10 rows of cells are cropped at the top, 6 at the bottom."""
    image = StateImage()
    assert image.counts.shape == (16, 32)
    assert not image.binary.any()
    image.add(at((0, 39), (0, 40), (3, 43), (4, 43), (127, 103), (127, 104)))
    assert cells(image.counts) == {(0, 0): 2, (0, 1): 1, (15, 31): 1}
    assert cells(image.binary.astype(np.int64)) == {(0, 0): 1, (0, 1): 1, (15, 31): 1}


def test_the_state_image_forgets_a_step_after_ten() -> None:
    """First in, first out."""
    image = StateImage()
    for step in range(10):
        image.add(at((4 * step, 40), (0, 100)))
    assert cells(image.counts) == {**{(0, step): 1 for step in range(10)}, (15, 0): 10}
    image.add(no_events())
    assert cells(image.counts) == {**{(0, step): 1 for step in range(1, 10)}, (15, 0): 9}


def test_a_cleared_state_image_is_empty() -> None:
    """As at the start of an episode."""
    image = StateImage(StateImageParameters(frames=2))
    image.add(at((0, 40)))
    image.clear()
    assert not image.counts.any()
    image.add(at((0, 40)))
    image.add(no_events())
    assert image.counts.sum() == 1
    image.add(no_events())
    assert image.counts.sum() == 0
