#!/usr/bin/env python3
"""Shows what experiments/dqn.yaml has left: the data, tables and figure of dqn_best.md.

source setup/env.sh
docs/results/dqn_best.py collect runs/dqn docs/results/dqn_best.csv
docs/results/dqn_best.py show docs/results/dqn_best.csv docs/results/dqn_best.png

The first command reads the laps, trainings and transfers of the experiment's folder. The second
one prints the tables and draws the figure from the data.
"""

from __future__ import annotations

from collections.abc import Sequence
import json
from pathlib import Path
import sys
from typing import Any

from matplotlib.axes import Axes
import numpy as np
import pandas as pd
from shared.tables import print_row, range_text

from spikelane.statistics import mean_statistics
from spikelane_controllers.registry import title
from spikelane_sim.figure_style import LEFT, new_figure, PALE_INK, RIGHT, save, settings

#: What each seed is to reach: the largest mean error [m] by scenario, and the least agreement.
AIMS_M = {1: 0.015, 2: 0.015, 3: 0.02}
AIM_AGREEMENT = 0.97
#: Columns of the data, by the parameters that are swept, with their names in the figure.
SWEPT = {
    'dqn.q_learning.discount': 'discount',
    'dqn.task.reward_sigma_m': 'reward_sigma_m',
    'dqn.q_learning.learning_rate': 'learning_rate',
    'dqn.q_learning.soft_update': 'soft_update',
    'dqn.q_learning.buffer_size': 'buffer_size',
}
#: Columns that tell the settings of a sweep apart.
SWEEPS = {
    'quick': ('discount', 'reward_sigma_m'),
    'near': ('learning_rate', 'soft_update', 'buffer_size'),
}
#: The settings of the sweeps in common.
BEST = {
    'discount': 0.9,
    'reward_sigma_m': 0.05,
    'learning_rate': 5e-4,
    'soft_update': 0.005,
    'buffer_size': 20000,
    'averaged': True,
}
#: Pairs of settings whose errors are compared seed by seed: what differs from `BEST`.
PAIRS: tuple[tuple[str, dict[str, float], dict[str, float]], ...] = (
    *(
        (f'reward of 0.15 m, not 0.05 m, discount {discount}',
         {'discount': discount, 'reward_sigma_m': 0.15}, {'discount': discount})
        for discount in (0.8, 0.9, 0.95, 0.99)
    ),
    ('discount 0.9, not 0.8', {}, {'discount': 0.8}),
    ('discount 0.99, not 0.9', {'discount': 0.99}, {}),
    *(
        (f'learning network, not its average, discount {discount}',
         {'discount': discount, 'averaged': False}, {'discount': discount})
        for discount in (0.8, 0.9, 0.95, 0.99)
    ),
    ('learning rate 5e-4, not 1e-4, buffer 5,000',
     {'buffer_size': 5000}, {'buffer_size': 5000, 'learning_rate': 1e-4}),
    ('learning rate 5e-4, not 1e-4, buffer 20,000', {}, {'learning_rate': 1e-4}),
    ('buffer 20,000, not 5,000, learning rate 1e-4',
     {'learning_rate': 1e-4}, {'learning_rate': 1e-4, 'buffer_size': 5000}),
    ('buffer 20,000, not 5,000, learning rate 5e-4', {}, {'buffer_size': 5000}),
)  # fmt: skip
#: Errors beyond are drawn there, as are laps that were not completed [m].
WORST_M = 0.1
UNDONE_M = 0.14


def read_json(path: Path) -> Any:
    """Read a JSON file."""
    return json.loads(path.read_text('utf-8'))


def rows_of(folder: Path) -> list[dict[str, Any]]:
    """Return a row for each lap of an evaluation."""
    run = read_json(folder / 'run.json')
    point = run['point']
    before = folder / run['checkpoint']
    learnt = read_json(before / 'metrics.json')
    parameters = {'dqn.averaged': False, **point['parameters']}
    row = {
        'controller': point['controller'],
        'scenario': int(point['scenario']),
        'setting': next(each for each in ('best', *SWEEPS) if f'-{each}-' in folder.name),
        **{name: parameters.get(given) for given, name in SWEPT.items()},
        'averaged': parameters['dqn.averaged'],
        'seed': point['seed'],
        'solved_by': learnt.get('solved_by'),
        'states': learnt['states'],
        'agreement': learnt.get('accuracy'),
    }
    return [
        {
            **row,
            'lane': lap['lane'],
            'completed': lap['completed'],
            'error_m': lap['mean_abs_distance_m'],
        }
        for lap in read_json(folder / 'metrics.json')['laps']
    ]


