"""The figure of robustness: error and laps completed against what makes driving harder.

It is drawn from the results of an experiment whose conditions are named `<difficulty>-<value>`,
with a difficulty of DIFFICULTIES, or `none`, as in `experiments/robustness.yaml`; others are left
out. Driving under none is where the curves of difficulties that can be 0 begin.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
import re
from typing import Any, NamedTuple, TYPE_CHECKING

from spikelane.figures import style
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

#: Those that are 0 in the condition NONE.
_FROM_NONE = ('noise', 'latency', 'loss')

NONE = 'none'

_CONDITION = re.compile(rf'({"|".join(DIFFICULTIES)})-(\d+(?:\.\d+)?)')
_SIZE_IN = (10.6, 5.4)
_LEFT, _RIGHT, _GAP = 0.075, 0.99, 0.02
_ROWS = ((0.56, 0.34), (0.17, 0.34))  # bottom and height: of the error, of the laps
_COLOURS = (style.RIGHT, style.LEFT, '#009e73', '#cc79a7')
_MARKERS = 'osD^'
_BESIDE_PT = 2.5  # from one controller's points to the next one's, which would cover them
_MARGIN = 0.07  # beside the first and last value, of what is between them
_ABOVE_MEANS = 1.6  # how high the errors' axis is, of the largest mean


class Measured(NamedTuple):
    """Laps under one condition."""

    value: float  # of the difficulty
    completed: Mapping[str, Any]  # share_statistics
    error_m: Mapping[str, Any] | None  # mean_statistics of completed laps; None without any


def robustness_curves(results: Mapping[str, Any]) -> dict[str, dict[str, list[Measured]]]:
    """Find the curves in an experiment's results.

    Args:
        results: What `results.json` says.

    Returns:
        Of each difficulty that occurs and each controller what was measured, by rising value.

    Raises:
        SpikelaneError: No condition has such a name, or a controller was measured twice there.
    """
    curves: dict[str, dict[str, list[Measured]]] = {}
    for group in results.get('groups', ()):
        if 'laps' not in group:
            continue
        laps, controller = group['laps']['all'], group['controller']
        for difficulty, value in _difficulties(str(group.get('conditions', ''))):
            measured = Measured(value, laps['completed'], laps['mean_abs_distance_m'])
            curves.setdefault(difficulty, {}).setdefault(controller, []).append(measured)
    # What was driven under none alone is no curve.
    curves = {
        difficulty: by_controller
        for difficulty, by_controller in curves.items()
        if any(measured.value for curve in by_controller.values() for measured in curve)
    }
    if not curves:
        names = ', '.join(f'{name}-<value>' for name in DIFFICULTIES)
        raise SpikelaneError(f'conditions: expected some of {names}, got none')
    for difficulty, by_controller in curves.items():
        for controller, curve in by_controller.items():
            curve.sort(key=lambda measured: measured.value)
            if len({measured.value for measured in curve}) < len(curve):
                raise SpikelaneError(
                    f'conditions: expected each {difficulty} once for {controller}, '
                    'got several scenarios, courses or variants'
                )
    return {name: curves[name] for name in DIFFICULTIES if name in curves}


def _difficulties(condition: str) -> list[tuple[str, float]]:
    """Return the difficulties that a condition is a value of."""
    if condition == NONE:
        return [(name, 0.0) for name in _FROM_NONE]
    found = _CONDITION.fullmatch(condition)
    return [(found[1], float(found[2]))] if found else []


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
    from matplotlib.transforms import ScaledTranslation

    curves = robustness_curves(results)
    controllers = list(dict.fromkeys(name for found in curves.values() for name in found))
    looks: dict[str, dict[str, Any]] = {
        name: {'color': colour, 'marker': marker}
        for name, colour, marker in zip(controllers, _COLOURS, _MARKERS, strict=False)
    }
    with style.settings():
        figure = style.new_figure(*_SIZE_IN)
        style.write_title(figure, title, 'lines down and up: 95 % intervals, wide ones cut')
        width = (_RIGHT - _LEFT - _GAP * (len(curves) - 1)) / len(curves)
        shared: list[Axes | None] = [None, None]
        for index, (difficulty, by_controller) in enumerate(curves.items()):
            left = _LEFT + index * (width + _GAP)
            panels = [
                figure.add_axes((left, bottom, width, height), sharey=axes)
                for (bottom, height), axes in zip(_ROWS, shared, strict=True)
            ]
            shared = [*panels]
            for controller, curve in by_controller.items():
                beside_pt = _BESIDE_PT * (
                    controllers.index(controller) - (len(controllers) - 1) / 2
                )
                for axes, draw in zip(panels, (_draw_error, _draw_completed), strict=True):
                    moved = axes.transData + ScaledTranslation(
                        beside_pt / 72, 0, figure.dpi_scale_trans
                    )
                    draw(axes, curve, {**looks[controller], 'transform': moved})
            panels[0].tick_params(labelbottom=False, labelleft=not index)
            panels[1].tick_params(labelleft=not index)
            panels[1].set_xlabel(DIFFICULTIES[difficulty])
            # Also where no lap was completed there is a place for an error.
            values = [each.value for curve in by_controller.values() for each in curve]
            margin = _MARGIN * ((max(values) - min(values)) or 1.0)
            for axes in panels:
                axes.set_xlim(min(values) - margin, max(values) + margin)
        errors, completed = figure.axes[:2]
        errors.set_ylim(0, _highest_m(curves))
        errors.set_ylabel('mean error of laps [m]')
        completed.set_ylim(-4, 104)
        completed.set_ylabel('laps completed [%]')
        _explain(figure, looks)
        return style.save(figure, path)


def _draw_error(axes: Axes, curve: list[Measured], look: dict[str, Any]) -> None:
    points = [(each.value, each.error_m) for each in curve if each.error_m is not None]
    values, means = [x for x, _ in points], [error['mean'] for _, error in points]
    axes.plot(values, means, linewidth=1.2, markersize=4, **look)
    spread = [(x, error) for x, error in points if error['ci_low'] is not None]
    low, high = ([error[end] for _, error in spread] for end in ('ci_low', 'ci_high'))
    _draw_intervals(axes, [x for x, _ in spread], low, high, look)


def _draw_completed(axes: Axes, curve: list[Measured], look: dict[str, Any]) -> None:
    values = [each.value for each in curve]
    shares, low, high = (
        [100 * each.completed[name] for each in curve] for name in ('share', 'ci_low', 'ci_high')
    )
    axes.plot(values, shares, linewidth=1.2, markersize=4, **look)
    _draw_intervals(axes, values, low, high, look)


def _draw_intervals(
    axes: Axes, values: list[float], low: list[float], high: list[float], look: dict[str, Any]
) -> None:
    lines = {'color': look['color'], 'transform': look['transform'], 'linewidth': 1.0}
    axes.vlines(values, low, high, **lines)


def _highest_m(curves: Mapping[str, Mapping[str, list[Measured]]]) -> float | None:
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


def _explain(figure: Figure, looks: Mapping[str, dict[str, Any]]) -> None:
    from matplotlib.lines import Line2D

    style.write_legend(
        figure,
        [
            Line2D([], [], markersize=4, linewidth=1.2, label=name, **look)
            for name, look in looks.items()
        ],
    )
