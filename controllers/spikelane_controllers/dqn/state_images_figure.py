"""The figure of state images: what the deep Q-network is given, counts and binary."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spikelane_sim import figure_style as style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIZE_IN = (10.6, 4.0)
_SHOWN = 4
_COLOURS = 'BuPu'


def draw_state_images(states: NDArray[np.uint8], path: Path, title: str = '') -> tuple[Path, ...]:
    """Draw some of the states met in a training, evenly spread over it.

    Args:
        states: Counts, (n, rows, columns), n at least 1.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The path has another ending, or it cannot be written.
    """
    chosen = np.unique(np.linspace(0, len(states) - 1, _SHOWN + 2).astype(int)[1:-1])
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        style.write_title(figure, title, 'events in ten steps, and as the network sees them')
        width = 0.96 / len(chosen)
        for place, index in enumerate(chosen.tolist()):
            left = 0.02 + place * width
            for bottom, image in ((0.47, states[index]), (0.04, states[index] > 0)):
                axes = figure.add_axes((left, bottom, 0.94 * width, 0.38))
                _draw(axes, image)
            axes.set_xlabel('')
            figure.text(left, 0.87, f'state {index + 1:,}', fontsize=style.SMALL_PT)
        return style.save(figure, path)


def _draw(axes: Axes, image: NDArray[np.generic]) -> None:
    axes.imshow(image, cmap=_COLOURS, vmin=0, interpolation='nearest', aspect='equal')
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(True)
