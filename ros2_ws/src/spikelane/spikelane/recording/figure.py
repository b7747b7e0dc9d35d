"""The figure of a recording: spikes and potentials in detail, rates and weights over the run.

On the left, a short time: rasters of spikes, and what is sampled several times a step. On the
right, the whole run: rates of spikes in bins of time (a PSTH of one trial), and what is sampled
once a step, as dopamine, traces and weights.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spikelane.recording.tables import labels_of, opened, quantity_names
from spikelane_sim import figure_style as style
from spikelane_sim.errors import SpikelaneError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
#: Draws a panel of a recording: the axes, the file, the quantity's name, the time shown [s].
_Draw = Callable[['Axes', Any, str, tuple[float, float]], None]

_DETAIL_S = 1.0
_BINS = 120  # of the rates over the run
_POINTS = 1200  # of a line: more cannot be seen
_MOST_NAMED = 4  # entries of an axis that are told apart
_WIDTH_IN, _PANEL_IN, _REST_IN = 10.6, 1.55, 0.85
_MOST_EPISODES = 80  # whose beginnings are marked


def draw_recording(recording: Path, path: Path, title: str = '') -> tuple[Path, ...]:
    """Draw a recording.

    Args:
        recording: The file.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        SpikelaneError: The recording cannot be read or has no steps, or the path has another
            ending, or it cannot be written.
    """
    with opened(recording) as file, style.settings():
        stamps_s = file.variables['stamp_ns'][...] * 1e-9
        if not len(stamps_s):
            raise SpikelaneError(f'{recording}: expected at least one step, got none')
        whole_s = (0.0, float(stamps_s[-1]))
        begin_s = max(0.0, round((whole_s[1] - _DETAIL_S) / 2, 1))
        detail_s = (begin_s, min(begin_s + _DETAIL_S, whole_s[1]))
        left, right = _panels(file)
        figure = style.new_figure(_WIDTH_IN, _PANEL_IN * max(len(left), len(right)) + _REST_IN)
        words = f'{len(stamps_s):,} observations' + (
            '' if file.attrs['complete'] else ', interrupted'
        )
        style.write_title(figure, title, words)
        _draw_column(figure, file, left, detail_s, (0.075, 0.395))
        axes = _draw_column(figure, file, right, whole_s, (0.565, 0.42))
        for each in axes:
            each.axvspan(*detail_s, color=style.PALE_INK, alpha=0.25, linewidth=0, zorder=0)
            _mark_episodes(each, file, stamps_s)
        return style.save(figure, path)


def _panels(file: Any) -> tuple[list[tuple[str, _Draw]], list[tuple[str, _Draw]]]:
    """Return what is drawn in detail and over the whole run, from the top."""
    detail: list[tuple[str, _Draw]] = []
    whole: list[tuple[str, _Draw]] = []
    for name in quantity_names(file):
        if name not in file.variables:
            detail.append((name, _draw_raster))
            whole.append((name, _draw_rates))
        elif file.variables[name].dimensions[0] == 'step':
            whole.append((name, _draw_values))
        else:
            detail.append((name, _draw_samples))
    return detail, whole


def _draw_column(
    figure: Figure,
    file: Any,
    panels: list[tuple[str, _Draw]],
    shown_s: tuple[float, float],
    place: tuple[float, float],
) -> list[Axes]:
    """Draw panels below each other on one axis of time; return their axes."""
    height_in = figure.get_figheight()
    room_in = height_in - _REST_IN
    all_axes = []
    for index, (name, draw) in enumerate(panels):
        panel_in = room_in / len(panels)
        bottom_in = 0.55 + room_in - (index + 1) * panel_in
        left, width = place
        axes = figure.add_axes(
            (left, (bottom_in + 0.14) / height_in, width, (panel_in - 0.42) / height_in)
        )
        draw(axes, file, name, shown_s)
        axes.set_xlim(*shown_s)
        if index + 1 < len(panels):
            axes.tick_params(labelbottom=False)
        else:
            axes.set_xlabel('simulation time [s]')
        all_axes.append(axes)
    return all_axes


def _name(axes: Axes, words: str) -> None:
    axes.set_title(words, loc='left', fontsize=style.NORMAL_PT, weight='bold', pad=3)


def _spikes(file: Any, name: str) -> tuple[Floats, NDArray[np.int64], list[str]]:
    """Return the times [s] and sources of spikes, and the names of all sources."""
    times = file.variables[f'{name}_time_ns']
    axis = str(times.attrs['axis'])
    return times[...] * 1e-9, file.variables[f'{name}_{axis}'][...], labels_of(file, axis)


def _words(name: str) -> str:
    return name.replace('_', ' ')


def _draw_raster(axes: Axes, file: Any, name: str, shown_s: tuple[float, float]) -> None:
    times_s, sources, labels = _spikes(file, name)
    _name(axes, f'{_words(name)}: raster')
    within = (times_s >= shown_s[0]) & (times_s <= shown_s[1])
    is_named = len(labels) <= _MOST_NAMED
    axes.eventplot(
        [times_s[within & (sources == index)] for index in range(len(labels))],
        colors=[_colour(index) if is_named else style.INK for index in range(len(labels))],
        linewidths=1.0,
        linelengths=0.8 if is_named else max(0.8, len(labels) / 120),
    )
    axes.set_ylim(len(labels) - 0.4, -0.6)  # the first at the top
    if is_named:
        axes.set_yticks(range(len(labels)), labels)
    else:
        axes.set_yticks([0, len(labels) - 1], [labels[0], labels[-1]])


def _draw_rates(axes: Axes, file: Any, name: str, shown_s: tuple[float, float]) -> None:
    times_s, sources, labels = _spikes(file, name)
    edges = np.linspace(*shown_s, _BINS + 1)
    width_s = edges[1] - edges[0]
    _name(axes, f'{_words(name)}: rate in bins of {width_s:.2g} s')
    if len(labels) <= _MOST_NAMED:
        for index in range(len(labels)):
            counts, _ = np.histogram(times_s[sources == index], edges)
            axes.stairs(counts / width_s, edges, color=_colour(index), linewidth=1.1)
        _explain(axes, labels)
    else:
        counts, _ = np.histogram(times_s, edges)
        axes.stairs(counts / width_s / len(labels), edges, color=style.INK, linewidth=1.1)
    axes.set_ylim(bottom=0)
    axes.set_ylabel('[1/s]' if len(labels) <= _MOST_NAMED else f'mean of {len(labels)} [1/s]')


def _draw_samples(axes: Axes, file: Any, name: str, shown_s: tuple[float, float]) -> None:
    """Draw what is sampled several times a step."""
    times_s = file.variables[f'{name}_time_ns'][...] * 1e-9
    first, last = np.searchsorted(times_s, shown_s).tolist()
    variable = file.variables[name]
    _draw_lines(axes, file, name, times_s[first:last], variable[first:last], most=_MOST_NAMED)


def _draw_values(axes: Axes, file: Any, name: str, shown_s: tuple[float, float]) -> None:
    """Draw what is sampled once a step."""
    variable = file.variables[name]
    every = max(1, variable.shape[0] // _POINTS)
    stamps_s = file.variables['stamp_ns'][::every] * 1e-9
    _draw_lines(axes, file, name, stamps_s, variable[::every])


def _draw_lines(
    axes: Axes,
    file: Any,
    name: str,
    times_s: Floats,
    values: Floats,
    most: int | None = None,
) -> None:
    """Draw a line for each entry, in the colour of its entry on the first axis.

    Where that has more than `most` entries, its last three are drawn: of a network with layers
    they are of the last one.
    """
    variable = file.variables[name]
    unit = str(variable.attrs['units'])
    _name(axes, _words(name))
    axes.set_ylabel('' if unit == '1' else f'[{unit}]')
    labels = labels_of(file, variable.dimensions[1]) if len(variable.dimensions) > 1 else ['']
    lines: Floats = values.reshape(len(values), len(labels), -1)
    if most is not None and len(labels) > most:
        axes.set_ylabel(f'[{unit}], last 3 of {len(labels)}')
        labels, lines = labels[-3:], lines[:, -3:]
    is_named = len(labels) <= _MOST_NAMED
    is_thick = is_named and lines.shape[2] == 1
    for index in range(len(labels)):
        axes.plot(
            times_s,
            lines[:, index],
            color=_colour(index) if is_named else style.INK,
            linewidth=0.9 if is_thick else 0.5,
            alpha=1.0 if is_thick else 0.45,
        )
    if is_named and labels != ['']:
        _explain(axes, labels)


def _explain(axes: Axes, labels: list[str]) -> None:
    """Explain the colours of the entries, above the axes."""
    from matplotlib.lines import Line2D

    axes.legend(
        [Line2D([], [], color=_colour(index), linewidth=1.6) for index in range(len(labels))],
        labels,
        loc='lower right',
        bbox_to_anchor=(1.0, 0.96),
        ncols=len(labels),
        fontsize=style.SMALL_PT,
        frameon=False,
        handlelength=1.2,
        borderpad=0.0,
    )


def _mark_episodes(axes: Axes, file: Any, stamps_s: Floats) -> None:
    begins_s = stamps_s[1:][np.diff(file.variables['episode'][...]) != 0]
    if len(begins_s) <= _MOST_EPISODES:
        for each in begins_s:
            axes.axvline(each, color=style.PALE_INK, linewidth=0.6, alpha=0.6, zorder=0)


def _colour(index: int) -> str:
    return style.SERIES[index % len(style.SERIES)]
