"""The tables and the figure of speed.py."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
import pandas as pd
from shared.tables import mean_error, mean_text, print_row, table_header
from speed_settings import P3DX, PERIODS_MS, SHIPPED, TRAINED

from spikelane_controllers.registry import title
from spikelane_sim.figure_style import (
    INK,
    LEFT,
    new_figure,
    PALE_INK,
    RIGHT,
    save,
    SERIES,
    settings,
    write_title,
)

#: Share of laps completed from which on their mean error is drawn.
ALMOST_ALL = 0.8
#: Parts of the data with laps of what was trained at the speed.
GOALS = (
    'goal',
    'networks',
    *(f'racer {scenario}' for scenario in (1, 2, 3)),
)
COLOURS = {'rstdp': LEFT, 'braitenberg': INK, 'dqn': RIGHT, 'dqn_snn': SERIES[2]}


def show(data: pd.DataFrame, path: Path) -> None:
    """Print the tables and draw the figure."""
    data = data.assign(completed=data['completed'].astype(bool))
    columns = ('controller', 'engine', 'scenario', 'lane', 'laps', 'mean speed', 'mean error')
    print(table_header(*columns))
    for part in GOALS:
        of = data[data['part'] == part]
        for _, laps in of.groupby(['controller', 'engine', 'scenario', 'lane'], sort=False):
            print_row(*goal_cells(laps))
    print()
    table = highest(data)
    rows = table.pivot_table(
        index=['controller', 'weights'], columns=['latency_ms', 'period_ms'], values='asked_m_s'
    )
    print(rows.round(2).to_string())
    with settings():
        figure = new_figure(9.4, 4.4)
        write_title(figure, "Laps of the paper's course by speed", 'mean of both lanes')
        draw_errors(figure.add_axes((0.07, 0.28, 0.5, 0.6)), data)
        draw_highest(figure.add_axes((0.69, 0.28, 0.29, 0.6)), table)
        save(figure, path)


def goal_cells(laps: pd.DataFrame) -> list[str]:
    """Return a row of the table: one setting and lane, over seeds."""
    first, done = laps.iloc[0], laps[laps['completed']]
    robot = '' if first['robot'] == P3DX else ', racer'
    cells = [title(first['controller']) + robot, first['engine'], first['scenario']]
    cells += [first['lane'], f'{len(done)} of {len(laps)}']
    error = mean_error(laps)
    if error is None:
        return [*map(str, cells), 'none', 'none']
    text = f'{mean_text(error, ".1f", 1000)}, at most {error["max"] * 1000:.1f} mm'
    return [*map(str, cells), f'{done["speed_m_s"].mean():.2f} m/s', text]


def highest(data: pd.DataFrame) -> pd.DataFrame:
    """Return the highest speed asked for with which all laps were completed; 0 for none."""
    is_goal = data['part'].isin(['goal', 'networks']) & (data['engine'] == 'rigid')
    of = data[data['part'].str.startswith('map') | is_goal]
    keys = ['controller', 'weights', 'period_ms', 'latency_ms']
    every = of.groupby([*keys, 'asked_m_s'])['completed'].all().reset_index()
    every['asked_m_s'] = every['asked_m_s'].where(every['completed'], 0.0)
    return every.groupby(keys)['asked_m_s'].max().reset_index()


def draw_errors(axes: Axes, data: pd.DataFrame) -> None:
    """Draw the errors in scenario 1 over the speed, where all laps were completed."""
    of = data[(data['scenario'] == 1) & (data['engine'] == 'rigid') & (data['latency_ms'] == 0)]
    # The shipped weights with a period of 50 ms, those of R-STDP that are trained with 10 ms.
    is_shipped = of['weights'] == SHIPPED
    of = of[(is_shipped & (of['period_ms'] == 50)) | (~is_shipped & (of['part'].str[:3] != 'map'))]
    # R-STDP at the top speed is in two parts: `goal` has all seeds.
    of = of.sort_values('part', key=lambda each: each == 'errors', kind='stable')
    of = of.drop_duplicates(['controller', 'weights', 'asked_m_s', 'lane', 'seed', 'robot'])
    of = of.assign(error_m=of['error_m'].where(of['completed']))
    for (controller, weights), rows in of.groupby(['controller', 'weights']):
        points = rows.groupby(['robot', 'asked_m_s']).agg(
            speed=('speed_m_s', 'mean'), error=('error_m', 'mean'), done=('completed', 'mean')
        )
        points = points[points['done'] >= ALMOST_ALL].sort_values('speed')
        is_trained = weights == TRAINED
        axes.plot(
            points['speed'], points['error'] * 1000, color=COLOURS[controller],
            marker='o' if is_trained else 'x', linestyle='none' if is_trained else ':',
            label=f'{title(controller)}, {weights}', linewidth=1.3,
            markersize=8.5 if controller == 'dqn' else 5.5,  # the DQN-SNN may lie on it
        )  # fmt: skip
    axes.axvline(1.2, color=PALE_INK, linewidth=0.8)
    axes.annotate(
        'limit of the P3-DX', (1.2, 0.0), xycoords=('data', 'axes fraction'), fontsize=8,
        color=PALE_INK, ha='right', va='bottom', xytext=(-4, 3), textcoords='offset points',
    )  # fmt: skip
    axes.annotate(
        'racer', (4.06, 0.0), xycoords=('data', 'axes fraction'), fontsize=8, color=PALE_INK,
        ha='center', va='bottom', xytext=(0, 3), textcoords='offset points',
    )  # fmt: skip
    axes.set_xscale('log')
    axes.set_xlim(0.1, 5)
    ticks = (0.1, 0.2, 0.5, 1, 2, 4)
    axes.set_xticks(ticks, [f'{tick:g}' for tick in ticks])
    axes.minorticks_off()
    axes.set_ylim(bottom=0)
    axes.set_xlabel('mean speed of the laps of scenario 1 [m/s]')
    axes.set_ylabel('mean error [mm]')
    axes.legend(
        loc='upper left', bbox_to_anchor=(-0.1, -0.2), ncols=4, frameon=False, fontsize=7.5
    )


def draw_highest(axes: Axes, table: pd.DataFrame) -> None:
    """Draw the highest speed by control period, without latency."""
    of = table[table['latency_ms'] == 0]
    for number, ((controller, weights), rows) in enumerate(of.groupby(['controller', 'weights'])):
        places = [PERIODS_MS.index(period) + 0.06 * (number - 2) for period in rows['period_ms']]
        axes.plot(
            places, rows['asked_m_s'], color=COLOURS[controller],
            marker='o' if weights == TRAINED else 'x', linestyle='none', markersize=6,
        )  # fmt: skip
    axes.set_xticks(range(len(PERIODS_MS)), [str(period) for period in PERIODS_MS])
    axes.set_ylim(-0.05, 1.3)
    axes.set_xlabel('control period [ms]')
    axes.set_ylabel('highest speed with which all\nlaps are completed [m/s]')
    axes.grid(axis='y', linewidth=0.4)
