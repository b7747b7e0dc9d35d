"""Pixels like those of a real sensor, after ESIM (Rebecq et al. 2018) and v2e.

A pixel follows L = ln(I + I_dark) and fires whenever L has moved from its reference by a contrast
threshold, several times per step if need be; each event moves the reference by that threshold.
L runs in a straight line from one image to the next, which gives the time of each crossing,
rounded to the nearest microsecond after the step's start.

- The thresholds are spread from pixel to pixel, drawn at each reset, at least 0.01.
- An event within the refractory period after the pixel's last one is lost, noise included, but
  the reference moves all the same, as in ESIM.
- Leak and shot noise events come on top and leave the references alone: a leak event is a
  reference that has drifted by one threshold and comes back by it.
- Hot pixels, always the same ones of a camera, fire at a rate of their own as well.
- Latency shifts all events; they come out in the step that holds their shifted time.

Bounds: intensities outside [0, 1] count as 0 or 1 and not-a-number as 0, so L has a range of
ln(1 + 1 / I_dark), which is 6.9 by default, and a pixel can fire at most that range over 0.01
times from image to image (690), nor more than once per microsecond of the time between them; what
a pixel loses by the second bound is lost for good, its reference catches up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.errors import SpikelaneError
from spikelane_sim.events import Events, no_events
from spikelane_sim.parameters import NEXT_EPISODE, NEXT_STEP, parameter, Parameters
from spikelane_sim.pixels.crossings import (
    Constants,
    cross_image,
    Crossings,
    deliver,
    emit,
    PixelArrays,
)
from spikelane_sim.pixels.images import check_images, check_times, no_reset

if TYPE_CHECKING:
    from spikelane_sim.pixels import PixelParameters

#: Smallest contrast threshold that the spread can give a pixel (ESIM).
LEAST_THRESHOLD = 0.01

_V2E = "v2e's EventEmulator (Hu, Liu, Delbruck 2021)"
_LONG_AGO_US = -(1 << 62)  # the last event of a pixel that had none


@dataclass(frozen=True, kw_only=True)
class EsimParameters(Parameters):
    """Parameters of the pixel model of a real sensor."""

    threshold_on: float = parameter(
        0.2,
        'Rise of ln(intensity) at which a pixel fires an ON event.',
        low=LEAST_THRESHOLD,
        high=10.0,
        source=_V2E,
    )
    threshold_off: float = parameter(
        0.2,
        'Fall of ln(intensity) at which a pixel fires an OFF event.',
        low=LEAST_THRESHOLD,
        high=10.0,
        source=_V2E,
    )
    threshold_spread: float = parameter(
        0.03,
        'Standard deviation of both thresholds from pixel to pixel.',
        low=0.0,
        high=1.0,
        source=_V2E,
        changes=NEXT_EPISODE,  # each episode draws the thresholds
    )
    dark_intensity: float = parameter(
        0.001,
        'Intensity that is added before the logarithm, where white is 1.',
        low=1e-6,
        high=1.0,
        source='ESIM (Rebecq et al. 2018), as implemented',
    )
    substeps: int = parameter(
        10, 'Number of images rendered in each simulation step.', low=1, high=1000
    )
    refractory_s: float = parameter(
        0.0, 'Time after an event in which its pixel stays silent.', unit='s', low=0.0, high=1.0
    )
    leak_rate_hz: float = parameter(
        0.1,
        'Rate of ON events that each pixel leaks.',
        unit='Hz',
        low=0.0,
        high=1e3,
        source=_V2E,
        changes=NEXT_STEP,
    )
    shot_rate_hz: float = parameter(
        0.0,
        'Rate of noise events of each pixel in the dark, ON and OFF together.',
        unit='Hz',
        low=0.0,
        high=1e3,
        source=_V2E,
        changes=NEXT_STEP,
    )
    shot_bright_factor: float = parameter(
        0.25,
        'Factor by which the rate of noise events is multiplied at intensity 1.',
        low=0.0,
        high=1.0,
        source=_V2E,
        changes=NEXT_STEP,
    )
    hot_share: float = parameter(
        0.0,
        'Share of the pixels that are hot: they fire whatever they see.',
        low=0.0,
        high=1.0,
        changes=NEXT_STEP,
    )
    hot_rate_hz: float = parameter(
        100.0,
        'Rate of events of a hot pixel, ON and OFF together.',
        unit='Hz',
        low=0.0,
        high=1e4,
        changes=NEXT_STEP,
    )
    hot_seed: int = parameter(
        0,
        'Seed that determines which pixels are hot; the same camera has the same hot pixels '
        'in all episodes.',
        low=0,
        high=2**63 - 1,
    )
    latency_s: float = parameter(
        0.0, 'Delay of all events behind the change of light.', unit='s', low=0.0, high=0.2
    )


class EsimPixels:
    """Pixels that fire whenever their logarithmic intensity has moved; a `PixelModel`.

    Attributes:
        pixels: What each pixel is and remembers.
        constants: What they have in common.
        pending: Events of times still to come, in canonical order.
        seen_until_ns: Time of the last image [ns], None before the first one.
    """

    def __init__(self, parameters: EsimParameters, width: int, height: int) -> None:
        self.parameters = parameters
        self.width = width
        self.height = height
        size = width * height
        self.pixels = make_pixels((size,))
        self.constants = esim_constants(parameters, width, height)
        self.pending: Events = no_events()
        self.seen_until_ns: int | None = None
        self._rng: np.random.Generator | None = None
        self._crossings = make_crossings(size)

    @property
    def images_per_step(self) -> int:
        """Images that `step` wants."""
        return self.parameters.substeps

    def adopt(self, parameters: PixelParameters) -> None:
        """Take over other rates and thresholds; see `PixelModel`."""
        self.parameters = parameters.esim
        self.constants = esim_constants(self.parameters, self.width, self.height)

    def reset(self, rng: np.random.Generator) -> None:
        """Forget everything and draw every pixel's thresholds; see `PixelModel`."""
        self._rng = rng
        for thresholds, mean in (
            (self.pixels.threshold_on, self.parameters.threshold_on),
            (self.pixels.threshold_off, self.parameters.threshold_off),
        ):
            drawn = rng.normal(mean, self.parameters.threshold_spread, len(thresholds))
            np.maximum(drawn, LEAST_THRESHOLD, out=thresholds)
        self.pixels.last_event_us[:] = _LONG_AGO_US
        self.pending = no_events()
        self.seen_until_ns = None

    def step(self, images: NDArray[np.float32], start_ns: int, end_ns: int) -> Events:
        """Return the events of one step; see `PixelModel`.

        Steps follow each other without a gap: each starts where the last one ended.
        """
        rng = self._check(images, start_ns, end_ns)
        step_us = (end_ns - start_ns) // 1000
        times_us = np.arange(1, len(images) + 1) * step_us / len(images)
        flat: NDArray[np.float32] = images.reshape(len(images), -1)
        seen_us = 0.0
        if self.seen_until_ns is None:
            self._see_first(flat[0])
            seen_us = float(times_us[0])
            flat, times_us = flat[1:], times_us[1:]
        noise_from_us = round(seen_us)
        count = 0
        for image, time_us in zip(flat, times_us.tolist(), strict=True):
            dark = self.parameters.dark_intensity
            self._crossings, count = cross_image(
                image, self.pixels, dark, seen_us, time_us, self._crossings, count
            )
            seen_us = time_us
        self.seen_until_ns = end_ns
        events: Events = emit(
            self.constants,
            self.pixels,
            self._crossings,
            count,
            rng,
            noise_from_us,
            step_us,
            start_ns // 1000,
        )
        if self.constants.latency_us:
            events, self.pending = deliver(self.pending, events, end_ns)
        return events

    def _check(
        self, images: NDArray[np.float32], start_ns: int, end_ns: int
    ) -> np.random.Generator:
        """Check the arguments of a step and return the generator its noise comes from."""
        is_first = self.seen_until_ns is None
        wanted = self.parameters.substeps
        numbers = (1, wanted) if is_first and wanted > 1 else (wanted,)
        check_images(images, numbers, self.height, self.width)
        check_times(start_ns, end_ns)
        if self._rng is None:
            raise no_reset()
        if not is_first and start_ns != self.seen_until_ns:
            raise SpikelaneError(
                f'step: expected to start where the last one ended, at {self.seen_until_ns} ns, '
                f'got {start_ns} ns'
            )
        return self._rng

    def _see_first(self, image: NDArray[np.float32]) -> None:
        self.pixels.intensity[:] = image
        seen = np.clip(np.nan_to_num(image.astype(np.float64)), 0.0, 1.0)
        self.pixels.log_intensity[:] = np.log(seen + self.parameters.dark_intensity)
        self.pixels.reference[:] = self.pixels.log_intensity


