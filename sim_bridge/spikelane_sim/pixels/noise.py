"""Events that no light made: leak and shot noise of a sensor's pixels, and its hot pixels.

All pixels' noise of a step is drawn at once: a Poisson number for the whole sensor, each event
then put on any pixel at any time. That is the same as an independent Poisson process per pixel.
The functions are compiled, and draw the numbers that NumPy draws.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.compiled import inner


class NoiseEvents(NamedTuple):
    """Noise events of a step, in no order."""

    t_us: NDArray[np.int64]  # after the step's start [us]
    pixel: NDArray[np.int64]  # row * width + column
    polarity: NDArray[np.int8]  # +1 or -1


@inner
def draw_leak(
    rng: np.random.Generator, rate_hz: float, pixels: int, start_us: int, end_us: int
) -> NoiseEvents:
    """Draw leak events: ON events of a pixel's reference that drifts in the dark.

    Args:
        rng: Where the numbers come from.
        rate_hz: Rate of each pixel [1/s].
        pixels: Number of pixels.
        start_us: Start of the interval, itself excluded [us].
        end_us: End of the interval, included [us].
    """
    t_us, pixel = _draw(rng, rate_hz, pixels, start_us, end_us)
    return NoiseEvents(t_us, pixel, np.ones(len(t_us), np.int8))


@numba.njit(cache=True)
def draw_shot(
    rng: np.random.Generator,
    rate_hz: float,
    bright_factor: float,
    intensity: NDArray[np.float32],
    start_us: int,
    end_us: int,
) -> NoiseEvents:
    """Draw shot noise events, ON as often as OFF.

    The rate falls linearly with the intensity, as in v2e (Hu, Liu, Delbruck 2021).

    Args:
        rng: Where the numbers come from.
        rate_hz: Rate of each pixel in the dark, ON and OFF together [1/s].
        bright_factor: What the rate is multiplied by at intensity 1.
        intensity: What the pixels see, (pixels,).
        start_us: Start of the interval, itself excluded [us].
        end_us: End of the interval, included [us].
    """
    t_us, pixel = _draw(rng, rate_hz, intensity.size, start_us, end_us)
    polarity = (2 * rng.integers(0, 2, len(t_us)) - 1).astype(np.int8)
    drawn = rng.random(len(t_us))
    # Drawn at the rate in the dark, thinned where it is brighter; all shares are float32.
    slope = np.float32(bright_factor - 1.0)
    number = 0
    for i in range(len(t_us)):
        seen = intensity[pixel[i]]
        if seen < 0.0:
            seen = np.float32(0.0)
        elif seen > 1.0:
            seen = np.float32(1.0)
        if drawn[i] < np.float32(1.0) + slope * seen:
            t_us[number], pixel[number], polarity[number] = t_us[i], pixel[i], polarity[i]
            number += 1
    return NoiseEvents(t_us[:number], pixel[:number], polarity[:number])


@inner
def draw_hot(
    rng: np.random.Generator,
    rate_hz: float,
    hot: NDArray[np.int64],
    start_us: int,
    end_us: int,
) -> NoiseEvents:
    """Draw the events of hot pixels, ON as often as OFF.

    Args:
        rng: Where the numbers come from; nothing is drawn where no pixel is hot.
        rate_hz: Rate of each hot pixel, ON and OFF together [1/s].
        hot: The hot pixels, row * width + column, (M,).
        start_us: Start of the interval, itself excluded [us].
        end_us: End of the interval, included [us].
    """
    if len(hot) == 0:
        return NoiseEvents(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.int8))
    t_us, which = _draw(rng, rate_hz, len(hot), start_us, end_us)
    polarity = (2 * rng.integers(0, 2, len(t_us)) - 1).astype(np.int8)
    return NoiseEvents(t_us, hot[which], polarity)


@inner
def _draw(
    rng: np.random.Generator, rate_hz: float, pixels: int, start_us: int, end_us: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    number = rng.poisson(rate_hz * pixels * (end_us - start_us) * 1e-6)
    if number == 0:  # also where the interval is empty and has no times to draw from
        return np.empty(0, np.int64), np.empty(0, np.int64)
    t_us = rng.integers(start_us, end_us, number) + 1
    return t_us, rng.integers(0, pixels, number)
