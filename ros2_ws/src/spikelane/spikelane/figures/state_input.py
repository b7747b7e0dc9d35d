"""The figure of what controllers see: events of the camera, and the images made of them.

As in the paper's section 3.2: 4 x 4 pixels a cell, ten steps for the deep Q-network; and section
4.2: 16 x 16 pixels a cell, one step for the spiking controllers.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spikelane_sim import figure_style as style
from spikelane_sim.encoding import (
    count_events,
    EncodingParameters,
    StateImage,
    StateImageParameters,
)
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.events import Events

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIZE_IN = (10.6, 3.6)
_COLOURS = 'BuPu'


def draw_state_input(
    steps: Sequence[Events], image_size: tuple[int, int], path: Path, title: str = ''
) -> tuple[Path, ...]:
    """Draw the events of the last step and the two kinds of images of counts.

    Args:
        steps: Events of consecutive steps, oldest first, at least as many as the deep Q-network's
            image has frames.
        image_size: Width and height of the camera's image [px].
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The image has not the size that the paper's encodings are of, the path
            has another ending, or it cannot be written.
    """
    fine, coarse = StateImageParameters(), EncodingParameters()
    if image_size != (fine.width, fine.height):
        raise SpikelaneError(
            f'state input: expected a camera of {fine.width} x {fine.height} px, '
            f'got {image_size[0]} x {image_size[1]} px'
        )
    image = StateImage(fine)
    for events in steps[-fine.frames :]:
        image.add(events)
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        style.write_title(figure, title, 'row 0 at the top')
        axes = figure.add_axes((0.02, 0.05, 0.27, 0.75))
        _draw_events(axes, steps[-1], coarse)
        for left, width, counts, words in (
            (0.32, 0.33, image.counts, f'DQN: {fine.frames} steps, cells of {fine.cell} px'),
            (
                0.67,
                0.31,
                count_events(steps[-1], coarse),
                f'spiking controllers: 1 step, {coarse.cell} px',
            ),
        ):
            axes = figure.add_axes((left, 0.05, width, 0.75))
            _draw_counts(axes, counts, words)
        return style.save(figure, path)


def _draw_events(axes: Axes, events: Events, cells: EncodingParameters) -> None:
    pixels = np.full((cells.height, cells.width), np.nan)
    pixels[events['y'], events['x']] = events['polarity']
    axes.imshow(pixels, cmap=_polarities(), vmin=-1, vmax=1, interpolation='nearest')
    for row in (cells.crop_top, cells.height - cells.crop_bottom):
        axes.axhline(row - 0.5, color=style.PALE_INK, linestyle=(0, (4, 3)), linewidth=0.9)
    _explain(axes, 'camera: brighter blue, darker orange')


def _polarities() -> Any:
    from matplotlib.colors import ListedColormap

    return ListedColormap([style.LEFT, style.RIGHT])


def _draw_counts(axes: Axes, counts: NDArray[np.int64], words: str) -> None:
    axes.imshow(counts, cmap=_COLOURS, vmin=0, interpolation='nearest')
    if counts.size <= 64:
        for (row, column), count in np.ndenumerate(counts):
            colour = style.ON_DARK if 2 * count > counts.max() else style.ON_BRIGHT
            axes.text(column, row, str(count), ha='center', va='center', color=colour)
    _explain(axes, words)


def _explain(axes: Axes, words: str) -> None:
    axes.set_title(words, fontsize=style.NORMAL_PT, weight='bold')
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(True)