def esim_constants(parameters: EsimParameters, width: int, height: int) -> Constants:
    """Return what the pixels of a sensor of this size [px] have in common, as numbers."""
    chosen = np.random.default_rng(parameters.hot_seed).permutation(width * height)
    return Constants(
        dark_intensity=parameters.dark_intensity,
        leak_rate_hz=parameters.leak_rate_hz,
        shot_rate_hz=parameters.shot_rate_hz,
        shot_bright_factor=parameters.shot_bright_factor,
        hot_rate_hz=parameters.hot_rate_hz,
        hot=np.sort(chosen[: round(parameters.hot_share * width * height)]),
        latency_us=round(parameters.latency_s * 1e6),
        refractory_us=round(parameters.refractory_s * 1e6),
        width=width,
    )


def make_pixels(shape: tuple[int, ...]) -> PixelArrays:
    """Return arrays of 0 for pixels, each of this shape, whose last axis is the pixels."""
    return PixelArrays(
        threshold_on=np.zeros(shape),
        threshold_off=np.zeros(shape),
        intensity=np.zeros(shape, np.float32),
        log_intensity=np.zeros(shape),
        reference=np.zeros(shape),
        last_event_us=np.zeros(shape, np.int64),
    )


def make_crossings(pixels: int) -> Crossings:
    """Return room for the crossings of so many pixels, which grows where a step needs more."""
    room = max(2 * pixels, 4096)
    return Crossings(np.empty(room, np.int64), np.empty(room, np.int8))
