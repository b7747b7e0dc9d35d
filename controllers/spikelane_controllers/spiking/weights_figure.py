"""The figure of learnt weights: as images, one per neuron, and over the training.

As in the paper's section on R-STDP.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any, Protocol, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.learning.training import Termination
from spikelane_controllers.spiking.steering import MOTOR_NEURONS
from spikelane_sim import figure_style as style
from spikelane_sim.contract import TERMINATED_LANE_LOST
from spikelane_sim.encoding import EncodingParameters
from spikelane_sim.errors import SpikelaneError

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

Floats = NDArray[np.float64]


class WeightHistory(Protocol):
    """A training whose weights are few enough to be drawn."""

    @property
    def steps(self) -> int:
        """Steps driven."""

    @property
    def terminations(self) -> Sequence[Termination]:
        """How each episode ended."""

    @property
    def weights_pa(self) -> NDArray[Any]:
        """Weights at the end [pA], (n_neurons, n_inputs)."""

    @property
    def weight_history(self) -> Sequence[NDArray[Any]]:
        """Weights every `save_every` steps, from step 0 [pA], each (n_neurons, n_inputs)."""

    @property
    def save_every(self) -> int:
        """Steps between the weights of the history."""


_SIZE_IN = (10.6, 5.6)
_COLUMNS = ((0.065, 0.39), (0.51, 0.39))  # of the figure: left edge and width
_COLOURS = 'BuPu'
_DARK = 0.5  # of the colour scale: from here on, numbers are written in white
_MOST_VALUES = 64  # cells of an image up to which their numbers can be read
_HATCHED: dict[str, Any] = {
    'facecolor': 'none',
    'edgecolor': '#a9b1b9',
    'hatch': '////',
    'linewidth': 0,
}


def draw_weights(
    training: WeightHistory,
    encoding: EncodingParameters,
    path: Path,
    title: str = '',
    words: str = '',
) -> tuple[Path, ...]:
    """Draw the weights of two motor neurons: as they are now, and over the training.

    Args:
        training: Training of a controller with one left and one right neuron.
        encoding: Which input belongs to which cell of the image.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.
        words: What is to be said of the weights; '' for nothing.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The weights are not those of two neurons and these cells, or the path has
            another ending, or it cannot be written.
    """
    shape = (len(MOTOR_NEURONS), encoding.rows, encoding.columns)
    steps, history = _weights_over_steps(training)
    if history[0].size != math.prod(shape) or len(history[0]) != len(MOTOR_NEURONS):
        raise SpikelaneError(
            f'weights: expected those of 2 neurons and {shape[1]} x {shape[2]} inputs, '
            f'got {" x ".join(map(str, history[0].shape))}'
        )
    images = history.reshape(-1, *shape)
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        after = f'weights after {training.steps:,} steps'
        style.write_title(figure, title, f'{after}; {words}' if words else after)
        unmoved = (images == images[0]).all(axis=(0, 1))
        lost = [e.step for e in training.terminations if e.reason == TERMINATED_LANE_LOST]
        _draw_images(figure, images[-1], unmoved)
        _draw_courses(figure, steps, images, lost)
        _explain_weights(figure, bool(lost), bool(unmoved.any()))
        return style.save(figure, path)


def draw_fixed_weights(
    weights_pa: Floats, encoding: EncodingParameters, path: Path, title: str = ''
) -> tuple[Path, ...]:
    """Draw weights that were never learnt, as images, one per neuron.

    Args:
        weights_pa: To the left and the right neuron [pA], (2, rows * columns).
        encoding: Which input belongs to which cell of the image.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The path has another ending, or it cannot be written.
    """
    images = weights_pa.reshape(len(MOTOR_NEURONS), encoding.rows, encoding.columns)
    with style.settings():
        figure = style.new_figure(_SIZE_IN[0], 0.55 * _SIZE_IN[1])
        style.write_title(figure, title, 'set by hand')
        nothing = np.zeros(images.shape[1:], bool)
        _draw_images(figure, images.astype(np.float32), nothing, bottom=0.18, height=0.6)
        return style.save(figure, path)


def _weights_over_steps(
    training: WeightHistory,
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return the steps and the weights then, (n, 2, n_inputs), the present ones included."""
    history = list(training.weight_history)
    steps = [index * training.save_every for index in range(len(history))]
    if steps[-1] < training.steps:
        steps.append(training.steps)
        history.append(training.weights_pa.astype(np.float32))
    return np.array(steps), np.stack(history)


