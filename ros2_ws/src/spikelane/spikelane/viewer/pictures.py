"""The pictures shown: of events, and of weights. Rows run from the top, as everywhere."""

from __future__ import annotations

import io
import math

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.encoding import EncodingParameters
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.events import Events

#: Red, green, blue: brighter and darker.
ON_RGB = (0, 64, 255)
OFF_RGB = (255, 64, 0)

_FADING = 0.7  # of what was seen before, for each picture that follows
_GAP = 1  # cells between the weights of two neurons
_CELLS = EncodingParameters().rows * EncodingParameters().columns

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]


def event_colours(events: Events) -> Image:
    """Return the colours of events by polarity, (N, 3)."""
    return np.where(events['polarity'][:, None] > 0, ON_RGB, OFF_RGB).astype(np.uint8)


class FadingImage:
    """The camera's image as its events tell of it: what was seen lately, the latest brightest."""

    def __init__(self) -> None:
        """Begin with black."""
        self._light: Floats = np.zeros((0, 0, 3))

    def add(self, events: Events, width: int, height: int) -> Image:
        """Let what was seen fade, add events, and return the picture.

        Args:
            events: Within the sensor, (N,).
            width: Columns of the sensor [px]; another size than before begins with black.
            height: Rows of the sensor [px].

        Returns:
            Red, green, blue, (height, width, 3).
        """
        if self._light.shape[:2] != (height, width):
            self._light = np.zeros((height, width, 3))
        self._light *= _FADING
        self._light[events['y'], events['x']] = event_colours(events)
        return self._light.astype(np.uint8)


def weights_picture(weights: NDArray[np.floating]) -> Floats:
    """Lay out an array of weights as one picture.

    Args:
        weights: An array of any shape. The last axes of (n, rows, columns), and of (n, 32) those
            of the spiking controllers' 4 by 8 image cells, are laid side by side; all else is
            one row of values for each first index.

    Returns:
        The values, NaN between those of two neurons, (rows, columns).

    Raises:
        SpikelaneError: There are none.
    """
    if weights.size == 0:
        raise SpikelaneError(f'weights: expected values, got none in shape {weights.shape}')
    values = np.asarray(weights, np.float64)
    if values.ndim == 2 and values.shape[1] == _CELLS:
        values = values.reshape(len(values), EncodingParameters().rows, -1)
    if values.ndim != 3:
        return values.reshape(len(values) if values.ndim > 1 else 1, -1)
    n, rows, columns = values.shape
    picture = np.full((rows, n * (columns + _GAP) - _GAP), math.nan)
    for k, block in enumerate(values):
        first = k * (columns + _GAP)
        picture[:, first : first + columns] = block
    return picture


def block_middles(weights: NDArray[np.floating]) -> list[float]:
    """Return the middle column of each neuron's weights in `weights_picture`.

    Empty for arrays that it does not lay out side by side.
    """
    columns = weights_picture(weights).shape[1]
    n = len(weights)
    side_by_side = weights.ndim == 3 or (weights.ndim == 2 and weights.shape[1] == _CELLS)
    if not side_by_side:
        return []
    width = (columns + _GAP) // n - _GAP
    return [k * (width + _GAP) + width / 2 for k in range(n)]


def png(image: Image) -> bytes:
    """Return an image as a PNG file; black, of which the camera's are full, takes no room."""
    import PIL.Image

    buffer = io.BytesIO()
    PIL.Image.fromarray(image).save(buffer, 'png', compress_level=1)
    return buffer.getvalue()


def in_colour(picture: Floats, colour_map: str = 'viridis') -> Image:
    """Return values as colours, from the smallest to the largest; NaN is black.

    Args:
        picture: Values, (rows, columns).
        colour_map: One of matplotlib's.

    Returns:
        Red, green, blue, (rows, columns, 3).
    """
    import matplotlib

    low, high = float(np.nanmin(picture)), float(np.nanmax(picture))
    scaled = (picture - low) / (high - low) if high > low else picture - low
    colours: Image = matplotlib.colormaps[colour_map](scaled, bytes=True)[..., :3].copy()
    colours[np.isnan(picture)] = 0
    return colours
