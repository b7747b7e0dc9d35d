"""The compiled part of the `esim` pixels: where logarithmic intensities cross thresholds.

The single simulator and the kernel of a fleet call the same functions. What the model is and what
bounds it is said in `esim.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.compiled import inner
from spikelane_sim.events import EVENT_DTYPE, Events
from spikelane_sim.pixels.images import lowest_bit, WORD_PIXELS
from spikelane_sim.pixels.noise import draw_hot, draw_leak, draw_shot


class Constants(NamedTuple):
    """What all pixels have in common; see `EsimParameters`."""

    dark_intensity: float
    leak_rate_hz: float
    shot_rate_hz: float
    shot_bright_factor: float
    hot_rate_hz: float
    hot: NDArray[np.int64]  # the hot pixels, row * width + column, (M,)
    latency_us: int
    refractory_us: int
    width: int  # columns of the image [px]


class PixelArrays(NamedTuple):
    """What each pixel is and remembers; all of shape (height * width,)."""

    threshold_on: NDArray[np.float64]  # rise of L at which the pixel fires
    threshold_off: NDArray[np.float64]  # fall of L at which the pixel fires
    intensity: NDArray[np.float32]  # the last image
    log_intensity: NDArray[np.float64]  # L of the last image
    reference: NDArray[np.float64]  # L that the thresholds count from
    last_event_us: NDArray[np.int64]  # time of the last event, before latency


class Crossings(NamedTuple):
    """Threshold crossings of a step, in no order; arrays with room for more of them."""

    keys: NDArray[np.int64]  # t [us after the step's start] * pixels + pixel: sorts canonically
    polarity: NDArray[np.int8]


@inner
def _changed(image: NDArray[np.float32], before: NDArray[np.float32], pixels: int) -> np.uint64:
    """Return a word with bit i set where pixel i has changed, for at most 64 pixels."""
    word = np.uint64(0)
    for i in range(pixels):
        word |= np.uint64(image[i] != before[i]) << np.uint64(i)
    return word


@numba.njit(cache=True)
def cross_image(  # type: ignore[no-untyped-def]
    image, pixels, dark_intensity, from_us, to_us, crossings, count
):
    """Move pixels from the last image to this one, whatever room the crossings need.

    Returns:
        The crossings, in larger arrays where there was no more room, and how many there are.
    """
    while True:
        count, is_done = cross_thresholds(
            image, pixels, dark_intensity, from_us, to_us, crossings, count
        )
        if is_done:
            return crossings, count
        room = 2 * len(crossings.keys)
        larger = Crossings(np.empty(room, np.int64), np.empty(room, np.int8))
        larger.keys[:count] = crossings.keys[:count]
        larger.polarity[:count] = crossings.polarity[:count]
        crossings = larger


@inner
def cross_thresholds(
    image: NDArray[np.float32],
    pixels: PixelArrays,
    dark_intensity: float,
    from_us: float,
    to_us: float,
    crossings: Crossings,
    count: int,
) -> tuple[int, bool]:
    """Move pixels from the last image to this one and write down their crossings.

    Returns:
        How many crossings there are, and whether that is all. Where there is no more room, the
        pixels that did not get any are left as they were: called again, it goes on with them.
    """
    for start in range(0, image.size, WORD_PIXELS):
        seen, known = image[start:], pixels.intensity[start:]
        if seen.size >= WORD_PIXELS:  # a constant number is what makes it fast
            word = _changed(seen, known, WORD_PIXELS)
        else:
            word = _changed(seen, known, seen.size)
        while word != 0:
            pixel = start + lowest_bit(word)
            word &= word - np.uint64(1)
            after = _log_intensity(image[pixel], dark_intensity)
            added = _cross_at(pixel, pixels, after, from_us, to_us, crossings, count)
            if added < 0:
                return count, False
            count += added
            pixels.intensity[pixel] = image[pixel]
            pixels.log_intensity[pixel] = after
    return count, True


@inner
def _cross_at(
    pixel: int,
    pixels: PixelArrays,
    after: float,
    from_us: float,
    to_us: float,
    crossings: Crossings,
    count: int,
) -> int:
    """Write down one pixel's crossings on its way to L = after, move its reference.

    Returns:
        How many were written, or -1, and nothing done, where there is no room.
    """
    before = pixels.log_intensity[pixel]
    reference = pixels.reference[pixel]
    change = pixels.threshold_on[pixel] if after > before else -pixels.threshold_off[pixel]
    wanted = math.floor((after - reference) / change)
    most = max(1.0, math.floor(to_us - from_us))
    number = int(max(0.0, min(wanted, most)))
    if count + number > crossings.keys.size:
        return -1
    for i in range(number):
        share = (reference + (i + 1) * change - before) / (after - before)
        t_us = math.floor(from_us + share * (to_us - from_us) + 0.5)
        t_us = max(t_us, 1)  # after the step's start
        crossings.keys[count + i] = t_us * pixels.reference.size + pixel
        crossings.polarity[count + i] = 1 if change > 0 else -1
    pixels.reference[pixel] = after if wanted > most else reference + number * change
    return number


@inner
def _log_intensity(intensity: np.float32, dark_intensity: float) -> float:
    # Written so that not-a-number becomes 0.
    seen = min(np.float64(intensity), 1.0) if intensity > 0 else 0.0
    return math.log(seen + dark_intensity)


@numba.njit(cache=True)
def emit(  # type: ignore[no-untyped-def]
    constants, pixels, crossings, count, rng, noise_from_us, step_us, start_us
):
    """Return all events of a step in canonical order, noise included.

    Args:
        constants: The `Constants`.
        pixels: The `PixelArrays` after the last image of the step.
        crossings: The crossings of the step.
        count: How many there are.
        rng: Where noise comes from.
        noise_from_us: From when on there is noise, after the step's start [us].
        step_us: Duration of the step [us].
        start_us: Time of its start [us].
    """
    size, seen, until_us = pixels.reference.size, pixels.intensity, step_us
    rates = constants
    leak = draw_leak(rng, rates.leak_rate_hz, size, noise_from_us, until_us)
    shot = draw_shot(
        rng, rates.shot_rate_hz, rates.shot_bright_factor, seen, noise_from_us, until_us
    )
    hot = draw_hot(rng, rates.hot_rate_hz, rates.hot, noise_from_us, until_us)
    t_us = np.concatenate((leak.t_us, shot.t_us, hot.t_us))
    pixel = np.concatenate((leak.pixel, shot.pixel, hot.pixel))
    keys = np.concatenate((crossings.keys[:count], t_us * size + pixel))
    polarity = np.concatenate(
        (crossings.polarity[:count], leak.polarity, shot.polarity, hot.polarity)
    )
    order = np.argsort(keys, kind='mergesort')  # a stable order
    events = np.empty(len(keys), EVENT_DTYPE)
    number = _write_events(
        Crossings(keys[order], polarity[order]), pixels.last_event_us, start_us, constants, events
    )
    return events[:number]


@inner
def _write_events(  # type: ignore[no-untyped-def]
    crossings, last_event_us, start_us, constants, events
):
    """Write crossings as events, but those of pixels at rest; return how many."""
    pixels, width = last_event_us.size, constants.width
    number = 0
    for i in range(crossings.keys.size):
        pixel = crossings.keys[i] % pixels
        t_us = start_us + crossings.keys[i] // pixels
        if t_us - last_event_us[pixel] < constants.refractory_us:
            continue
        last_event_us[pixel] = t_us
        event = events[number]
        event['t'] = (t_us + constants.latency_us) * 1000
        event['x'] = pixel % width
        event['y'] = pixel // width
        event['polarity'] = crossings.polarity[i]
        number += 1
    return number


@numba.njit(cache=True)
def deliver(waiting: Events, events: Events, end_ns: int) -> tuple[Events, Events]:
    """Return the events up to end_ns, and the later ones, which wait.

    Args:
        waiting: Events that waited, older than all that are new by at least a microsecond.
        events: The new ones.
        end_ns: Time after the step [ns].
    """
    both = np.empty(len(waiting) + len(events), EVENT_DTYPE)
    due = 0
    for i in range(len(both)):
        both[i] = waiting[i] if i < len(waiting) else events[i - len(waiting)]
        due += both[i].t <= end_ns
    return both[:due].copy(), both[due:].copy()
