#!/usr/bin/env python3
"""Changes the robot or what it sees while it drives: data, tables and figure of perturbations.md.

source setup/env.sh; docs/results/perturbations.py drive docs/results/perturbations.csv
source setup/env.sh; docs/results/perturbations.py show docs/results/perturbations.csv FIGURE.png

The first command drives what the file lacks, change by change; it is deterministic. The second one
prints the table and draws the figure from the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
import sys
from typing import Any

from matplotlib.axes import Axes
import numpy as np
from numpy.typing import NDArray
import pandas as pd
from shared.driving import fleet_laps, host, LANES, LAP_SEED, single_lap
from shared.parts import add_missing
from shared.tables import error_text, print_row, range_text, table_header

from spikelane.fleet import Fleet
from spikelane_controllers.registry import make_controller
from spikelane_sim.contract import TERMINATED_LAPS_COMPLETE
from spikelane_sim.figure_style import (
    INK,
    LEFT,
    new_figure,
    PALE_INK,
    RIGHT,
    save,
    settings,
    write_title,
)

#: What changes, with its words.
CHANGES = {
    'nothing': (),
    'left wheel 10 % smaller': ('robot.left_wheel_factor=0.9',),
    'left wheel 20 % smaller': ('robot.left_wheel_factor=0.8',),
    'camera turned by 3°': ('camera.yaw_deg=3',),
    'camera turned by 5°': ('camera.yaw_deg=5',),
    'contrast halved': ('camera.contrast=0.5',),
    'edge lines gone': ('markings=scenario_2',),
    '30 % of pixels dead': ('pixels.dead_share=0.3',),
    'latency of 100 ms more': ('link.latency_ms=100',),
}
#: When, after the beginning of the drive: on the first quarter of the lap.
TIME_S = 60.0
SEEDS = range(10)
#: Steps that R-STDP drives with learning on, and of these the ones before the change.
LEARNING_STEPS = 21_200
CHANGE_STEP = 1_200
#: While it learns, the distance is sampled this often, and its mean taken over a window [steps].
SAMPLED, WINDOW = 10, 400
#: Changes whose recovery is drawn.
SHOWN = (
    'left wheel 20 % smaller',
    'camera turned by 5°',
    '30 % of pixels dead',
    'edge lines gone',
)
WHILE_LEARNING, CURVE = 'R-STDP, learning on', 'R-STDP, mean distance while it learns'


def main() -> None:
    """Drive, or show."""
    if len(sys.argv) < 3 or sys.argv[1] not in ('drive', 'show'):
        sys.exit('usage: perturbations.py drive DATA.csv | perturbations.py show DATA.csv FIGURE')
    data = Path(sys.argv[2])
    if sys.argv[1] == 'show':
        show(pd.read_csv(data), Path(sys.argv[3]))
        return
    parts = {name: partial(measure, changes) for name, changes in CHANGES.items()}
    add_missing(data, 'change', parts)


def measure(changes: Sequence[str]) -> list[dict[str, Any]]:
    """Return a row for each drive: who drove, and how it went."""
    rows = []
    shipped = [shipped_weights()] * len(SEEDS)
    for lane in LANES:
        rows += laps('R-STDP, learning off', shipped, lane, changes, TIME_S)
        rows.append(dqn_lap(lane, changes))
    learnt, learning = learn(changes)
    rows += learning
    for lane in LANES:
        rows += laps('R-STDP, after learning', learnt, lane, changes, 0.0)
    return rows


def simulator(changes: Sequence[str], time_s: float, **others: Any) -> dict[str, Any]:
    """Return the parameters of a simulator that changes."""
    change = {'perturbation.changes': list(changes), 'perturbation.time_s': time_s}
    return {'robot.engine': 'rigid', **change, **others}


def shipped_weights() -> NDArray[np.float64]:
    """Return the weights shipped for scenario 1 [pA]."""
    controller: Any = make_controller('rstdp')
    return np.array(controller.weights_pa)


def laps(
    who: str,
    weights: Sequence[NDArray[np.float64]],
    lane: str,
    changes: Sequence[str],
    time_s: float,
) -> list[dict[str, Any]]:
    """Drive a lap with each robot's weights, learning off."""
    seeds = [LAP_SEED + seed for seed in SEEDS]
    with Fleet('rstdp', seeds, simulator=simulator(changes, time_s)) as fleet:
        host(fleet, weights)
        driven = fleet_laps(fleet, [lane] * len(seeds))
    begin = round(time_s / 0.05)
    return [
        {'who': who, 'seed': seed, 'lane': lane, **each.result(begin)}
        for seed, each in zip(SEEDS, driven, strict=True)
    ]


def dqn_lap(lane: str, changes: Sequence[str]) -> dict[str, Any]:
    """Drive a lap with the Q-network shipped, which has no randomness of its own."""
    driven = single_lap(simulator(changes, TIME_S), make_controller('dqn'), lane, LAP_SEED)
    return {'who': 'DQN', 'seed': 0, 'lane': lane, **driven.result(CHANGE_STEP)}


