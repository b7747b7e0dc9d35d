"""The figure of robustness: error and laps completed against what makes driving harder.

It is drawn from the results of an experiment. What a condition changes is read from the
simulator's parameters that its runs had, never from its name. Runs that differ in one difficulty
alone, and in nothing else, are a curve. Points of several controllers at one value are drawn next
to each other, the first one at the value and the others to its right: no point stands at a value
below the smallest one that was driven.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import json
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

from spikelane.figures.value_axis import ValueAxis
from spikelane.runs.evaluate.summary import UNITS
from spikelane_controllers.registry import title as controller_title
from spikelane_sim import figure_style as style
from spikelane_sim.errors import SpikelaneError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Names of difficulties, and what they are on an axis.
DIFFICULTIES = {
    'noise': 'noise rate of a pixel [Hz]',
    'threshold': 'contrast threshold',
    'latency': 'latency [ms]',
    'loss': 'share of events lost',
}

#: The simulator's parameters that a difficulty is, by pixel model; of several all have one value.
_PARAMETERS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    'noise': {
        'coppelia': ('pixels.coppelia.noise_rate_hz',),
        'esim': ('pixels.esim.shot_rate_hz',),
    },
    'threshold': {
        'coppelia': ('pixels.coppelia.threshold',),
        'esim': ('pixels.esim.threshold_on', 'pixels.esim.threshold_off'),
    },
    'latency': dict.fromkeys(('coppelia', 'esim'), ('link.latency_ms',)),
    'loss': dict.fromkeys(('coppelia', 'esim'), ('link.event_loss',)),
}

_SIZE_IN = (10.6, 5.4)
_LEFT, _RIGHT, _GAP = 0.075, 0.99, 0.02
_ROWS = ((0.56, 0.34), (0.17, 0.34))  # bottom and height: of the error, of the laps
_COLOURS = (style.RIGHT, style.LEFT, '#009e73', '#cc79a7')
_MARKERS = 'osD^'
_APART_PT = 2.5  # from one controller's points to the next one's, which would cover them
_ABOVE_MEANS = 1.6  # how high the errors' axis is, of the largest mean


class RobustnessPoint(NamedTuple):
    """Laps under one condition."""

    value: float  # of the difficulty
    completed: Mapping[str, Any]  # share_statistics
    error_m: Mapping[str, Any] | None  # mean_statistics of completed laps; None without any
    unit: str  # what is independent, one of `runs.evaluate.summary.UNITS`


def robustness_curves(results: Mapping[str, Any]) -> dict[str, dict[str, list[RobustnessPoint]]]:
    """Find the curves in an experiment's results.

    Args:
        results: What `results.json` says.

    Returns:
        What was measured with each difficulty that occurs and each controller, by rising value.

    Raises:
        SpikelaneError: No two runs differ in a difficulty alone, the results are of a version
            that did not write the simulator's parameters, or a controller was measured twice.
    """
    curves: dict[str, dict[str, list[RobustnessPoint]]] = {}
    groups = [group for group in results.get('groups', ()) if 'laps' in group]
    if any('simulator' not in group for group in groups):
        raise SpikelaneError(
            f"{results.get('name', 'results')}: expected results with the simulator's parameters "
            'of each group, got those of an older version: go on with the experiment'
        )
    for difficulty in DIFFICULTIES:
        for (controller, _), curve in _curves(difficulty, groups).items():
            if len({measured.value for measured in curve}) < 2:
                continue
            if controller in curves.setdefault(difficulty, {}):
                raise _several(difficulty, controller)
            curves[difficulty][controller] = sorted(curve, key=lambda measured: measured.value)
            if len({measured.value for measured in curve}) < len(curve):
                raise _several(difficulty, controller)
    curves = {name: found for name, found in curves.items() if found}
    if not curves:
        names = ', '.join(DIFFICULTIES)
        raise SpikelaneError(f'conditions: expected some that differ in {names} alone, got none')
    return curves


def _curves(
    difficulty: str, groups: Sequence[Mapping[str, Any]]
) -> dict[tuple[str, str], list[RobustnessPoint]]:
    """Return what was measured, by controller and all parameters but the difficulty."""
    found: dict[tuple[str, str], list[RobustnessPoint]] = {}
    for group in groups:
        rest = dict(group['simulator'])
        names = _PARAMETERS[difficulty].get(rest.get('pixels.model', ''), ())
        values = {rest.pop(name, None) for name in names}
        if len(values) != 1 or not isinstance(value := values.pop(), (int, float)):
            continue
        laps = group['laps']['all']
        measured = RobustnessPoint(
            float(value),
            laps['completed'],
            laps['mean_abs_distance_m'],
            laps['unit'],
        )
        rest['filter'] = group.get('filter')
        key = group['controller'], json.dumps(rest, sort_keys=True)
        found.setdefault(key, []).append(measured)
    return found


def _several(difficulty: str, controller: str) -> SpikelaneError:
    return SpikelaneError(
        f'conditions: expected each {difficulty} once for {controller}, '
        'got several scenarios, courses or variants'
    )


def draw_robustness(results: Mapping[str, Any], path: Path, title: str = '') -> tuple[Path, ...]:
    """Draw the mean error of completed laps, and the share of laps completed, with intervals.

    Args:
        results: As in `robustness_curves`.
        path: Ending in .svg or .png; without an ending both are written.
        title: Above the figure.

    Returns:
        The files written.

    Raises:
        SpikelaneError: There is nothing to draw, the path has another ending, or it cannot be
            written.
    """
    curves = robustness_curves(results)
    controllers = list(dict.fromkeys(name for found in curves.values() for name in found))
    looks: dict[str, dict[str, Any]] = {
        name: {'color': colour, 'marker': marker}
        for name, colour, marker in zip(controllers, _COLOURS, _MARKERS, strict=False)
    }
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        style.write_title(figure, title, _in_words(curves))
        width = (_RIGHT - _LEFT - _GAP * (len(curves) - 1)) / len(curves)
        shared: list[Axes | None] = [None, None]
        for index, (difficulty, by_controller) in enumerate(curves.items()):
            left = _LEFT + index * (width + _GAP)
            panels = [
                figure.add_axes((left, bottom, width, height), sharey=axes)
                for (bottom, height), axes in zip(_ROWS, shared, strict=True)
            ]
            shared = [*panels]
            _draw_difficulty(panels, difficulty, by_controller, looks)
            for axes in panels:
                axes.tick_params(labelleft=not index)
        errors, completed = figure.axes[:2]
        errors.set_ylim(0, _highest_m(curves))
        errors.set_ylabel('mean error of laps [m]')
        completed.set_ylim(-4, 104)
        completed.set_ylabel('laps completed [%]')
        _explain(figure, looks, curves)
        return style.save(figure, path)


def _draw_difficulty(
    panels: Sequence[Axes],
    difficulty: str,
    by_controller: Mapping[str, list[RobustnessPoint]],
    looks: Mapping[str, dict[str, Any]],
) -> None:
    """Draw the curves of one difficulty: errors in the first panel, laps completed below."""
    from matplotlib.transforms import ScaledTranslation

    # Also where no lap was completed there is a place for an error.
    axis = ValueAxis.of(each.value for curve in by_controller.values() for each in curve)
    for axes, draw in zip(panels, (_draw_error, _draw_completed), strict=True):
        axis.set_up(axes)
        for place, (controller, look) in enumerate(looks.items()):
            apart = ScaledTranslation(place * _APART_PT / 72, 0, axes.figure.dpi_scale_trans)
            moved = {**look, 'transform': axes.transData + apart}
            draw(axes, axis, by_controller.get(controller, []), moved)
    panels[0].tick_params(labelbottom=False)
    panels[1].set_xlabel(axis.named(DIFFICULTIES[difficulty]))


def _draw_error(
    axes: Axes, axis: ValueAxis, curve: list[RobustnessPoint], look: dict[str, Any]
) -> None:
    points = [(each.value, each.error_m) for each in curve if each.error_m is not None]
    means = [error['mean'] for _, error in points]
    _draw_curve(axes, axis, [value for value, _ in points], means, look)
    spread = [(axis.place(x), error) for x, error in points if error['ci_low'] is not None]
    low, high = ([error[end] for _, error in spread] for end in ('ci_low', 'ci_high'))
    _draw_intervals(axes, [x for x, _ in spread], low, high, look)


def _draw_completed(
    axes: Axes, axis: ValueAxis, curve: list[RobustnessPoint], look: dict[str, Any]
) -> None:
    values = [each.value for each in curve]
    shares, low, high = (
        [100 * each.completed[name] for each in curve] for name in ('share', 'ci_low', 'ci_high')
    )
    _draw_curve(axes, axis, values, shares, look)
    _draw_intervals(axes, [axis.place(value) for value in values], low, high, look)


def _draw_curve(
    axes: Axes,
    axis: ValueAxis,
    values: Sequence[float],
    heights: Sequence[float],
    look: Mapping[str, Any],
) -> None:
    """Draw points and the line through them, dotted where the axis is broken."""
    places = [axis.place(value) for value in values]
    first = int(axis.zero_at is not None and values[:1] == [0.0])
    axes.plot(places, heights, linestyle='', markersize=4, **look)
    line = {'color': look['color'], 'transform': look['transform'], 'linewidth': 1.2}
    axes.plot(places[first:], heights[first:], **line)
    if first:
        axes.plot(places[:2], heights[:2], linestyle=':', **line)


def _draw_intervals(
    axes: Axes,
    places: Sequence[float],
    low: Sequence[float],
    high: Sequence[float],
    look: Mapping[str, Any],
) -> None:
    lines = {'color': look['color'], 'transform': look['transform'], 'linewidth': 1.0}
    axes.vlines(places, low, high, **lines)


def _highest_m(curves: Mapping[str, Mapping[str, list[RobustnessPoint]]]) -> float | None:
    """Return a top of the errors' axis that means fit below; None where there are none.

    An interval of two laps can be ten times as wide as what it is of.
    """
    means = [
        each.error_m['mean']
        for found in curves.values()
        for curve in found.values()
        for each in curve
        if each.error_m is not None
    ]
    return _ABOVE_MEANS * max(means) if means else None


def _explain(
    figure: Figure,
    looks: Mapping[str, dict[str, Any]],
    curves: Mapping[str, Mapping[str, list[RobustnessPoint]]],
) -> None:
    from matplotlib.lines import Line2D

    style.write_legend(
        figure,
        [
            Line2D([], [], markersize=4, linewidth=1.2, label=_label(name, curves), **look)
            for name, look in looks.items()
        ],
    )


def _in_words(curves: Mapping[str, Mapping[str, list[RobustnessPoint]]]) -> str:
    units = dict.fromkeys(
        UNITS[each.unit] for found in curves.values() for curve in found.values() for each in curve
    )
    return (
        f'n: laps at each value; vertical lines: 95 % intervals over {" or ".join(units)}, '
        'wide ones cut'
    )


def _label(controller: str, curves: Mapping[str, Mapping[str, list[RobustnessPoint]]]) -> str:
    """Return a controller's name and how many laps it drove at each value."""
    laps = [each.completed['n'] for found in curves.values() for each in found.get(controller, ())]
    low, high = min(laps), max(laps)
    return f'{controller_title(controller)}, n = {low}' + (f' to {high}' if high > low else '')