def _draw_images(
    figure: Figure,
    images: NDArray[np.float32],
    unmoved: NDArray[np.bool_],
    bottom: float = 0.56,
    height: float = 0.315,
) -> None:
    """Draw the weights of each neuron as an image of their inputs' cells, on one scale."""
    largest_pa = _round_up(float(images.max()))
    for name, image, (left, width) in zip(MOTOR_NEURONS, images, _COLUMNS, strict=True):
        axes = figure.add_axes((left, bottom, width, height))
        axes.set_title(f'{name} motor neuron', fontsize=style.NORMAL_PT, weight='bold')
        shown = _draw_image(axes, image, largest_pa)
        _hatch(axes, unmoved)
        axes.set_xlabel('column of cells in the image')
    figure.axes[0].set_ylabel('row, from the top')
    bar = figure.colorbar(shown, cax=figure.add_axes((0.922, bottom, 0.014, height)))
    bar.set_label('weight [pA]')
    bar.outline.set_linewidth(0)  # type: ignore[operator]


def _draw_image(axes: Axes, image: NDArray[np.float32], largest_pa: float) -> AxesImage:
    rows, columns = image.shape
    shown = axes.imshow(image, cmap=_COLOURS, vmin=0, vmax=largest_pa, aspect='auto')
    axes.set_xticks(range(columns))
    axes.set_yticks(range(rows))
    axes.tick_params(length=0)
    for side in ('left', 'bottom'):
        axes.spines[side].set_visible(False)
    if image.size > _MOST_VALUES:
        return shown
    axes.set_xticks(np.arange(columns + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(rows + 1) - 0.5, minor=True)
    axes.grid(which='minor', color='white', linewidth=1.5)
    axes.tick_params(which='minor', length=0)
    for (row, column), weight in np.ndenumerate(image):
        colour = style.ON_DARK if weight > _DARK * largest_pa else style.ON_BRIGHT
        axes.text(
            column,
            row,
            f'{weight:.0f}',
            fontsize=style.SMALL_PT,
            color=colour,
            ha='center',
            va='center',
        )
    return shown


def _hatch(axes: Axes, cells: NDArray[np.bool_]) -> None:
    from matplotlib.patches import Rectangle

    for row, column in np.argwhere(cells).tolist():
        axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, **_HATCHED))


def _draw_courses(
    figure: Figure,
    steps: NDArray[np.int64],
    images: NDArray[np.float32],
    lost: list[int],
) -> None:
    """Draw the weights over the steps, a neuron in a panel, a weight as a line."""
    for index, (left, width) in enumerate(_COLUMNS):
        axes = figure.add_axes((left, 0.155, width, 0.295))
        _draw_lines(axes, steps, images[:, index])
        for step in lost:
            axes.axvline(step, color=style.PALE_INK, linewidth=0.6, alpha=0.5, zorder=0)
        axes.set_xlim(0, max(int(steps[-1]), 1))
        axes.set_ylim(0, 1.03 * _round_up(float(images.max())))
        axes.locator_params(axis='x', nbins=5)
        axes.xaxis.set_major_formatter('{x:,.0f}')
        axes.set_xlabel('step of the training (50 ms each)')
        if index == 0:
            axes.set_ylabel('weight [pA]')


def _draw_lines(axes: Axes, steps: NDArray[np.int64], images: NDArray[np.float32]) -> None:
    """Draw each weight in the colour of its half of the image, the lower the darker."""
    _, rows, columns = images.shape
    for row, column in np.ndindex(rows, columns):
        axes.plot(
            steps,
            images[:, row, column],
            color=style.LEFT if column < columns / 2 else style.RIGHT,
            alpha=0.3 + 0.7 * (row + 1) / rows,
            linewidth=1.0,
        )


def _explain_weights(figure: Figure, lost: bool, unmoved: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Artist] = [
        Line2D(
            [],
            [],
            color=colour,
            linewidth=1.8,
            label=f"inputs of the image's {name} half, lower rows darker",
        )
        for name, colour in (('left', style.LEFT), ('right', style.RIGHT))
    ]
    if lost:
        handles.append(Line2D([], [], color=style.PALE_INK, linewidth=0.8, label='lane lost'))
    if unmoved:
        handles.append(Patch(**_HATCHED, label='saw no events'))
    style.write_legend(figure, handles)


def _round_up(largest: float) -> float:
    """Return a limit at or a little above, a number of two digits; 1 above nothing."""
    if largest <= 0:
        return 1.0
    unit = 10.0 ** (math.floor(math.log10(largest)) - 1)
    return math.ceil(largest / unit) * unit
