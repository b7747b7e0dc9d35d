"""The figure of state images: what the deep Q-network is given, counts and binary."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spikelane_sim import figure_style as style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

_SIZE_IN = (10.6, 3.4)
_SHOWN = 4
_COLOURS = 'BuPu'
_LEFT, _RIGHT, _GAP = 0.045, 0.90, 0.012
_HIGHEST = 0.36
_COUNTS, _INPUTS = 0.51, 0.12  # bottom of each row of images
_BAR = (0.915, 0.012)  # left and width of the scales


def draw_state_images(
    states: NDArray[np.uint8], window_ms: int, path: Path, title: str = ''
) -> tuple[Path, ...]:
    """Draw some of the states met in a training that have events, evenly spread over it.

    Args:
        states: Counts, (n, rows, columns), n at least 1.
        window_ms: Time over which a state counts events [ms].
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The path has another ending, or it cannot be written.
    """
    has_events = states.any(axis=(1, 2))
    # A state without events shows nothing; how many there are is said in words.
    worth = np.flatnonzero(has_events) if has_events.any() else np.arange(len(states))
    chosen = worth[np.unique(np.linspace(0, len(worth) - 1, _SHOWN + 2).astype(int)[1:-1])]
    most = max(int(states[chosen].max()), 1)
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        empty = 100 * (1 - has_events.mean())
        style.write_title(figure, title, f'{empty:.1f} % of all states are without events')
        width = (_RIGHT - _LEFT + _GAP) / len(chosen)
        rows, columns = states.shape[1:]
        square = (width - _GAP) * _SIZE_IN[0] / _SIZE_IN[1] * rows / columns  # of square cells
        height = min(square, _HIGHEST)
        for place, index in enumerate(chosen.tolist()):
            left = _LEFT + place * width
            boxes = [(left, bottom, width - _GAP, height) for bottom in (_COUNTS, _INPUTS)]
            counts, inputs = (figure.add_axes(box) for box in boxes)
            shown = _draw(counts, states[index], most)
            _draw(inputs, states[index] > 0, 1)
            counts.set_title(f'action step {index + 1:,}', fontsize=style.SMALL_PT)
            if not place:
                counts.set_yticks([0, rows - 1])
                inputs.set_yticks([0, rows - 1])
                inputs.set_xticks([0, columns - 1])
                counts.set_ylabel('row of cells', fontsize=style.SMALL_PT)
                inputs.set_xlabel('column of cells', fontsize=style.SMALL_PT)
        _explain(figure, shown, window_ms, height)
        return style.save(figure, path)


def _draw(axes: Axes, image: NDArray[np.generic], most: int) -> AxesImage:
    """Draw an image whose darkest colour stands for a number."""
    shown = axes.imshow(
        image, cmap=_COLOURS, vmin=0, vmax=most, interpolation='nearest', aspect='equal'
    )
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(True)
    return shown


def _explain(figure: Figure, counts: AxesImage, window_ms: int, height: float) -> None:
    """Draw the scale of the counts, and that of the network's inputs, which are 0 or 1."""
    from matplotlib.cm import ScalarMappable

    inputs = ScalarMappable(cmap=counts.get_cmap().resampled(2))
    inputs.set_clim(-0.5, 1.5)
    for bottom, scale, words in (
        (_COUNTS, counts, f'events in {window_ms / 1000:g} s'),
        (_INPUTS, inputs, "network's input"),
    ):
        axes = figure.add_axes((_BAR[0], bottom, _BAR[1], height))
        bar = figure.colorbar(scale, cax=axes, label=words)
        if scale is inputs:
            bar.set_ticks([0, 1])
