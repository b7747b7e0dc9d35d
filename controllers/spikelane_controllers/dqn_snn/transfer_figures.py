"""The figures of a transfer: accuracy over the training, and rates over the simulated time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from pathlib import Path
from typing import TYPE_CHECKING

from spikelane_controllers.dqn_snn.convergence import RateError
from spikelane_controllers.dqn_snn.transfer import Measured
from spikelane_sim import figure_style as style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SIZE_IN = (7.0, 4.0)
_AXES = (0.1, 0.13, 0.84, 0.74)


def draw_accuracy(
    curve: Sequence[Measured], path: Path, title: str = '', paper: float | None = None
) -> tuple[Path, ...]:
    """Draw how the accuracy grew over the training.

    Args:
        curve: Measurements, in the order of steps.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.
        paper: The paper's accuracy, None where it has none.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The path has another ending, or it cannot be written.
    """
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        style.write_title(figure, title, f'{curve[-1].held_out:.2%} at the end')
        axes = figure.add_axes(_AXES)
        steps = [each.step for each in curve]
        axes.plot(
            steps, [100 * each.training for each in curve], color=style.LEFT, label='trained with'
        )
        axes.plot(
            steps, [100 * each.held_out for each in curve], color=style.RIGHT, label='held out'
        )
        if paper is not None:
            label = f'paper: {paper:.2%}'
            axes.axhline(100 * paper, color=style.PALE_INK, linestyle='--', lw=1.0, label=label)
        axes.set_xlim(0, steps[-1])
        axes.set_xlabel('training step')
        axes.set_ylabel("states with the Q-network's action [%]")
        axes.xaxis.set_major_formatter('{x:,.0f}')
        _explain(axes, 'lower right')
        return style.save(figure, path)


def draw_rates(
    curves: Mapping[str, Sequence[RateError]], path: Path, title: str = ''
) -> tuple[Path, ...]:
    """Draw how far firing rates are from activations, over the simulated time.

    Args:
        curves: By what they are of, in words.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The path has another ending, or it cannot be written.
    """
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        style.write_title(figure, title, 'difference between rates and activations')
        axes = figure.add_axes(_AXES)
        colours = (style.RIGHT, style.LEFT, style.INK, style.PALE_INK)
        for colour, (name, errors) in zip(colours, curves.items(), strict=False):
            times_ms = [each.simulated_ms for each in errors]
            for layer, line in (('hidden', '-'), ('output', ':')):
                values = [getattr(each, layer) for each in errors]
                axes.plot(times_ms, values, line, color=colour, label=f'{layer}, {name}')
        axes.set_xscale('log')
        axes.set_yscale('log')
        low, high = axes.get_ylim()
        axes.set_ylim(10.0 ** math.floor(math.log10(low)), 10.0 ** math.ceil(math.log10(high)))
        axes.set_xlabel('simulated time [ms]')
        axes.set_ylabel('root mean square [spikes per ms]')
        _explain(axes, 'lower left')
        return style.save(figure, path)


def _explain(axes: Axes, where: str) -> None:
    axes.legend(loc=where, fontsize=style.SMALL_PT, frameon=False)
