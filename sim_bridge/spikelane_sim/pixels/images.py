"""What pixel models are given: images and the times of a step, checked and searched in one place.

Few pixels change from one image to the next. Compiled loops find them 64 at a time: a comparison
without branches makes one bit per pixel, which the compiler turns into vector instructions, and
`lowest_bit` then leads from one set bit to the next.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.compiled import uncounted
from spikelane_sim.errors import SpikelaneError

#: Pixels whose comparison makes one word of bits.
WORD_PIXELS = 64

# Multiplying a power of two by this de Bruijn sequence leaves another top six bits for each.
_DE_BRUIJN = np.uint64(0x03F79D71B4CB0A89)
_BIT_NUMBERS = np.argsort([((0x03F79D71B4CB0A89 << i) & (1 << 64) - 1) >> 58 for i in range(64)])


def check_images(
    images: NDArray[np.float32], numbers: Sequence[int], height: int, width: int
) -> None:
    """Check that images are what a pixel model can look at.

    Their values are not looked at: intensities are expected from 0 to 1.

    Args:
        images: Linear intensities, (n, height, width).
        numbers: Allowed values of n.
        height: Rows of the sensor [px].
        width: Columns of the sensor [px].

    Raises:
        SpikelaneError: They have another type or shape, or lie scattered in memory.
    """
    if (
        images.dtype == np.float32
        and images.ndim == 3
        and images.shape[0] in numbers
        and images.shape[1:] == (height, width)
        and images.flags.c_contiguous
    ):
        return
    number = ' or '.join(str(number) for number in numbers)
    raise SpikelaneError(
        f'images: expected contiguous float32 of shape ({number}, {height}, {width}), '
        f'got {images.dtype} of shape {images.shape}'
    )


def check_times(start_ns: int, end_ns: int) -> None:
    """Check that a step goes forward, from one whole microsecond to another.

    Raises:
        SpikelaneError: It does not.
    """
    if start_ns >= end_ns or start_ns % 1000 or end_ns % 1000:
        raise SpikelaneError(
            f'step: expected increasing times in whole microseconds, got {start_ns} to {end_ns} ns'
        )


def no_reset() -> SpikelaneError:
    """Return the error of a step that comes before any reset."""
    return SpikelaneError('pixel model: expected a reset before the first step, got none')


@uncounted
def lowest_bit(word: np.uint64) -> np.int64:
    """Return the number, from 0, of the lowest bit set in a word that has any."""
    lowest = word & (~word + np.uint64(1))
    return np.int64(_BIT_NUMBERS[(lowest * _DE_BRUIJN) >> np.uint64(58)])
