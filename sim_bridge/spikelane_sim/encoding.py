"""From events to images of counts: the inputs of the controllers (paper sections 3.2 and 4.2).

An image counts the events of square cells of pixels, whatever their polarity, after rows are
cropped at the top and the bottom. Its row 0 is the top one and its column 0 the left one. The
spiking networks see the 8 x 4 cells of one step, the deep Q-network the 32 x 16 cells of ten.
"""

from __future__ import annotations

import dataclasses
import functools

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.errors import ParameterError
from spikelane_sim.events import Events
from spikelane_sim.parameters import check_size, parameter, Parameters
from spikelane_sim.period import PERIOD_MS, SHORTEST_MS, steps_of

Counts = NDArray[np.int64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class EncodingParameters(Parameters):
    """How the sensor is divided into cells; the defaults are the spiking controllers'."""

    width: int = parameter(
        128, 'Number of pixel columns of the sensor.', unit='px', low=1, high=2048
    )
    height: int = parameter(
        128, 'Number of pixel rows of the sensor.', unit='px', low=1, high=2048
    )
    crop_top: int = parameter(
        40, 'Pixel rows that are ignored at the top of the image.', unit='px', low=0, high=2047
    )
    crop_bottom: int = parameter(
        24, 'Pixel rows that are ignored at the bottom of the image.', unit='px', low=0, high=2047
    )
    cell: int = parameter(
        16, 'Side of a square cell of pixels.', unit='px', low=1, high=2048, source='section 4.2'
    )

    @functools.cached_property
    def rows(self) -> int:
        """Rows of cells."""
        return (self.height - self.crop_top - self.crop_bottom) // self.cell

    @functools.cached_property
    def columns(self) -> int:
        """Columns of cells."""
        return self.width // self.cell

    def _check_relations(self) -> None:
        rows_left = self.height - self.crop_top - self.crop_bottom
        if rows_left < 1 or rows_left % self.cell or self.width % self.cell:
            raise ParameterError(
                f'cell: expected cells that fill the {self.width} x {rows_left} px left after '
                f'cropping, got {self.cell} px'
            )


@dataclasses.dataclass(frozen=True, kw_only=True)
class StateImageParameters(EncodingParameters):
    """The state of the deep Q-network: finer cells, summed over the steps of an action."""

    cell: int = parameter(
        4, 'Side of a square cell of pixels.', unit='px', low=1, high=2048, source='section 3.2'
    )
    frames: int = parameter(
        10,
        'For how long events are counted, in steps of frame_ms whatever the control period.',
        low=1,
        high=1000,
        source='section 3.2',
    )
    frame_ms: int = parameter(
        PERIOD_MS,
        'Length of the steps that frames counts; the time is rounded to whole control periods.',
        unit='ms',
        low=SHORTEST_MS,
        high=PERIOD_MS,
        source='section 3.2',
    )

    def _check_relations(self) -> None:
        super()._check_relations()
        sizes = {'frames': self.frames, 'rows': self.rows, 'columns of cells': self.columns}
        check_size('counts', sizes, 1e7)


def count_events(events: Events, parameters: EncodingParameters) -> Counts:
    """Count the events in each cell, whatever their polarity.

    Args:
        events: Events of one step, (N,). Those outside the cells are not counted.
        parameters: The cells.

    Returns:
        Counts, (rows, columns).
    """
    counts = np.empty((parameters.rows, parameters.columns), np.int64)
    count_cells(events, len(events), parameters.crop_top, parameters.cell, counts)
    return counts


@numba.njit(cache=True, error_model='numpy')
def count_cells(events: Events, number: int, crop_top: int, cell: int, counts: Counts) -> None:
    """Count the first events in each cell, compiled; see `count_events`.

    Args:
        events: Events of one step.
        number: How many of them count.
        crop_top: Rows left out at the top [px].
        cell: Side of a cell [px].
        counts: Is overwritten, (rows, columns).
    """
    counts[:] = 0
    side = np.int32(cell)
    for k in range(number):
        y = np.int32(events[k].y) - np.int32(crop_top)
        row, column = y // side, np.int32(events[k].x) // side
        if 0 <= row < counts.shape[0] and column < counts.shape[1]:
            counts[row, column] += 1


class StateImage:
    """Counts of the last few steps: first in, first out; zeros before the first step.

    Args:
        parameters: The cells, and for how long events count.
        steps: How many steps these are; None with a control period of 50 ms.
    """

    def __init__(
        self, parameters: StateImageParameters | None = None, steps: int | None = None
    ) -> None:
        self.parameters = parameters or StateImageParameters()
        if steps is None:
            steps = steps_of(self.parameters.frames, self.parameters.frame_ms, PERIOD_MS)
        self._steps = steps
        shape = (self._steps, self.parameters.rows, self.parameters.columns)
        self._frames = np.zeros(shape, np.int64)
        self._oldest = 0

    def clear(self) -> None:
        """Forget all steps, as at the start of an episode."""
        self._frames[:] = 0
        self._oldest = 0

    def add(self, events: Events) -> None:
        """Take in the events of one step, (N,), and drop the oldest step."""
        self._frames[self._oldest] = count_events(events, self.parameters)
        self._oldest = (self._oldest + 1) % self._steps

    @property
    def frames(self) -> Counts:
        """Events in each cell in each of the last steps, oldest first, (frames, rows, columns)."""
        return np.roll(self._frames, -self._oldest, axis=0)

    @frames.setter
    def frames(self, frames: Counts) -> None:
        self._frames[:] = frames
        self._oldest = 0

    @property
    def counts(self) -> Counts:
        """Events in each cell over the last steps, (rows, columns)."""
        total: Counts = self._frames.sum(axis=0)
        return total

    @property
    def binary(self) -> NDArray[np.uint8]:
        """1 where a cell had an event, else 0, (rows, columns): the state of the DQN."""
        return (self.counts > 0).astype(np.uint8)
