"""Images as bit planes, where a camera sees no more than three intensities.

Without anti-aliasing a pixel is background, floor or marking. Two bits say which: one whether the
floor is there, one whether a marking is. A row of 128 pixels is two words in each plane instead of
512 bytes, and what has changed is found 64 pixels at a time by an exclusive or.

Pixels of the paper's simulation (`pixels.coppelia`) fire whenever the intensity has moved far
enough from its reference. Where every change from one intensity to another is far enough, the
reference is the last intensity seen, and an image in this form is all that a pixel remembers.
`fires_always` says whether that holds. Images and events are the same as those of `Camera` and
`CoppeliaPixels`.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim import raster
from spikelane_sim.compiled import uncounted
from spikelane_sim.events import Events
from spikelane_sim.kernel_arrays import stack_array
from spikelane_sim.pixels.images import lowest_bit

#: Planes of an image, (2, height, words): where the floor is seen, and where a marking is.
FLOOR, MARKING = 0, 1
Planes = NDArray[np.uint64]

_BITS = 64
_ALL = np.uint64(0xFFFFFFFFFFFFFFFF)


def words_of(width: int) -> int:
    """Return how many words a row of pixels takes."""
    return -(-width // _BITS)


def fires_always(
    background: float, floor: float, marking: float, threshold: float, dark_intensity: float
) -> bool:
    """Return whether every change between these intensities makes a pixel fire.

    Args:
        background: Linear intensity, from 0 to 1.
        floor: The same.
        marking: The same.
        threshold: That of `CoppeliaParameters`.
        dark_intensity: That of `CoppeliaParameters`.
    """
    # The camera's images are float32, the comparison is float64.
    values = [float(np.float32(each)) for each in (background, floor, marking)]
    return all(
        abs(now - before) >= threshold * (before or dark_intensity)
        for before in values
        for now in values
        if now != before
    )


def unpack(planes: Planes, width: int, intensities: tuple[float, float, float]) -> raster.Image:
    """Return the image that planes stand for, (height, width).

    Args:
        planes: Bit planes of one image, (2, height, words).
        width: Columns of the image [px].
        intensities: Intensities of background, floor and marking.
    """
    bits = np.unpackbits(planes.view(np.uint8), axis=-1, bitorder='little')[..., :width]
    background, floor, marking = (np.float32(each) for each in intensities)
    image: raster.Image = np.where(
        bits[MARKING], marking, np.where(bits[FLOOR], floor, background)
    )
    return image


@numba.njit(cache=True, error_model='numpy')
def render_planes(  # type: ignore[no-untyped-def]
    pieces, has_floor, lens, pose, width, planes
):
    """Do what `raster.render` does, into bit planes; return False for a pose that is not finite.

    Args:
        pieces: As there.
        has_floor: Whether the floor differs from the background.
        lens: As there.
        pose: As there.
        width: Columns of the image [px].
        planes: Are overwritten, (2, height, words).
    """
    planes[:] = 0
    height = planes.shape[1]
    view, ground = stack_array((4, 3), np.float64), stack_array((3, 3), np.float64)
    raster.find_view(lens, pose, view)
    if not np.isfinite(np.sum(view)):
        return False
    if view[raster.EYE, 2] <= 0.0:
        return True
    raster.find_homography(lens, view, ground)
    scan = raster.empty_scan()
    if has_floor:
        raster.clip_depth(scan, ground, lens)
        _draw(scan, 0, height, width, planes[FLOOR])
    found = stack_array((128,), np.int64)
    for begin in range(0, len(pieces), len(found)):
        some = pieces[begin : begin + len(found)]
        for i in found[: raster.find_pieces(some, view, lens, width, found)]:
            first, last = raster.rows_of(some[i], view, lens, height, width)
            if first < last:
                raster.clip_depth(scan, ground, lens)
                raster.clip_piece(scan, ground, some[i])
                _draw(scan, first, last, width, planes[MARKING])
    return True


@uncounted(error_model='numpy')
def _draw(scan, first, last, width, plane):  # type: ignore[no-untyped-def]
    """Set the bits of pixels whose centres a scan covers, in rows first to last."""
    spans = stack_array((2, 128), np.float64)
    rows = spans.shape[1]
    for top in range(first, last, rows):
        _draw_rows(scan, top, min(top + rows, last), width, spans, plane)


@uncounted(error_model='numpy')
def _draw_rows(scan, first, last, width, spans, plane):  # type: ignore[no-untyped-def]
    """Set these bits in rows first to last, at most as many as `spans`, (2, n), has room for.

    Each bound is applied to all rows in turn, so that the compiler can use vector instructions.
    """
    begin, end = spans[0], spans[1]  # of row first + k
    number = last - first
    begin[:number] = 0.0
    end[:number] = width
    for i in range(scan.n[0]):
        slope, intercept = scan.lower[i, 0], scan.lower[i, 1]
        for k in range(number):
            begin[k] = max(begin[k], slope * (first + k + 0.5) + intercept)
    for i in range(scan.n[1]):
        slope, intercept = scan.upper[i, 0], scan.upper[i, 1]
        for k in range(number):
            end[k] = min(end[k], slope * (first + k + 0.5) + intercept)
    if scan.squared[1] == 0.0:
        for k in range(number):
            _fill(plane, first + k, begin[k], end[k])
        return
    for k in range(number):
        if not begin[k] < end[k]:
            continue
        v = first + k + 0.5
        low, high = raster.within_circle(scan, v, scan.squared[1])
        left, right = max(begin[k], low), min(end[k], high)
        low, high = raster.within_circle(scan, v, scan.squared[0])
        _fill(plane, first + k, left, min(right, low))
        _fill(plane, first + k, max(left, high, low), right)


@uncounted(error_model='numpy')
def _fill(plane, row, begin, end):  # type: ignore[no-untyped-def]
    """Set the bits of the pixels whose centres lie from begin to end [px]."""
    if not begin < end:
        return
    first, last = math.ceil(begin - 0.5), math.ceil(end - 0.5)
    if first >= last:
        return
    left, right = first // _BITS, (last - 1) // _BITS
    from_first = _ALL << np.uint64(first % _BITS)
    to_last = _ALL >> np.uint64(_BITS - 1 - (last - 1) % _BITS)
    if left == right:
        plane[row, left] |= from_first & to_last
        return
    plane[row, left] |= from_first
    for word in range(left + 1, right):
        plane[row, word] = _ALL
    plane[row, right] |= to_last


@numba.njit(cache=True)
def fire_planes(  # type: ignore[no-untyped-def]
    before: Planes, now: Planes, intensities, t_ns: int, events: Events
) -> int:
    """Write the events of pixels that have changed, row by row, and return how many.

    Args:
        before: The last image, (2, height, words).
        now: This image; `before` becomes it.
        intensities: Intensities of background, floor and marking, (3,).
        t_ns: Time of the events.
        events: Room for one event of each pixel.
    """
    number = 0
    for row in range(now.shape[1]):
        for column in range(now.shape[2]):
            floor, marking = now[FLOOR, row, column], now[MARKING, row, column]
            old_floor, old_marking = before[FLOOR, row, column], before[MARKING, row, column]
            changed = (floor ^ old_floor) | (marking ^ old_marking)
            while changed != 0:
                bit = lowest_bit(changed)
                changed &= changed - np.uint64(1)
                seen = intensities[_level(floor, marking, bit)]
                known = intensities[_level(old_floor, old_marking, bit)]
                if seen == known:
                    continue
                event = events[number]
                event['t'] = t_ns
                event['x'] = column * _BITS + bit
                event['y'] = row
                event['polarity'] = 1 if seen > known else -1
                number += 1
            before[FLOOR, row, column], before[MARKING, row, column] = floor, marking
    return number


@uncounted
def _level(floor, marking, bit):  # type: ignore[no-untyped-def]
    """Return which intensity a pixel has: 0 background, 1 floor, 2 marking."""
    shift = np.uint64(bit)
    if (marking >> shift) & np.uint64(1):
        return 2
    return 1 if (floor >> shift) & np.uint64(1) else 0
