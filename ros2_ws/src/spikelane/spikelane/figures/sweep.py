"""The figure of a sweep: what was measured, over the values of the parameter that was swept."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import itertools
import math
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

from spikelane.experiment.sweeps import PREFIX, swept_value
from spikelane.figures.value_axis import ValueAxis
from spikelane_controllers.registry import title
from spikelane_sim import figure_style as style
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.figure_values import tell_values, Value

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH_IN, _PANEL_IN, _TOP_IN, _FOOT_IN = 7.2, 2.3, 0.5, 0.7
_COLUMNS, _ROW_IN = 2, 0.22  # of the legend
_LEFT, _RIGHT, _GAP_IN = 0.14, 0.97, 0.2
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
    axis = _value_axis(measured)
    names = list(dict.fromkeys(words for lines in measured.values() for words in lines))
    foot_in = _FOOT_IN + _ROW_IN * math.ceil(len(names) / _COLUMNS)
    height_in = _TOP_IN + foot_in + len(measured) * (_PANEL_IN + _GAP_IN)
    with style.settings():
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
            _draw_panel(axes, axis, measure, lines, looks)
            _tell(axes, axis, parameter, lines)
            axes.tick_params(labelbottom=index == len(measured) - 1)
        assert axes is not None
        axes.set_xlabel(axis.named(parameter) if axis is not None else parameter)
        _explain(figure, looks)
        return style.save(figure, path)


def _draw_panel(
    axes: Axes,
    axis: ValueAxis | None,
    measure: str,
    lines: Lines,
    looks: Mapping[str, Mapping[str, Any]],
) -> None:
    if axis is not None:
        axis.set_up(axes)
    for words, points in lines.items():
        _draw_line(axes, axis, points, looks[words])
    axes.set_ylabel(MEASURES[measure])
    if measure == 'completed':
        axes.set_ylim(-4, 104)
    else:
        axes.set_ylim(0, _ABOVE * max(p.measured for each in lines.values() for p in each))


def _tell(axes: Axes, axis: ValueAxis | None, parameter: str, lines: Lines) -> None:
    """Let each point that stands at a number tell its values."""
    tell_values(
        axes,
        (
            Value(
                _told(words, parameter, point),
                (_place(axis, point.value),) * 2,
                (point.measured,) * 2,
            )
            for words, points in lines.items()
            for point in points
            if isinstance(point.value, float)
        ),
    )


def _explain(figure: Figure, looks: Mapping[str, Mapping[str, Any]]) -> None:
    from matplotlib.lines import Line2D

    figure.legend(
        handles=[
            Line2D([], [], markersize=4, linewidth=1.2, label=words, **look)
            for words, look in looks.items()
        ],
        loc='lower left',
        bbox_to_anchor=(0.05, 0.0),
        ncols=_COLUMNS,
        fontsize=style.SMALL_PT,
        frameon=False,
    )


def _draw_line(
    axes: Axes, axis: ValueAxis | None, points: Sequence[SweepPoint], look: Mapping[str, Any]
) -> None:
    places = [_place(axis, point.value) for point in points]
    axes.plot(places, [point.measured for point in points], linewidth=1.2, markersize=4, **look)
    for place, point in zip(places, points, strict=True):
        if point.ci_low is not None and point.ci_high is not None:
            axes.vlines(place, point.ci_low, point.ci_high, color=look['color'], linewidth=1)


def _place(axis: ValueAxis | None, value: float | str) -> Any:
    return axis.place(value) if axis is not None and isinstance(value, float) else value


def _told(words: str, parameter: str, point: SweepPoint) -> str:
    interval = ''
    if point.ci_low is not None and point.ci_high is not None:
        interval = f' (95 %: {point.ci_low:.4g} to {point.ci_high:.4g})'
    return f'{words}, {parameter} {point.value:g}: {point.measured:.4g}{interval}'


def _value_axis(measured: Mapping[str, Lines]) -> ValueAxis | None:
    """Return the axis of the values, None where some are words, which stand at equal distances."""
    lines = itertools.chain.from_iterable(each.values() for each in measured.values())
    values = [point.value for points in lines for point in points]
    numbers = [value for value in values if isinstance(value, float)]
    return ValueAxis.of(numbers) if len(numbers) == len(values) else None