def learn(changes: Sequence[str]) -> tuple[list[NDArray[np.float64]], list[dict[str, Any]]]:
    """Go on learning from the weights shipped, over episodes that end at 0.2 m.

    Returns:
        The weights at the end, and rows: for each robot how often it lost the lane after the
        change, and when for the last time, in steps since the change; and for each window the
        mean distance from the lane's centre over all robots.
    """
    losses, last = [0] * len(SEEDS), [0] * len(SEEDS)
    distances: list[NDArray[np.float64]] = []
    course = simulator(changes, TIME_S, **{'episode.max_distance_m': 0.2})
    on = {'learning': True}
    with Fleet('rstdp', SEEDS, simulator=course, parameters=on) as fleet:
        host(fleet, [shipped_weights()] * len(SEEDS))
        for step in range(SAMPLED, LEARNING_STEPS + 1, SAMPLED):
            for end in fleet.drive(SAMPLED):
                if end.lane_state.reason != TERMINATED_LAPS_COMPLETE:
                    losses[end.robot] += 1
                    last[end.robot] = step - CHANGE_STEP
            distances.append(np.abs(fleet.simulators.robots.known['distance_m']))
        weights = [np.array(fleet.controller(robot).weights_pa) for robot in range(len(SEEDS))]
    rows = [
        {'who': WHILE_LEARNING, 'seed': seed, 'losses': n, 'last_loss_step': step}
        for seed, n, step in zip(SEEDS, losses, last, strict=True)
    ]
    return weights, rows + curve(np.array(distances))


def curve(distances_m: NDArray[np.float64]) -> list[dict[str, Any]]:
    """Return rows with the mean distance in each window, of samples (n, robots)."""
    means = distances_m.reshape(-1, WINDOW // SAMPLED, len(SEEDS)).mean(axis=(1, 2))
    ends = np.arange(1, len(means) + 1) * WINDOW - CHANGE_STEP
    return [
        {'who': CURVE, 'step': int(end), 'error_m': float(mean)}
        for end, mean in zip(ends, means, strict=True)
    ]


def lap_cell(rows: pd.DataFrame) -> str:
    """Return laps completed and the mean error of these, with its interval over seeds."""
    done = rows[rows['completed'].astype(bool)]
    text = f'{len(done)} of {len(rows)}'
    return text if done.empty else f'{text}, {error_text(done)}'


def show(data: pd.DataFrame, path: Path) -> None:
    """Print the table and draw the figure."""
    print(
        table_header(
            *('change', 'DQN', 'R-STDP, learning off', 'learning on: lane losses'),
            *('last loss, steps after the change', 'R-STDP, after learning'),
        )
    )
    for name in [each for each in CHANGES if each in set(data['change'])]:
        of = data[data['change'] == name]
        by = {who: of[of['who'] == who] for who in of['who'].unique()}
        on = by[WHILE_LEARNING]
        last = on['last_loss_step']
        cells = [
            name,
            lap_cell(by['DQN']),
            lap_cell(by['R-STDP, learning off']),
            f'{on["losses"].mean():.1f} ({on["losses"].min():.0f} to {on["losses"].max():.0f})',
            range_text(last.median(), last.min(), last.max(), ',.0f')
            if on['losses'].any()
            else 'none',
            lap_cell(by['R-STDP, after learning']),
        ]
        print_row(*cells)
    draw(data, path)


def draw(data: pd.DataFrame, path: Path) -> None:
    """Draw the errors of the laps with each change, and how learning recovers."""
    names = [each for each in CHANGES if each in set(data['change'])]
    with settings():
        figure = new_figure(9.4, 4.6)
        write_title(figure, 'Scenario 1: a change after 60 s of driving', 'rigid robot')
        _draw_errors(figure.add_axes((0.19, 0.23, 0.34, 0.64)), data, names)
        _draw_curves(figure.add_axes((0.61, 0.23, 0.355, 0.64)), data)
        save(figure, path)


def _draw_errors(axes: Axes, data: pd.DataFrame, names: Sequence[str]) -> None:
    series = (
        ('DQN', INK, 'x', -0.25),
        ('R-STDP, learning off', LEFT, 'o', 0.0),
        ('R-STDP, after learning', RIGHT, 's', 0.25),
    )
    lost = 0.047
    for who, colour, marker, offset in series:
        of = data[data['who'] == who]
        for number, name in enumerate(names):
            laps_of = of[of['change'] == name]
            done = laps_of[laps_of['completed'].astype(bool)]['error_m']
            place = number + offset
            axes.plot(
                [done.mean() if len(done) else lost], [place],
                color=colour, marker=marker, linestyle='none', markersize=5,
                label=who if number == 0 else None,
            )  # fmt: skip
            if len(done) < len(laps_of):
                text = f'{len(done)} of {len(laps_of)} laps '
                axes.annotate(
                    text, (lost, place), fontsize=7, ha='right', va='center',
                    xytext=(-6, -12 * (offset + 0.1)), textcoords='offset points', color=colour,
                )  # fmt: skip
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(0, 0.05)
    axes.set_xlabel('mean error of the laps [m]')
    axes.grid(axis='y', linewidth=0.4)
    axes.legend(loc='upper left', bbox_to_anchor=(-0.6, -0.17), ncols=3, frameon=False)


def _draw_curves(axes: Axes, data: pd.DataFrame) -> None:
    of = data[data['who'] == CURVE]
    for name, colour in zip(SHOWN, (INK, LEFT, RIGHT, PALE_INK), strict=True):
        rows = of[of['change'] == name]
        axes.plot(rows['step'], rows['error_m'], color=colour, linewidth=1.5, label=name)
    axes.axvline(0, color=PALE_INK, linewidth=0.8)
    axes.set_ylim(bottom=0)
    axes.set_xlim(-CHANGE_STEP, LEARNING_STEPS - CHANGE_STEP)
    axes.set_xticks(range(0, LEARNING_STEPS - CHANGE_STEP + 1, 5000))
    axes.set_xlabel('steps of 50 ms after the change, learning on')
    axes.set_ylabel(f'mean distance in {WINDOW} steps [m]')
    axes.legend(loc='upper right', frameon=False, fontsize=7)


if __name__ == '__main__':
    main()
