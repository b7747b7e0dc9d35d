"""The figure of a sweep: what was measured, over the values of the parameter that was swept."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import itertools
import math
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

from spikelane.experiment.sweeps import PREFIX, swept_value
from spikelane_controllers.registry import title
from spikelane_sim import figure_style as style
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.figure_values import tell_values, Value

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDTH_IN, _PANEL_IN, _TOP_IN, _FOOT_IN = 7.2, 2.3, 0.5, 0.7
_COLUMNS, _ROW_IN = 2, 0.22  # of the legend
_LEFT, _RIGHT, _GAP_IN = 0.14, 0.97, 0.2
_LOG_FROM = 20.0  # largest by smallest value: then the axis is logarithmic
_ABOVE = 1.6  # how high an axis is, of the largest value: an interval of two can be much wider
_MARKERS = 'osD^v<>'

#: What is drawn, and how it is named on its axis.
MEASURES = {
    'error': 'mean error of laps [m]',
    'completed': 'laps completed [%]',
    'settling': 'step of the last lane loss',
}
#: What else than the swept parameter a group's place may have; the rest is its labels.
_PLACE = ('task', 'controller', 'scenario')
_NO_LABELS = ('seeds', 'simulator', 'filter', 'metrics', 'operations', 'times', 'laps')


class SweepPoint(NamedTuple):
    """One measure at one value; the ends are None where there is no interval."""

    value: float | str
    measured: float
    ci_low: float | None
    ci_high: float | None


#: Points by rising value, by the words of what was the same in all of them.
Lines = Mapping[str, Sequence[SweepPoint]]


def sweep_lines(results: Mapping[str, Any], parameter: str) -> dict[str, Lines]:
    """Find what was measured with each value of a swept parameter.

    Args:
        results: What `results.json` says.
        parameter: Its full name.

    Returns:
        The lines of each of MEASURES that was measured.
    """
    axis = PREFIX + parameter
    found: dict[str, dict[str, list[SweepPoint]]] = {}
    for group in results.get('groups', ()):
        if axis not in group:
            continue
        value = swept_value(axis, group[axis])
        for measure, numbers in _measured(group):
            lines = found.setdefault(measure, {})
            lines.setdefault(_words(group, axis), []).append(SweepPoint(value, *numbers))
    return {
        measure: {words: sorted(points, key=_order) for words, points in found[measure].items()}
        for measure in MEASURES
        if measure in found
    }


def _order(point: SweepPoint) -> tuple[bool, Any]:
    return isinstance(point.value, str), point.value


def _measured(
    group: Mapping[str, Any],
) -> Iterator[tuple[str, tuple[float, float | None, float | None]]]:
    """Yield the names of measures, each with its value and the ends of its interval."""
    if laps := group.get('laps', {}).get('all'):
        if error := laps['mean_abs_distance_m']:
            yield 'error', (error['mean'], error['ci_low'], error['ci_high'])
        percents = (100 * laps['completed'][name] for name in ('share', 'ci_low', 'ci_high'))
        share, low, high = percents
        yield 'completed', (share, low, high)
    times = group.get('times', {}).get('last_lane_loss_step')
    if times and times['median'] is not None:
        yield 'settling', (times['median'], times['ci_low'], times['ci_high'])


def _words(group: Mapping[str, Any], axis: str) -> str:
    """Return in words what a group has in common with others of its line."""
    labels = [
        str(name)
        for key, name in group.items()
        if key not in (axis, *_PLACE, *_NO_LABELS) and isinstance(name, str)
    ]
    return ', '.join([title(group['controller']), f'scenario {group["scenario"]}', *labels])


def draw_sweep(
    results: Mapping[str, Any], parameter: str, path: Path, heading: str = ''
) -> tuple[Path, ...]:
    """Draw all that was measured over the values of a swept parameter, with 95 % intervals.

    Args:
        results: What an experiment's `results.json` says.
        parameter: Full name of the parameter.
        path: Ending in .svg or .png; without an ending both are written.
        heading: Above the figure.

    Returns:
        The files written.

    Raises:
        SpikelaneError: Nothing was measured, the path has another ending, or it cannot be written.
    """
    measured = sweep_lines(results, parameter)
    if not measured:
        raise SpikelaneError(f'sweep of {parameter}: expected finished runs, got none')
    names = list(dict.fromkeys(words for lines in measured.values() for words in lines))
    foot_in = _FOOT_IN + _ROW_IN * math.ceil(len(names) / _COLUMNS)
    height_in = _TOP_IN + foot_in + len(measured) * (_PANEL_IN + _GAP_IN)
    with style.settings():
        from matplotlib.lines import Line2D

        figure = style.new_figure(_WIDTH_IN, height_in)
        style.write_title(figure, heading, 'vertical lines: 95 % intervals, wide ones cut')
        looks: dict[str, dict[str, Any]] = {
            words: {'color': colour, 'marker': marker}
            for words, colour, marker in zip(
                names, itertools.cycle(style.SERIES), itertools.cycle(_MARKERS), strict=False
            )
        }
        axes = None
        for index, (measure, lines) in enumerate(measured.items()):
            bottom_in = height_in - _TOP_IN - (index + 1) * (_PANEL_IN + _GAP_IN) + _GAP_IN
            place = (_LEFT, bottom_in / height_in, _RIGHT - _LEFT, _PANEL_IN / height_in)
            axes = figure.add_axes(place, sharex=axes)
            for words, points in lines.items():
                _draw_line(axes, points, looks[words])
            tell_values(
                axes,
                (
                    Value(
                        _told(words, parameter, point), (point.value,) * 2, (point.measured,) * 2
                    )
                    for words, points in lines.items()
                    for point in points
                    if isinstance(point.value, float)
                ),
            )
            axes.set_ylabel(MEASURES[measure])
            if measure == 'completed':
                axes.set_ylim(-4, 104)
            else:
                axes.set_ylim(0, _ABOVE * max(p.measured for each in lines.values() for p in each))
            is_last = index == len(measured) - 1
            axes.tick_params(labelbottom=is_last)
        assert axes is not None
        lines_of_all = itertools.chain.from_iterable(each.values() for each in measured.values())
        _scale(axes, [point.value for points in lines_of_all for point in points])
        axes.set_xlabel(parameter)
        figure.legend(
            handles=[
                Line2D([], [], markersize=4, linewidth=1.2, label=words, **looks[words])
                for words in names
            ],
            loc='lower left',
            bbox_to_anchor=(0.05, 0.0),
            ncols=_COLUMNS,
            fontsize=style.SMALL_PT,
            frameon=False,
        )
        return style.save(figure, path)


def _draw_line(axes: Axes, points: Sequence[SweepPoint], look: Mapping[str, Any]) -> None:
    values = [point.value for point in points]
    axes.plot(values, [point.measured for point in points], linewidth=1.2, markersize=4, **look)
    for point in points:
        if point.ci_low is not None and point.ci_high is not None:
            axes.vlines(point.value, point.ci_low, point.ci_high, color=look['color'], linewidth=1)


def _told(words: str, parameter: str, point: SweepPoint) -> str:
    interval = ''
    if point.ci_low is not None and point.ci_high is not None:
        interval = f' (95 %: {point.ci_low:.4g} to {point.ci_high:.4g})'
    return f'{words}, {parameter} {point.value:g}: {point.measured:.4g}{interval}'


def _scale(axes: Axes, values: Sequence[float | str]) -> None:
    """Let the axis of the values be logarithmic where they span more than a factor of 20."""
    numbers = [value for value in values if isinstance(value, float)]
    are_positive = len(numbers) == len(values) and min(numbers) > 0
    if are_positive and max(numbers) / min(numbers) >= _LOG_FROM:
        axes.set_xscale('log')
