"""Hot pixels are found, saved and masked."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spikelane_sim.errors import ParameterError
from spikelane_sim.events import make_events
from spikelane_sim.filters.hot_pixels import (
    count_pixels,
    find_hot_pixels,
    HOT_PIXELS,
    HotPixelParameters,
    HotPixelSearchParameters,
    HotPixelsError,
    read_hot_pixels,
    write_hot_pixels,
)


def test_hot_pixels_are_those_that_fire_far_more_than_their_neighbours() -> None:
    """Not all of a busy part of the image; also two side by side, and one in a corner."""
    rng = np.random.default_rng(1)
    counts = rng.poisson(0.5, (48, 64))
    counts[10:30, 20:40] = rng.poisson(400, (20, 20))  # an edge that swings to and fro
    hot = [(0, 0), (63, 47), (5, 40), (6, 40), (30, 20)]
    for x, y in hot:
        counts[y, x] = 5000 if (x, y) == (30, 20) else 60
    found = find_hot_pixels(counts, 10.0, HotPixelSearchParameters())
    assert (found.width, found.height) == (64, 48)
    assert sorted(map(tuple, found.pixels.tolist())) == sorted(hot)


def test_a_short_recording_has_no_hot_pixels() -> None:
    """A few events say nothing."""
    counts = np.zeros((8, 8), np.int64)
    counts[3, 3] = 9
    assert len(find_hot_pixels(counts, 0.01, HotPixelSearchParameters()).pixels) == 0


def test_the_events_of_hot_pixels_do_not_pass(tmp_path: Path) -> None:
    """Found, saved, read and applied."""
    events = make_events(np.arange(102), [7] * 100 + [2] * 2, [2] * 100 + [5] * 2, 1)
    counts = count_pixels(events, 8, 6)
    assert (counts[2, 7], counts[5, 2], counts.sum()) == (100, 2, 102)
    file = tmp_path / 'hot.json'
    write_hot_pixels(file, find_hot_pixels(counts, 1.0, HotPixelSearchParameters()))
    assert read_hot_pixels(file).pixels.tolist() == [[7, 2]]
    made = HOT_PIXELS.make(HotPixelParameters(file=str(file)), 8, 6)
    events = make_events([1, 2, 3], [7, 2, 7], [2, 5, 3], 1)
    assert made.passes(events).tolist() == [False, True, True]


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        ({'format': 'another'}, 'format: expected spikelane-hot-pixels'),
        ({'version': 2}, 'version: expected 1, got 2'),
        ({'pixels': [[8, 0]]}, r'pixels\[0\]: expected column and row inside 8 x 6 px'),
        ({'pixels': [[0, -1]]}, r'pixels\[0\]: expected column and row inside'),
        ({'pixels': [[0, 1], [1]]}, r'pixels\[1\]: expected column and row inside'),
        ({'pixels': 'none'}, 'pixels: expected a list'),
        ({'width': 9}, r'expected the hot pixels of a camera of 8 x 6 px, got .* 9 x 6 px'),
    ],
)
def test_a_file_that_is_no_mask_is_refused(
    tmp_path: Path, change: dict[str, Any], reason: str
) -> None:
    """One sentence names the file and what is wrong."""
    file = tmp_path / 'hot.json'
    head = {'format': 'spikelane-hot-pixels', 'version': 1, 'width': 8, 'height': 6, 'pixels': []}
    file.write_text(json.dumps(head))
    HOT_PIXELS.make(HotPixelParameters(file=str(file)), 8, 6)
    file.write_text(json.dumps(head | change))
    with pytest.raises(HotPixelsError, match=f'hot.json: .*{reason}'):
        HOT_PIXELS.make(HotPixelParameters(file=str(file)), 8, 6)


def test_the_mask_needs_a_file(tmp_path: Path) -> None:
    """None given, or one that is not there."""
    with pytest.raises(ParameterError, match=r'filter.hot_pixels.file: expected the path'):
        HOT_PIXELS.make(HotPixelParameters(), 8, 6)
    with pytest.raises(HotPixelsError, match=r'none.json: .*[Nn]o such file'):
        HOT_PIXELS.make(HotPixelParameters(file=str(tmp_path / 'none.json')), 8, 6)