def collect(folder: Path, path: Path) -> None:
    """Read all laps and write the data."""
    rows = [row for each in sorted(folder.glob('evaluate-*')) for row in rows_of(each)]
    pd.DataFrame(rows).to_csv(path, index=False)


def mean_of(values: Sequence[float], form: str, unit: str, **bounds: float) -> str:
    """Return the mean with its standard deviation and 95 % interval, as text."""
    found = mean_statistics(list(values), **bounds)
    assert found is not None
    mean, std, low, high = (found[key] for key in ('mean', 'std', 'ci_low', 'ci_high'))
    return f'{mean:{form}} ± {std:{form}} {unit} ({low:{form}} to {high:{form}})'


def print_best(data: pd.DataFrame) -> None:
    """Print the laps of the best settings, then every seed, then the agreements."""
    best = data[data['setting'] == 'best']
    keys = ['controller', 'scenario', 'lane']
    groups = list(best.groupby(keys, sort=False))
    print_row('controller', 'scenario', 'lane', 'completed', 'mean error ± s (95 %)',
              'median (range)', 'below the aim')  # fmt: skip
    print_row(*['---'] * 7)
    for (controller, scenario, lane), rows in groups:
        errors_m, aim_m = rows['error_m'], AIMS_M[scenario]
        reached = (errors_m < aim_m) & rows['completed']
        print_row(
            title(controller),
            str(scenario),
            lane,
            f'{rows["completed"].sum()} of {len(rows)}',
            mean_of(errors_m, '.4f', 'm', low=0.0),
            f'{errors_m.median():.4f} m ({errors_m.min():.4f} to {errors_m.max():.4f})',
            f'{reached.sum()} of {len(rows)} (< {aim_m:.3f} m)',
        )
    print()
    print_row('controller', 'scenario', 'lane', 'seed: mean error')
    print_row(*['---'] * 4)
    for (controller, scenario, lane), rows in groups:
        each = [f'{row.seed}: {row.error_m:.4f}' for row in rows.itertuples()]
        print_row(title(controller), str(scenario), lane, '; '.join(each) + ' m')
    print()
    print_agreements(best[(best['controller'] == 'dqn_snn') & (best['lane'] == 'outer')])
    print()
    solved = best[(best['controller'] == 'dqn') & (best['lane'] == 'outer')]
    for scenario, rows in solved.groupby('scenario'):
        steps = rows['solved_by']
        print(
            f'- scenario {scenario}: {steps.notna().sum()} of {len(rows)} solved, by action step '
            + range_text(steps.median(), steps.min(), steps.max(), ',.0f')
        )


def print_agreements(rows: pd.DataFrame) -> None:
    """Print how often both networks choose the same action on episodes that were held out."""
    print_row('scenario', 'states', 'agreement ± s (95 %)', 'at least 97 %', 'seed: agreement')
    print_row(*['---'] * 5)
    for scenario, mine in rows.groupby('scenario'):
        shares = mine['agreement']
        each = [f'{row.seed}: {100 * row.agreement:.2f}' for row in mine.itertuples()]
        print_row(
            str(scenario),
            f'{mine["states"].iloc[0]:,}',
            mean_of(100 * shares, '.2f', '%', low=0.0, high=100.0),
            f'{(shares >= AIM_AGREEMENT).sum()} of {len(mine)}',
            '; '.join(each) + ' %',
        )


def print_sweep(data: pd.DataFrame, sweep: str) -> None:
    """Print a row for each setting of a sweep and network that drove."""
    names = SWEEPS[sweep]
    print_row(*(f'`{name}`' for name in names), 'network', 'solved', 'completed',
              'mean error of both lanes: median (range)')  # fmt: skip
    print_row(*['---'] * (len(names) + 4))
    mine = data[data['setting'] == sweep]
    for values, rows in mine.groupby([*names, 'averaged']):
        done = rows.loc[rows['completed'], 'error_m']
        trainings = rows[rows['lane'] == 'outer']
        print_row(
            *(f'{value:g}' for value in values[:-1]),
            'running average' if values[-1] else 'learning',
            f'{trainings["solved_by"].notna().sum()} of {len(trainings)}',
            f'{rows["completed"].sum()} of {len(rows)}',
            f'{done.median():.4f} m ({done.min():.4f} to {done.max():.4f})'
            if len(done)
            else 'none',
        )


