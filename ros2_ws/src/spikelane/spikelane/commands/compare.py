"""`spikelane compare`: how the runs of two settings differ, with intervals and p-values."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping
import json
from pathlib import Path
from typing import Any, NamedTuple

from spikelane.differences import (
    Difference,
    difference_of_means,
    difference_of_shares,
    difference_of_times,
    METHOD,
)
from spikelane.report.groups import Key
from spikelane.report.quantities import COUNT, NOTHING, PERCENT, Quantity
from spikelane_sim.errors import SpikelaneError

_LEAST_WIDTH = 120  # of the table, in characters


class ComparisonError(SpikelaneError):
    """Two folders of runs have nothing that can be compared."""

    exit_status = 2


class Completed(NamedTuple):
    """How many units completed all their laps."""

    whole: int
    units: int
    unit: str  # what a unit is


class Row(NamedTuple):
    """One measure of one scenario."""

    scenario: str
    measure: str
    unit: str
    quantity: Quantity
    found: Difference


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    for name in ('first', 'second'):
        parser.add_argument(
            name,
            type=Path,
            metavar='A' if name == 'first' else 'B',
            help=f'folder with the runs of the {name} setting: evaluations, laps, trainings, '
            'transfers, or an experiment',
        )
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(options: argparse.Namespace) -> int:
    """Compare two settings.

    Returns:
        0.

    Raises:
        SpikelaneError: A folder has no runs, or the two have nothing that can be compared.
    """
    rows = compare(options.first, options.second)
    if options.json:
        print(json.dumps({'method': METHOD, 'differences': [_to_dict(row) for row in rows]}))
        return 0
    _print(rows, options.first, options.second)
    return 0


def compare(first: Path, second: Path) -> list[Row]:
    """Compare the runs in two folders, scenario by scenario.

    A unit is what was drawn independently: a training, a course or a seed.

    Args:
        first: Folder of runs that differ in nothing but scenario, lane, course and seed.
        second: Likewise.

    Raises:
        SpikelaneError: A folder has no runs or those of several settings, or the two have no
            scenario and measure in common.
    """
    # Here and not above: reading reports takes long to import.
    from spikelane.report.collect import collect

    found = [_measured(path, collect([path])) for path in (first, second)]
    rows = list(_rows(*found))
    if not rows:
        has = ' and '.join('; '.join(map(': '.join, each)) for each in found)
        raise ComparisonError(
            f'{first}, {second}: expected a scenario and a measure in common, got {has}'
        )
    return rows


#: What was measured, by scenario and by the measure in words.
_Found = dict[tuple[str, str], Any]


def _measured(path: Path, runs: Any) -> _Found:
    """Return what the runs in a folder have measured, a value of each unit.

    Raises:
        ComparisonError: They are of several settings.
    """
    from spikelane.report.groups import by_key
    from spikelane.report.lap_tables import units_of
    from spikelane.report.measured import LAP_MEASURES, laps_measured, QUANTITIES, values_of

    found: _Found = {}
    for kind in (runs.laps, [*runs.trainings, *runs.transfers]):
        _check_setting(path, by_key(kind))
    for key, laps in by_key(runs.laps).items():
        unit, units = units_of(laps)
        whole = sum(all(lap['completed'] for lap in each) for each in units.values())
        found[key.scenario, 'all laps completed'] = Completed(whole, len(units), unit)
        for lane in dict.fromkeys(lap.lane for lap in laps):
            of_lane = [lap for lap in laps if lap.lane == lane]
            for _, words, measured_in, value in LAP_MEASURES:
                words = words.rpartition(', ')[0]  # without the paper's lane
                measured = laps_measured(of_lane, words, QUANTITIES[measured_in], value)
                if measured.values:
                    found[key.scenario, f'{words}, {lane} lane'] = measured
    for key, group in by_key([*runs.trainings, *runs.transfers]).items():
        for measured in values_of(group).values():
            found[key.scenario, measured.words] = measured
    return found


def _check_setting(path: Path, keys: Iterable[Key]) -> None:
    settings = list(dict.fromkeys(key._replace(scenario='').words for key in keys))
    if len(settings) > 1:
        names = '; '.join(each.replace(', scenario ', '') for each in settings)
        raise ComparisonError(
            f'{path}: expected runs of one controller and setting, got {len(settings)}: {names}; '
            'give the folder of one of them'
        )


def _rows(first: Mapping[Any, Any], second: Mapping[Any, Any]) -> Iterator[Row]:
    for (scenario, words), a in first.items():
        b = second.get((scenario, words))
        if b is None:
            continue
        if isinstance(a, Completed):
            shares = difference_of_shares((a.whole, a.units), (b.whole, b.units))
            yield Row(scenario, words, a.unit, PERCENT, shares)
        elif a.reached is not None and b.reached is not None:
            times = difference_of_times(a.values, a.reached, b.values, b.reached)
            yield Row(scenario, f'{words} (median)', a.unit, a.quantity, times)
        else:
            means = difference_of_means(a.values, b.values)
            yield Row(scenario, f'{words} (mean)', a.unit, a.quantity, means)


def _to_dict(row: Row) -> dict[str, Any]:
    return {
        'scenario': row.scenario,
        'measure': row.measure,
        'unit': row.unit,
        **row.found._asdict(),
    }


def _print(rows: Iterable[Row], first: Path, second: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title=f'A: {first}\nB: {second}', title_justify='left', box=None)
    for name in ('scenario', 'measure'):
        table.add_column(name)
    for name in ('A', 'B', 'B - A', '95 % interval', 'effect', 'p', 'units'):
        table.add_column(name, justify='right')
    for row in rows:
        table.add_row(*_cells(row))
    console = Console(highlight=False)
    console.width = max(console.width, _LEAST_WIDTH)
    console.print(table)
    for name, text in METHOD.items():
        print(f'{name.replace("_", " ")}: {text}')


def _cells(row: Row) -> Iterator[str]:
    found, show = row.found, row.quantity.show
    yield row.scenario
    yield row.measure
    for value in (found.first, found.second, found.difference):
        yield NOTHING if value is None else show(value)
    if found.ci_low is None and found.ci_high is None:
        yield NOTHING
    else:
        ends = (found.ci_low, found.ci_high)
        yield ' to '.join(
            open_end if end is None else show(end)
            for end, open_end in zip(ends, ('-∞', '∞'), strict=True)
        )
    yield NOTHING if found.effect is None else f'{found.effect:.2f}'
    yield NOTHING if found.p_value is None else f'{found.p_value:.2g}'
    yield ' and '.join(COUNT.show(n) for n in found.n)
