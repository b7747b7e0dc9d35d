"""The pixels of the paper's simulation: CoppeliaSim's pixel-change filter of its DVS128 model.

A pixel fires when its linear intensity I has changed by a tenth of its reference, |I - I_ref| >=
0.1 I_ref, and then takes I as its new reference. A reference of 0 counts as 0.001 on the right
side, so that black that stays black is silent. A pixel that does not fire keeps its reference:
slow changes add up. At most one event per pixel and step, all at the step's end; no refractory
period. Noise is ours, and off unless asked for. The comparison is made in float64, in which the
difference of two float32 intensities is exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.compiled import inner
from spikelane_sim.events import EVENT_DTYPE, Events, make_events, no_events
from spikelane_sim.parameters import NEXT_STEP, parameter, Parameters
from spikelane_sim.pixels.images import (
    check_images,
    check_times,
    lowest_bit,
    no_reset,
    WORD_PIXELS,
)
from spikelane_sim.pixels.noise import draw_shot

if TYPE_CHECKING:
    from spikelane_sim.pixels import PixelParameters

_SOURCE = "CoppeliaSim's DVS128 model, in the paper's scenes"


@dataclass(frozen=True, kw_only=True)
class CoppeliaParameters(Parameters):
    """Parameters of the pixel model of the paper's simulation."""

    threshold: float = parameter(
        0.1,
        'Change of linear intensity, relative to the reference, at which a pixel fires.',
        low=0.001,
        high=10.0,
        source=_SOURCE,
    )
    dark_intensity: float = parameter(
        0.001,
        'Intensity that stands for a reference of 0, where white is 1.',
        low=1e-6,
        high=1.0,
        source=_SOURCE,
    )
    noise_rate_hz: float = parameter(
        0.0,
        'Rate of noise events of each pixel, ON and OFF together; a pixel still fires at most '
        'once in a step.',
        unit='Hz',
        low=0.0,
        high=1e3,
        changes=NEXT_STEP,
    )


class CoppeliaPixels:
    """Pixels that fire at most once per step; a `PixelModel`.

    Attributes:
        reference: Intensity at each pixel's last event, (height * width,), float64.
        change: Difference from the reference at which the pixel fires, of the same shape.
        has_seen: Whether an image came since the last reset; None before the first reset.
    """

    images_per_step = 1

    def __init__(self, parameters: CoppeliaParameters, width: int, height: int) -> None:
        self.parameters = parameters
        self.width = width
        self.height = height
        self.reference = np.zeros(width * height)
        self.change = np.zeros(width * height)
        self.has_seen: bool | None = None
        self._rng: np.random.Generator | None = None
        self._fired = np.empty(width * height, EVENT_DTYPE)

    def adopt(self, parameters: PixelParameters) -> None:
        """Take over other parameters; see `PixelModel`."""
        self.parameters = parameters.coppelia

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the image; only noise is drawn from rng."""
        self._rng = rng
        self.reference[:] = 0.0
        self.change[:] = 0.0
        self.has_seen = False

    def step(self, images: NDArray[np.float32], start_ns: int, end_ns: int) -> Events:
        """Return one event, at end_ns, of each pixel that has changed enough; see `PixelModel`."""
        check_images(images, (1,), self.height, self.width)
        check_times(start_ns, end_ns)
        if self.has_seen is None:
            raise no_reset()
        intensity = images.reshape(-1)
        if not self.has_seen:
            self._see_first(intensity)
            return no_events()
        number = fire(
            intensity,
            self.reference,
            self.change,
            self.parameters.threshold,
            self.parameters.dark_intensity,
            end_ns,
            self.width,
            self._fired,
        )
        # NumPy copies packed records field by field; their bytes it copies at once.
        events = (
            self._fired.view(np.uint8)[: number * EVENT_DTYPE.itemsize].copy().view(EVENT_DTYPE)
        )
        if not self.parameters.noise_rate_hz:
            return events
        return self._with_noise(events, intensity, start_ns, end_ns)

    def _with_noise(
        self, events: Events, intensity: NDArray[np.float32], start_ns: int, end_ns: int
    ) -> Events:
        """Return the events and, of pixels that have none, noise; references do not move."""
        assert self._rng is not None  # `step` has seen to it
        step_us = (end_ns - start_ns) // 1000
        noise = draw_shot(self._rng, self.parameters.noise_rate_hz, 1.0, intensity, 0, step_us)
        fired = events['y'].astype(np.int64) * self.width + events['x']
        pixels, first = np.unique(noise.pixel, return_index=True)
        is_silent = ~np.isin(pixels, fired)
        y_px, x_px = np.divmod(pixels[is_silent], self.width)
        added = make_events(end_ns, x_px, y_px, noise.polarity[first[is_silent]])
        order = np.argsort(np.concatenate([fired, pixels[is_silent]]))
        return np.concatenate([events, added])[order]

    def _see_first(self, intensity: NDArray[np.float32]) -> None:
        self.reference[:] = intensity
        counted = np.where(self.reference == 0.0, self.parameters.dark_intensity, self.reference)
        self.change[:] = self.parameters.threshold * counted
        self.has_seen = True


@inner
def _changed(
    intensity: NDArray[np.float32],
    reference: NDArray[np.float64],
    change: NDArray[np.float64],
    pixels: int,
) -> np.uint64:
    """Return a word with bit i set where pixel i fires, for at most 64 pixels."""
    word = np.uint64(0)
    for i in range(pixels):
        fires = abs(np.float64(intensity[i]) - reference[i]) >= change[i]
        word |= np.uint64(fires) << np.uint64(i)
    return word


@numba.njit(cache=True)
def fire(
    intensity: NDArray[np.float32],
    reference: NDArray[np.float64],
    change: NDArray[np.float64],
    threshold: float,
    dark_intensity: float,
    t_ns: int,
    width: int,
    events: Events,
) -> int:
    """Write the events, row by row, move the references that fired, return how many."""
    number = row = row_start = 0
    for start in range(0, intensity.size, WORD_PIXELS):
        seen, known, needed = intensity[start:], reference[start:], change[start:]
        if seen.size >= WORD_PIXELS:  # a constant number is what makes it fast
            word = _changed(seen, known, needed, WORD_PIXELS)
        else:
            word = _changed(seen, known, needed, seen.size)
        while word != 0:
            pixel = start + lowest_bit(word)
            word &= word - np.uint64(1)
            while pixel - row_start >= width:  # dividing would cost more than all the rest
                row += 1
                row_start += width
            now = np.float64(intensity[pixel])
            event = events[number]
            event['t'] = t_ns
            event['x'] = pixel - row_start
            event['y'] = row
            event['polarity'] = 1 if now > reference[pixel] else -1
            number += 1
            reference[pixel] = now
            change[pixel] = threshold * (now if now != 0.0 else dark_intensity)
    return number
