#!/usr/bin/env python3
"""Compares Numba with PyTorch in deep Q-learning: prints the tables of docs/results/q_learning.md.

source setup/env.sh; docs/results/q_learning.py runs/q_learning docs/results/q_learning.png

Trainings and laps are read from the folder that experiments/q_learning.yaml has left. What is
compared is also written next to the figure, as CSV with a row for each training.
"""

from __future__ import annotations

from collections.abc import Callable
import json
import math
from pathlib import Path
import sys
from typing import Any, NamedTuple

from matplotlib.axes import Axes
import numpy as np
from numpy.typing import NDArray
import pandas as pd
from shared.equivalence import draw_tests, equivalence_cells, EQUIVALENCE_COLUMNS
from shared.tables import print_row, range_text

from spikelane.statistics import equivalence_statistics
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_sim.figure_style import (
    LEFT,
    new_figure,
    RIGHT,
    save,
    settings,
)

BACKENDS = ('torch', 'numba')
TITLES = {'torch': 'PyTorch', 'numba': 'Numba'}
SEEDS = range(10)
#: Actions over which rewards are averaged in the curve.
WINDOW = 2000


class Learnt(NamedTuple):
    """What a training came to."""

    curve: NDArray[np.float64]  # mean reward of an action in each window
    solved_step: float  # the training's end where it was not solved
    is_solved: bool
    errors_m: list[float]  # of the laps that were completed
    cpu_s: float
    actions: int


class Quantity(NamedTuple):
    """What is compared; the margin is of the ratio, and was chosen before any result was seen."""

    name: str
    column: str  # of the data
    value: Callable[[Learnt], float]
    margin: float
    form: str


QUANTITIES = (
    Quantity(
        'mean reward of an action, whole training',
        'reward_per_action',
        lambda e: e.curve.mean(),
        1.1,
        '.3f',
    ),
    Quantity(
        'the same, last 10,000 actions',
        'late_reward_per_action',
        lambda e: e.curve[-10_000 // WINDOW :].mean(),
        1.1,
        '.3f',
    ),
    Quantity('action step when solved', 'solved_step', lambda e: e.solved_step, 1.15, ',.0f'),
    Quantity(
        'mean error of the laps [m]',
        'error_m',
        lambda e: float(np.mean(e.errors_m)),
        1.25,
        '.4f',
    ),
)


def read(folder: Path, backend: str, seed: int) -> Learnt:
    """Read a training and its laps."""
    path = folder / f'train-dqn-1-rigid-{backend}-seed{seed}'
    facts = read_checkpoint(path, 'dqn').facts
    metrics = json.loads((path / 'metrics.json').read_text('utf-8'))
    laps = folder / f'evaluate-dqn-1-rigid-{backend}-seed{seed}' / 'metrics.json'
    errors_m = [
        lap['mean_abs_distance_m']
        for lap in json.loads(laps.read_text('utf-8'))['laps']
        if lap['completed']
    ]
    solved = metrics['solved_by']
    cpu = json.loads((path / 'processor_time.json').read_text('utf-8'))['processor_s']
    return Learnt(
        curve_of(facts),
        solved or facts['steps'],
        solved is not None,
        errors_m,
        cpu,
        facts['steps'],
    )


def curve_of(facts: Any) -> NDArray[np.float64]:
    """Return the mean reward of an action in each window; an episode's is spread over it."""
    episodes = [each[:2] for each in facts['outcomes']] + [facts['present'][:2]]
    actions, rewards = np.array(episodes).T.cumsum(axis=1)
    ends = np.arange(0, facts['steps'] + 1, WINDOW)
    return np.diff(np.interp(ends, [0, *actions], [0, *rewards])) / WINDOW


def compare(learnt: dict[str, list[Learnt]]) -> list[tuple[str, dict[str, Any]]]:
    """Print and return the tests of equivalence."""
    tests = []
    print_row('quantity', *TITLES.values(), *EQUIVALENCE_COLUMNS)
    print_row(*['---'] * 7)
    for name, _, value, margin, form in QUANTITIES:
        pairs = np.array([[value(each) for each in learnt[backend]] for backend in BACKENDS])
        found = equivalence_statistics(np.log(pairs[1] / pairs[0]).tolist(), math.log(margin))
        tests.append((name, found))
        print_row(
            name,
            *(range_text(each.mean(), each.min(), each.max(), form) for each in pairs),
            *equivalence_cells(found, margin, '.3f'),
        )
    return tests


def write_data(path: Path, learnt: dict[str, list[Learnt]]) -> None:
    """Write what is compared, a row for each training."""
    rows = [
        {
            'backend': backend,
            'seed': seed,
            'solved': each.is_solved,
            'laps_completed': len(each.errors_m),
            **{quantity.column: quantity.value(each) for quantity in QUANTITIES},
            'processor_s': each.cpu_s,
        }
        for backend, trainings in learnt.items()
        for seed, each in zip(SEEDS, trainings, strict=True)
    ]
    pd.DataFrame(rows).to_csv(path, index=False)


def draw(
    path: Path, learnt: dict[str, list[Learnt]], tests: list[tuple[str, dict[str, Any]]]
) -> None:
    """Draw the learning curves and the tests."""
    with settings():
        figure = new_figure(9.6, 3.6)
        figure.set_layout_engine('constrained')
        curves, margins = figure.subplots(1, 2)
        _draw_curves(curves, learnt)
        draw_tests(margins, tests, 'Numba to PyTorch')
        margins.set_xlabel('log ratio, Numba to PyTorch\n(in parts of its margin; 90 %)')
        margins.set_title('Equivalence')
        save(figure, path)


def _draw_curves(axes: Axes, learnt: dict[str, list[Learnt]]) -> None:
    for backend, colour in zip(BACKENDS, (RIGHT, LEFT), strict=True):
        curves = np.array([each.curve for each in learnt[backend]])
        actions = (np.arange(curves.shape[1]) + 0.5) * WINDOW
        for curve in curves:
            axes.plot(actions, curve, color=colour, linewidth=0.5, alpha=0.4)
        axes.plot(actions, curves.mean(0), color=colour, linewidth=2, label=TITLES[backend])
    axes.set(
        xlabel='action steps',
        ylabel=f'reward of an action, mean of {WINDOW:,}',
        title=f'Trainings of {len(SEEDS)} seeds, and their means',
    )
    axes.legend(frameon=False, loc='lower right')


def main() -> None:
    """Print the tables and draw the figure."""
    folder, figure = map(Path, sys.argv[1:3])
    learnt = {backend: [read(folder, backend, seed) for seed in SEEDS] for backend in BACKENDS}
    for backend, found in learnt.items():
        laps = sum(len(each.errors_m) for each in found)
        solved = sum(each.is_solved for each in found)
        cpu_us = 1e6 * sum(each.cpu_s for each in found) / sum(each.actions for each in found)
        print(
            f'- {TITLES[backend]}: {solved} of {len(found)} solved, {laps} laps completed, '
            f'{cpu_us:.0f} µs of processor time for an action'
        )
    print()
    write_data(figure.with_suffix('.csv'), learnt)
    draw(figure, learnt, compare(learnt))


if __name__ == '__main__':
    main()
