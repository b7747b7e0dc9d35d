#!/usr/bin/env python3
"""Puts the paper's runs with pybullet and with rigid side by side: data, tables, figure.

source setup/env.sh
docs/results/engines.py collect runs/paper runs/paper_rigid docs/results/engines.csv
docs/results/engines.py show docs/results/engines.csv docs/results/engines.png

The first command reads what `./spikelane reproduce`, without and with `--engine rigid`, has left,
and prints where the processor time went. The second one prints the table of laps of engines.md and
draws its figure.
"""

from __future__ import annotations

from collections.abc import Iterator
import json
from pathlib import Path
import sys
from typing import Any

from matplotlib.axes import Axes
import pandas as pd
from shared.driving import LANES
from shared.tables import error_text, print_row, table_header

from spikelane_controllers.registry import title
from spikelane_sim.figure_style import LEFT, new_figure, RIGHT, save, settings, write_title

ENGINES = {'pybullet': LEFT, 'rigid': RIGHT}
KEYS = ['controller', 'setting', 'scenario', 'lane']


def read_json(path: Path) -> Any:
    """Read a JSON file."""
    return json.loads(path.read_text('utf-8'))


def rows_of(folder: Path, engine: str) -> Iterator[dict[str, Any]]:
    """Yield a row for each lap of an experiment."""
    for run in read_json(folder / 'results.json')['runs']:
        if run['task'] != 'evaluate':
            continue
        for lap in read_json(folder / run['folder'] / 'metrics.json')['laps']:
            yield {
                'engine': engine,
                'controller': run['controller'],
                'setting': run.get('variants', ''),
                'scenario': int(run['scenario']),
                'seed': run['seed'],
                'lane': lap['lane'],
                'completed': lap['completed'],
                'error_m': lap['mean_abs_distance_m'],
            }


def processor_times(folder: Path) -> dict[str, float]:
    """Return the processor time of each kind of task [s]."""
    lines = (folder / 'log.jsonl').read_text('utf-8').splitlines()
    profile = [each for each in map(json.loads, lines) if each['event'] == 'profile'][-1]
    return {cost['kind']: cost['processor_s'] for cost in profile['costs']}


def collect(folders: dict[str, Path], path: Path) -> None:
    """Read all laps, write the data, and print the table of processor times."""
    rows = [row for engine, folder in folders.items() for row in rows_of(folder, engine)]
    pd.DataFrame(rows).to_csv(path, index=False, float_format='%.6g')
    times = pd.DataFrame({engine: processor_times(each) for engine, each in folders.items()})
    times.loc['all'] = times.sum()
    print(table_header('processor time [s]', *ENGINES))
    for kind, row in times.iterrows():
        print_row(str(kind), *(f'{row[engine]:,.0f}' for engine in ENGINES))


def completed_text(laps: pd.DataFrame) -> str:
    """Return of how many laps how many were completed."""
    return f'{laps["completed"].sum()} of {len(laps)}'


def name_of(controller: str, setting: str) -> str:
    """Return a controller and its setting for a reader."""
    best = ', best setting' if setting == 'best' else ''
    return f'{title(controller)}{best}'


def show(data: pd.DataFrame, path: Path) -> None:
    """Print the table and draw the figure."""
    data = data.assign(setting=data['setting'].fillna(''))
    columns = [f'{what}, {engine}' for engine in ENGINES for what in ('laps', 'mean error (95 %)')]
    print(table_header('controller', 'scenario', 'lane', *columns))
    data = data.sort_values('scenario', kind='stable')
    for (controller, setting, scenario, lane), laps in data.groupby(KEYS, sort=False):
        cells = [name_of(controller, setting), str(scenario), lane]
        for engine in ENGINES:
            of = laps[laps['engine'] == engine]
            cells += [completed_text(of), error_text(of)]
        print_row(*cells)
    with settings():
        figure = new_figure(9.4, 4.2)
        write_title(figure, 'The laps of the paper with two engines', 'three trainings each')
        for number, lane in enumerate(LANES):
            axes = figure.add_axes((0.08 + 0.47 * number, 0.3, 0.43, 0.56))
            draw_lane(axes, data[data['lane'] == lane], lane)
        save(figure, path)


def draw_lane(axes: Axes, data: pd.DataFrame, lane: str) -> None:
    """Draw the mean error of each training's lap, by controller and scenario."""
    groups = list(data.groupby(['scenario', 'controller', 'setting'], sort=False))
    for place, (_, laps) in enumerate(groups):
        for engine, offset in zip(ENGINES, (-0.16, 0.16), strict=True):
            of = laps[(laps['engine'] == engine) & laps['completed']]
            axes.plot(
                [place + offset] * len(of), of['error_m'] * 1000, color=ENGINES[engine],
                marker='o', linestyle='none', markersize=4.5, alpha=0.75,
                label=engine if not place else None,
            )  # fmt: skip
    names = [key for key, _ in groups]
    labels = [name_of(controller, setting) for _, controller, setting in names]
    axes.set_xticks(range(len(labels)), labels, rotation=90, fontsize=7)
    for scenario in (2, 3):
        first = next(place for place, key in enumerate(names) if key[0] == scenario)
        axes.axvline(first - 0.5, linewidth=0.6, color='0.7')
    for scenario in (1, 2, 3):
        places = [place for place, key in enumerate(names) if key[0] == scenario]
        axes.annotate(
            f'scenario {scenario}', (sum(places) / len(places), 0.97), ha='center', va='top',
            xycoords=('data', 'axes fraction'), fontsize=8,
        )  # fmt: skip
    axes.set_ylim(0, 62)
    axes.set_title(f'{lane} lane', fontsize=9)
    if lane == LANES[0]:
        axes.set_ylabel('mean error of a lap [mm]')
        axes.legend(loc='upper left', bbox_to_anchor=(0.0, 0.9), frameon=False, fontsize=8)


def main() -> None:
    """Collect, or show."""
    arguments = sys.argv[1:]
    if len(arguments) == 4 and arguments[0] == 'collect':
        folders = dict(zip(ENGINES, map(Path, arguments[1:3]), strict=True))
        collect(folders, Path(arguments[3]))
    elif len(arguments) == 3 and arguments[0] == 'show':
        show(pd.read_csv(arguments[1]), Path(arguments[2]))
    else:
        sys.exit(__doc__)


if __name__ == '__main__':
    main()
