"""The pixels of the event camera: from images of light to events.

Two models, after one protocol: `coppelia`, the sensor of the paper's simulation, and `esim`, one
closer to a real sensor. In both, brighter is ON (+1).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.errors import ParameterError
from spikelane_sim.events import Events
from spikelane_sim.parameters import check_size, nested, parameter, Parameters
from spikelane_sim.pixels.coppelia import CoppeliaParameters, CoppeliaPixels
from spikelane_sim.pixels.esim import EsimParameters, EsimPixels

__all__ = [
    'CoppeliaParameters',
    'CoppeliaPixels',
    'EsimParameters',
    'EsimPixels',
    'PixelModel',
    'PixelParameters',
    'make_pixel_model',
]

_LARGEST_SIDE_PX = 65535  # coordinates of events are 16 bits wide


@dataclass(frozen=True, kw_only=True)
class PixelParameters(Parameters):
    """Which pixel model the event camera has, and the parameters of each."""

    model: str = parameter(
        'coppelia',
        "Pixel model: the one of the paper's simulation (coppelia), or one like a real sensor "
        '(esim).',
        choices=('coppelia', 'esim'),
        source='paper section 3.2',
    )
    dead_share: float = parameter(
        0.0, 'Share of the pixels that are dead: they give no events.', low=0.0, high=1.0
    )
    dead_seed: int = parameter(
        0,
        'Seed that determines which pixels are dead; they are the same in all episodes.',
        low=0,
        high=2**63 - 1,
    )
    coppelia: CoppeliaParameters = nested(CoppeliaParameters)
    esim: EsimParameters = nested(EsimParameters)

    @property
    def images_per_step(self) -> int:
        """Images that are rendered for a step."""
        return self.esim.substeps if self.model == 'esim' else 1

    def check_sizes(self, size: Mapping[str, float]) -> None:
        """Check that the events of a step cannot fill the memory.

        Args:
            size: Width and height of the sensor [px], by the names of their parameters.

        Raises:
            ParameterError: They can.
        """
        esim = self.esim
        if self.model != 'esim':
            rates = {'pixels.coppelia.noise_rate_hz': self.coppelia.noise_rate_hz}
        else:
            rates = {
                'pixels.esim.shot_rate_hz + leak_rate_hz + hot_share * hot_rate_hz': (
                    esim.shot_rate_hz + esim.leak_rate_hz + esim.hot_share * esim.hot_rate_hz
                )
            }
            threshold = min(esim.threshold_on, esim.threshold_off)
            most = math.log1p(1 / esim.dark_intensity) / threshold
            name = 'events of a pixel (pixels.esim.threshold_on, threshold_off, dark_intensity)'
            check_size('events in a step', {**size, name: most}, 2e8)
        check_size('noise events per second', {**size, **rates}, 2e8)


class PixelModel(Protocol):
    """An array of pixels that turns what it sees into events."""

    @property
    def images_per_step(self) -> int:
        """Images that `step` wants, at equally spaced times."""

    def adopt(self, parameters: PixelParameters) -> None:
        """Go on with other noise; from the next reset on, also with other thresholds."""

    def reset(self, rng: np.random.Generator) -> None:
        """Forget everything seen; all randomness until the next reset comes from rng.

        The first image after it sets what later ones are compared with, and gives no events.
        """

    def step(self, images: NDArray[np.float32], start_ns: int, end_ns: int) -> Events:
        """Look at the images of one step and return the events in it.

        Args:
            images: Linear intensities from 0 to 1, (images_per_step, height, width), at equally
                spaced times in (start_ns, end_ns], the last at end_ns. The first call after a
                reset may also bring a single image.
            start_ns: Simulation time before the step [ns], whole microseconds.
            end_ns: Simulation time after the step [ns], whole microseconds.

        Returns:
            Events in the order of time, row, column; times are whole microseconds in
            (start_ns, end_ns].

        Raises:
            SpikelaneError: Images of another shape or type, times that do not increase or are
                not whole microseconds, or a step without a reset before it.
        """


def make_pixel_model(parameters: PixelParameters, width: int, height: int) -> PixelModel:
    """Make the pixels of a sensor; they want a `reset` before the first step.

    Args:
        parameters: Which model, and its parameters.
        width: Columns of the sensor [px].
        height: Rows of the sensor [px].

    Raises:
        ParameterError: A sensor without pixels, or larger than events can address.
    """
    if not (1 <= width <= _LARGEST_SIDE_PX and 1 <= height <= _LARGEST_SIDE_PX):
        raise ParameterError(
            f'sensor size: expected 1 to {_LARGEST_SIDE_PX} px each way, got {width} x {height}'
        )
    if parameters.model == 'esim':
        return EsimPixels(parameters.esim, width, height)
    return CoppeliaPixels(parameters.coppelia, width, height)
