"""The table of laps under what makes driving harder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from spikelane.figures.robustness import DIFFICULTIES, robustness_curves, RobustnessPoint
from spikelane.report.groups import Table
from spikelane.report.quantities import METRES, NOTHING
from spikelane.report.runs import Conditions
from spikelane_controllers.registry import title
from spikelane_sim.errors import SpikelaneError


def conditions_table(conditions: Conditions) -> Table:
    """Return a row for each difficulty and value; none where the figure tells why."""
    try:
        curves = robustness_curves(conditions.results)
    except SpikelaneError:
        curves = {}
    controllers = list(dict.fromkeys(name for found in curves.values() for name in found))
    rows = [
        (
            f'{DIFFICULTIES[difficulty]}: {value:g}',
            *(_cell(by_controller.get(name, ()), value) for name in controllers),
        )
        for difficulty, by_controller in curves.items()
        for value in sorted({each.value for curve in by_controller.values() for each in curve})
    ]
    return Table(
        f'Laps under difficulties: {conditions.folder}',
        'Laps completed, and their mean error. A repeat of the same drive counts once.',
        ('difficulty', *map(title, controllers)),
        rows,
        brief=('difficulty', *map(title, controllers[:4])),
    )


def _cell(curve: Sequence[RobustnessPoint], value: float) -> str:
    """Return laps completed, and the mean error of these."""
    measured = next((each for each in curve if each.value == value), None)
    if measured is None:
        return NOTHING
    text = f'{measured.completed["successes"]} of {measured.completed["n"]}'
    error_m: Mapping[str, float] | None = measured.error_m
    return text if error_m is None else f'{text}, {METRES.show(error_m["mean"])}'
