"""Pixels that fire by themselves: found in a recording, saved in a file, masked.

A pixel is hot if it fires at least at some rate, and many times as often as all but two of the
24 pixels around it: what moves through the image makes several neighbours fire as often, and no
more than three hot pixels are side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.events import Events
from spikelane_sim.files import write_json
from spikelane_sim.filters.kind import CompiledFilter, FilterKind, MASK, Passes
from spikelane_sim.kinds import check_kind
from spikelane_sim.parameters import parameter, Parameters
from spikelane_sim.parsing import read_json_file

FORMAT = 'spikelane-hot-pixels'
VERSION = 1


class HotPixelsError(ParameterError):
    """A file of hot pixels cannot be used."""


class HotPixels(NamedTuple):
    """The hot pixels of one camera."""

    width: int  # columns of its image [px]
    height: int  # rows of its image [px]
    pixels: NDArray[np.int64]  # column and row of each, in the order of rows, (N, 2)


@dataclass(frozen=True, kw_only=True)
class HotPixelSearchParameters(Parameters):
    """What makes a pixel a hot one."""

    least_rate_hz: float = parameter(
        5.0, 'Smallest rate of events at which a pixel can be hot.', unit='Hz', low=0.0, high=1e6
    )
    ratio: float = parameter(
        10.0,
        'A hot pixel has at least this many times as many events as each of the 24 pixels '
        'around it, except for two of them.',
        low=1.0,
        high=1e6,
    )
    least_events: int = parameter(
        10,
        'Smallest number of events at which a pixel can be hot; fewer events say nothing.',
        low=1,
        high=10**9,
    )


@dataclass(frozen=True, kw_only=True)
class HotPixelParameters(Parameters):
    """The mask of hot pixels."""

    file: str = parameter('', 'File of the hot pixels, as `spikelane mask` writes it; required.')


def find_hot_pixels(
    counts: NDArray[np.int64], duration_s: float, parameters: HotPixelSearchParameters
) -> HotPixels:
    """Find the hot pixels of a recording.

    Args:
        counts: Events of each pixel, (H, W).
        duration_s: How long the recording is [s], > 0.
        parameters: What makes a pixel a hot one.
    """
    from scipy.ndimage import rank_filter

    around = np.ones((5, 5), bool)
    around[2, 2] = False
    third = rank_filter(counts, -3, footprint=around, mode='constant', cval=0)
    least = max(parameters.least_rate_hz * duration_s, parameters.least_events)
    y_px, x_px = np.nonzero((counts >= least) & (counts >= parameters.ratio * third))
    height, width = counts.shape
    return HotPixels(width, height, np.stack([x_px, y_px], axis=1).astype(np.int64))


def count_pixels(events: Events, width: int, height: int) -> NDArray[np.int64]:
    """Return how many events inside an image each of its pixels has, (H, W)."""
    pixels = events['y'].astype(np.int64) * width + events['x']
    counts = np.bincount(pixels, minlength=width * height).astype(np.int64)
    return counts.reshape(height, width)


def write_hot_pixels(path: Path, found: HotPixels) -> None:
    """Write a file of hot pixels, in JSON.

    Raises:
        FileError: It cannot be written.
    """
    head = {'format': FORMAT, 'version': VERSION, 'width': found.width, 'height': found.height}
    write_json(path, head | {'pixels': found.pixels.tolist()})


class _Content(TypedDict):
    """What a file holds."""

    format: str
    version: int
    width: int
    height: int
    pixels: list[list[int]]


def read_hot_pixels(path: Path) -> HotPixels:
    """Read a file of hot pixels.

    Raises:
        HotPixelsError: It cannot be read, or is something else.
    """
    try:
        content: Any = check_kind(read_json_file(path), _Content)
    except SpikelaneError as error:
        raise HotPixelsError(f'{path}: {error}') from None
    for name, expected in (('format', FORMAT), ('version', VERSION)):
        if content[name] != expected:
            raise HotPixelsError(f'{path}: {name}: expected {expected}, got {content[name]!r:.80}')
    width, height = content['width'], content['height']
    for number, pixel in enumerate(content['pixels']):
        if len(pixel) != 2 or not (0 <= pixel[0] < width and 0 <= pixel[1] < height):
            raise HotPixelsError(
                f'{path}: pixels[{number}]: expected column and row inside {width} x {height} '
                f'px, got {pixel!r:.80}'
            )
    return HotPixels(width, height, np.array(content['pixels'], np.int64).reshape(-1, 2))


class HotPixelFilter:
    """Lets the events of all but the hot pixels pass; an `EventFilter`."""

    def __init__(self, parameters: HotPixelParameters, width: int, height: int) -> None:
        """Read the mask.

        Args:
            parameters: Where it is.
            width: Columns of the image [px].
            height: Rows of the image [px].

        Raises:
            SpikelaneError: There is no such mask, or it is of a camera of another size.
        """
        if not parameters.file:
            raise ParameterError(
                "filter.hot_pixels.file: expected the path of a file of hot pixels, got ''"
            )
        found = read_hot_pixels(Path(parameters.file))
        if (found.width, found.height) != (width, height):
            raise HotPixelsError(
                f'{parameters.file}: expected the hot pixels of a camera of {width} x {height} '
                f'px, got those of one of {found.width} x {found.height} px'
            )
        self._is_kept = np.ones((height, width), np.int64)
        self._is_kept[found.pixels[:, 1], found.pixels[:, 0]] = 0

    def reset(self) -> None:
        """Hot pixels stay hot."""

    def compiled(self) -> CompiledFilter:
        """Return it for the kernel of a fleet."""
        return CompiledFilter(MASK, (0, 0, 0), self._is_kept[None])

    def passes(self, events: Events) -> Passes:
        """Return which events are of other pixels; see `EventFilter`."""
        found = np.empty(len(events), np.bool_)
        find_kept(events, self._is_kept, found)
        return found


@numba.njit(cache=True)
def find_kept(events: Events, is_kept: NDArray[np.int64], found: Passes) -> None:
    """Write which events are of pixels that are kept, which are 1."""
    for number in range(len(events)):
        found[number] = is_kept[events[number].y, events[number].x] != 0


HOT_PIXELS = FilterKind(HotPixelFilter, HotPixelParameters, is_compiled=True)
