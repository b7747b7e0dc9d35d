#!/usr/bin/env python3
"""Compares trainings of deep Q-learning in pairs: prints the tables of docs/results/q_learning.md.

source setup/env.sh
docs/results/q_learning.py runs/q_learning docs/results/q_learning.png
docs/results/q_learning.py runs/physics_step docs/results/physics_step.png

Trainings and laps are read from the folder that the experiment of this name has left. What is
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


class Comparison(NamedTuple):
    """Two variants of an experiment."""

    engine: str
    varied: str  # column of the data
    titles: dict[str, str]  # of the variants; the second one is compared with the first one
    ratio: str


COMPARISONS = {
    'q_learning': Comparison(
        'rigid', 'backend', {'torch': 'PyTorch', 'numba': 'Numba'}, 'Numba to PyTorch'
    ),
    'physics_step': Comparison(
        'pybullet', 'physics_step', {'5ms': '5 ms', '10ms': '10 ms'}, '10 ms to 5 ms'
    ),
}
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


def read(folder: Path, name: str, seed: int) -> Learnt:
    """Read a training, by its engine and variant, and its laps."""
    path = folder / f'train-dqn-1-{name}-seed{seed}'
    facts = read_checkpoint(path, 'dqn').facts
    metrics = json.loads((path / 'metrics.json').read_text('utf-8'))
    (laps,) = folder.glob(f'evaluate-dqn-1-{name}-*seed{seed}/metrics.json')
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


def compare(
    comparison: Comparison, learnt: dict[str, list[Learnt]]
) -> list[tuple[str, dict[str, Any]]]:
    """Print and return the tests of equivalence."""
    tests = []
    print_row('quantity', *comparison.titles.values(), *EQUIVALENCE_COLUMNS)
    print_row(*['---'] * 7)
    for name, _, value, margin, form in QUANTITIES:
        pairs = np.array([[value(each) for each in found] for found in learnt.values()])
        found = equivalence_statistics(np.log(pairs[1] / pairs[0]).tolist(), math.log(margin))
        tests.append((name, found))
        print_row(
            name,
            *(range_text(each.mean(), each.min(), each.max(), form) for each in pairs),
            *equivalence_cells(found, margin, '.3f'),
        )
    return tests


def write_data(path: Path, varied: str, learnt: dict[str, list[Learnt]]) -> None:
    """Write what is compared, a row for each training."""
    rows = [
        {
            varied: name,
            'seed': seed,
            'solved': each.is_solved,
            'laps_completed': len(each.errors_m),
            **{quantity.column: quantity.value(each) for quantity in QUANTITIES},
            'processor_s': each.cpu_s,
        }
        for name, trainings in learnt.items()
        for seed, each in zip(SEEDS, trainings, strict=True)
    ]
    pd.DataFrame(rows).to_csv(path, index=False)


def draw(
    path: Path,
    comparison: Comparison,
    learnt: dict[str, list[Learnt]],
    tests: list[tuple[str, dict[str, Any]]],
) -> None:
    """Draw the learning curves and the tests."""
    with settings():
        figure = new_figure(9.6, 3.6)
        figure.set_layout_engine('constrained')
        curves, margins = figure.subplots(1, 2)
        _draw_curves(curves, comparison, learnt)
        draw_tests(margins, tests, comparison.ratio)
        margins.set_xlabel(f'log ratio, {comparison.ratio}\n(in parts of its margin; 90 %)')
        margins.set_title('Equivalence')
        save(figure, path)


def _draw_curves(axes: Axes, comparison: Comparison, learnt: dict[str, list[Learnt]]) -> None:
    for (name, found), colour in zip(learnt.items(), (RIGHT, LEFT), strict=True):
        curves = np.array([each.curve for each in found])
        actions = (np.arange(curves.shape[1]) + 0.5) * WINDOW
        for curve in curves:
            axes.plot(actions, curve, color=colour, linewidth=0.5, alpha=0.4)
        axes.plot(
            actions, curves.mean(0), color=colour, linewidth=2, label=comparison.titles[name]
        )
    axes.set(
        xlabel='action steps',
        ylabel=f'reward of an action, mean of {WINDOW:,}',
        title=f'Trainings of {len(SEEDS)} seeds, and their means',
    )
    axes.legend(frameon=False, loc='lower right')


def main() -> None:
    """Print the tables and draw the figure."""
    folder, figure = map(Path, sys.argv[1:3])
    comparison = COMPARISONS[figure.stem]
    learnt = {
        name: [read(folder, f'{comparison.engine}-{name}', seed) for seed in SEEDS]
        for name in comparison.titles
    }
    for name, found in learnt.items():
        laps = sum(len(each.errors_m) for each in found)
        solved = sum(each.is_solved for each in found)
        cpu_us = 1e6 * sum(each.cpu_s for each in found) / sum(each.actions for each in found)
        print(
            f'- {comparison.titles[name]}: {solved} of {len(found)} solved, {laps} laps '
            f'completed, {cpu_us:.0f} µs of processor time for an action'
        )
    print()
    write_data(figure.with_suffix('.csv'), comparison.varied, learnt)
    draw(figure, comparison, learnt, compare(comparison, learnt))


if __name__ == '__main__':
    main()