def errors_of(data: pd.DataFrame, differs: dict[str, float]) -> pd.Series:
    """Return the mean error of the completed laps of each seed [m], with a setting."""
    mine = data[(data['setting'] != 'best') & data['completed']]
    for name, value in {**BEST, **differs}.items():
        mine = mine[mine[name] == value]
    return mine.groupby('seed')['error_m'].mean()


def print_differences(data: pd.DataFrame) -> None:
    """Print how much larger the error of one setting is than that of another, seed by seed."""
    print_row('what differs', 'seeds', 'by how much the error is larger ± s (95 %)')
    print_row(*['---'] * 3)
    for name, one, other in PAIRS:
        by_seed = (errors_of(data, one) - errors_of(data, other)).dropna()
        print_row(name, str(len(by_seed)), mean_of(1000 * by_seed, '.1f', 'mm'))


def draw_sweep(axes: Axes, data: pd.DataFrame, sweep: str) -> None:
    """Draw all laps of a sweep, a row for each setting."""
    names = SWEEPS[sweep]
    mine = data[data['setting'] == sweep]
    labels = []
    for place, (values, rows) in enumerate(mine.groupby(list(names))):
        labels.append(', '.join(f'{value:g}' for value in values))
        for averaged, colour, shift in ((False, LEFT, -0.17), (True, RIGHT, 0.17)):
            laps = rows[rows['averaged'] == averaged].sort_values(['lane', 'seed'])
            errors_m = np.minimum(laps['error_m'], WORST_M)
            heights = place + shift + np.linspace(-0.08, 0.08, len(laps))
            done = laps['completed'].to_numpy()
            axes.plot(errors_m[done], heights[done], 'o', markersize=3.5, color=colour)
            undone = np.full((~done).sum(), UNDONE_M)
            axes.plot(undone, heights[~done], 'x', markersize=4, color=colour)
            if done.any():
                middle = float(np.median(errors_m[done]))
                axes.plot([middle] * 2, [place + shift - 0.15, place + shift + 0.15], color=colour)
    axes.set(
        xscale='log',
        xlim=(0.003, 0.18),
        xlabel='mean error of a lap [m]',
        title=' / '.join(name.removesuffix('_m').replace('_', ' ') for name in names),
    )
    ticks = (0.005, 0.01, 0.02, 0.05, UNDONE_M)
    axes.set_xticks(ticks, [*(f'{tick:g}' for tick in ticks[:-1]), 'lost'])
    axes.minorticks_off()
    axes.set_yticks(range(len(labels)), labels)
    axes.axvline(AIMS_M[1], color=PALE_INK, linewidth=0.8, linestyle='--')
    axes.invert_yaxis()


def draw(path: Path, data: pd.DataFrame) -> None:
    """Draw both sweeps."""
    with settings():
        figure = new_figure(9.6, 4.6)
        figure.set_layout_engine('constrained', rect=(0.0, 0.06, 1.0, 0.94))
        for axes, sweep in zip(figure.subplots(1, 2), SWEEPS, strict=True):
            draw_sweep(axes, data, sweep)
        handles = [
            axes.plot([], [], 'o', markersize=3.5, color=colour, label=label)[0]
            for colour, label in (
                (LEFT, 'laps with the learning network'),
                (RIGHT, 'laps with its running average; a bar is the median'),
            )
        ]
        figure.legend(handles=handles, loc='lower center', ncols=2, frameon=False)
        save(figure, path)


def show(path: Path, figure: Path) -> None:
    """Print the tables and draw the figure."""
    data = pd.read_csv(path)
    print_best(data)
    for sweep in SWEEPS:
        print()
        print_sweep(data, sweep)
    print()
    print_differences(data)
    draw(figure, data)


def main() -> None:
    """Do what the command line says."""
    if len(sys.argv) != 4 or sys.argv[1] not in ('collect', 'show'):
        sys.exit('usage: dqn_best.py collect RUNS DATA.csv | dqn_best.py show DATA.csv FIGURE.png')
    work = collect if sys.argv[1] == 'collect' else show
    work(Path(sys.argv[2]), Path(sys.argv[3]))


if __name__ == '__main__':
    main()
