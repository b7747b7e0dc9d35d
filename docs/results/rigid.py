#!/usr/bin/env python3
"""Compares the engine `rigid` with pybullet: prints the tables of docs/results/rigid.md.

source setup/env.sh
docs/results/rigid.py runs/rigid docs/results/rigid.png
docs/results/rigid.py steps

Drives with given commands are made here; laps and trainings are read from the folder that
experiments/rigid.yaml has left. The second command prints the table of Bullet's steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
import json
import math
from pathlib import Path
import sys
import time
from typing import Any, NamedTuple

from matplotlib.axes import Axes
import numpy as np
from numpy.typing import NDArray
from shared.equivalence import draw_tests, equivalence_cells, EQUIVALENCE_COLUMNS
from shared.tables import print_row

from spikelane.statistics import equivalence_statistics, unit_means
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.learning.settling import has_settled, last_lane_loss_step
from spikelane_controllers.learning.training import Termination
from spikelane_sim.contract import WheelVelocities
from spikelane_sim.figure_style import (
    LEFT,
    new_figure,
    PALE_INK,
    RIGHT,
    save,
    SERIES,
    settings,
)
from spikelane_sim.robots import make_robot, RobotParameters

ENGINES = ('pybullet', 'rigid')
#: Length of Bullet's steps [s] and the largest number of its solver's iterations; the first ones
#: are the defaults, with which the others are compared.
BULLET = ((0.005, 50), (0.005, 20), (0.01, 50), (0.01, 20), (0.025, 50))
FASTEST_RAD_S = {'p3dx': 12.3, 'turtlebot4': 8.56}
DRIVES, STEPS = 20, 1000
#: Distances are told once so much of a path has been driven [m].
FROM_M = 0.3

#: Margins of ratios, rigid to pybullet; chosen before any result was looked at.
MARGINS = {'steps of a lap': 1.002, 'mean error of a lap': 1.10, 'last lane loss': 1.25}

#: Runs of the experiment; {} is the engine.
DRIVEN = {
    'Braitenberg': 'evaluate-braitenberg-1-{}',
    'R-STDP as trained': 'evaluate-rstdp-1-{}',
}
LEARNT = {
    "the paper's settings, scenario 1": 'train-rstdp-1-{}',
    'best camera setting, scenario 2': 'train-rstdp-2-{}-best',
}

Commands = Callable[[np.random.Generator, float], NDArray[np.float64]]


# ------------------------------------------------------------------------------ given commands


def _held(generator: np.random.Generator, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return commands of which each is held for 1 to 30 steps."""
    return np.repeat(values, generator.integers(1, 31, len(values)), axis=0)[:STEPS]


def _paper(generator: np.random.Generator, fastest: float) -> NDArray[np.float64]:
    del fastest
    middle = _held(generator, generator.uniform(0.5, 2.5, STEPS))
    half = _held(generator, generator.uniform(-0.5, 0.5, STEPS))
    return np.stack([middle - half, middle + half], axis=1)


def _forward(generator: np.random.Generator, fastest: float) -> NDArray[np.float64]:
    return _held(generator, generator.uniform(0.0, fastest, (STEPS, 2)))


def _anywhere(generator: np.random.Generator, fastest: float) -> NDArray[np.float64]:
    return _held(generator, generator.uniform(-fastest, fastest, (STEPS, 2)))


def _extremes(generator: np.random.Generator, fastest: float) -> NDArray[np.float64]:
    return _held(
        generator, generator.choice([-1.0, -1 / 3, 0.0, 1 / 3, 1.0], (STEPS, 2)) * fastest
    )


KINDS: Mapping[str, Commands] = {
    '0.5 to 2.5 rad/s, differing by up to 1': _paper,
    'forwards, up to the fastest': _forward,
    'either way, up to the fastest': _anywhere,
    'from one extreme to another': _extremes,
}


class Drive(NamedTuple):
    """How far two robots with the same commands are apart."""

    path_m: NDArray[np.float64]  # of the one in pybullet, after each step
    apart_m: NDArray[np.float64]  # the places of base_link

    @property
    def most_percent(self) -> float:
        """Largest distance, of the path until then."""
        counted = self.path_m > FROM_M
        return float((100 * self.apart_m[counted] / self.path_m[counted]).max())


def places(commands: NDArray[np.float64], **parameters: Any) -> NDArray[np.float64]:
    """Drive a robot; return where its base_link is before and after each step [m], (n + 1, 2)."""
    robot = make_robot(RobotParameters.from_mapping(parameters))
    poses = [robot.step(WheelVelocities(*pair)) for pair in commands.tolist()]
    robot.close()
    return np.concatenate([np.zeros((1, 2)), np.concatenate(poses)[:, :2]])


def compared(one: NDArray[np.float64], other: NDArray[np.float64]) -> Drive:
    """Compare the places of a robot with those of one in pybullet."""
    path_m = np.hypot(*np.diff(other, axis=0).T).cumsum()
    return Drive(path_m, np.hypot(*(one - other)[1:].T))


def drive(model: str, commands: NDArray[np.float64]) -> Drive:
    """Drive both robots."""
    pybullet, rigid = (places(commands, model=model, engine=engine) for engine in ENGINES)
    return compared(rigid, pybullet)


def print_steps() -> None:
    """Drive with other steps and iterations of Bullet; print a row for each."""
    print_row('step', 'iterations', 'processor time', *KINDS)
    print_row(*['---'] * (3 + len(KINDS)))
    spent_s = dict.fromkeys(BULLET, 0.0)
    apart: dict[tuple[str, Any], list[Drive]] = {}
    for kind, commands in KINDS.items():
        for seed in range(DRIVES):
            given = commands(np.random.default_rng(seed), FASTEST_RAD_S['p3dx'])
            driven = {}
            for step_s, iterations in BULLET:
                own = {'physics_step_s': step_s, 'solver_iterations': iterations}
                begin_s = time.process_time()
                driven[step_s, iterations] = places(given, pybullet=own)
                spent_s[step_s, iterations] += time.process_time() - begin_s
            for setting in BULLET[1:]:
                found = compared(driven[setting], driven[BULLET[0]])
                apart.setdefault((kind, setting), []).append(found)
    for setting in BULLET[1:]:
        percents = [[each.most_percent for each in apart[kind, setting]] for kind in KINDS]
        print_row(
            f'{1000 * setting[0]:g} ms',
            str(setting[1]),
            f'{spent_s[setting] / spent_s[BULLET[0]]:.2f}',
            *(f'{np.median(each):.3f} ({max(each):.3f})' for each in percents),
        )


def print_drives() -> dict[str, list[Drive]]:
    """Drive and print a row for each robot and kind of commands; return those of the P3-DX."""
    print_row('robot', 'commands', 'path', 'apart at most, % of the path: median (largest)')
    print_row(*['---'] * 4)
    kept = {}
    for model, fastest in FASTEST_RAD_S.items():
        for kind, commands in KINDS.items():
            drives = [
                drive(model, commands(np.random.default_rng(seed), fastest))
                for seed in range(DRIVES)
            ]
            percent = [each.most_percent for each in drives]
            path_m = sum(float(each.path_m[-1]) for each in drives)
            print_row(
                model, kind, f'{path_m:.0f} m', f'{np.median(percent):.4f} ({max(percent):.4f})'
            )
            if model == 'p3dx':
                kept[kind] = drives
    print()
    return kept


# ------------------------------------------------------------------------------ the closed loop


class Pair(NamedTuple):
    """A value of the same seed with both engines."""

    unit: tuple[str, int]  # whose, and the seed
    group: str
    pybullet: float
    rigid: float

    @property
    def log_ratio(self) -> float:
        """Log of rigid to pybullet."""
        return math.log(self.rigid / self.pybullet)


Folders = tuple[Path, Path]


def runs_of(folder: Path, name: str) -> Iterator[tuple[int, Folders]]:
    """Yield the seeds whose runs are finished with both engines, and their folders."""
    for seed in range(1000):
        first, second = (folder / f'{name.format(engine)}-seed{seed}' for engine in ENGINES)
        if all((path / 'metrics.json').exists() for path in (first, second)):
            yield seed, (first, second)


def lap_pairs(folder: Path, quantity: str) -> list[Pair]:
    """Return a quantity of all laps that both engines completed."""
    found = []
    for who, name in DRIVEN.items():
        for seed, paths in runs_of(folder, name):
            for first, second in zip(*map(_laps, paths), strict=True):
                assert (first['lane'], first['seed']) == (second['lane'], second['seed'])
                if first['completed'] and second['completed']:
                    group = f'{who}, {first["lane"]} lane'
                    found.append(Pair((who, seed), group, first[quantity], second[quantity]))
    return found


def _laps(path: Path) -> list[dict[str, Any]]:
    laps: list[dict[str, Any]] = json.loads((path / 'metrics.json').read_text('utf-8'))['laps']
    return laps


def print_completed(folder: Path) -> None:
    """Say how many laps were completed and trainings have settled, engine by engine."""
    for who, name in DRIVEN.items():
        runs = list(runs_of(folder, name))
        for index, engine in enumerate(ENGINES):
            laps = [lap for _, paths in runs for lap in _laps(paths[index])]
            completed = sum(lap['completed'] for lap in laps)
            print(f'- {who}, {engine}: {completed} of {len(laps)} laps completed')
    for setting, name in LEARNT.items():
        runs = list(runs_of(folder, name))
        for index, engine in enumerate(ENGINES):
            settled = sum(has_settled(_terminations(paths[index])) for _, paths in runs)
            print(f'- {setting}, {engine}: {settled} of {len(runs)} trainings settled')
    print()


def learning_pairs(folder: Path) -> list[Pair]:
    """Return the last lane losses of all pairs of trainings.

    A training that has not settled when it ends counts with the last loss until then, as both
    engines' trainings are equally long: leaving such trainings out would select among them.
    """
    found = []
    for setting, name in LEARNT.items():
        for seed, paths in runs_of(folder, name):
            losses = [float(last_lane_loss_step(_terminations(path))) for path in paths]
            found.append(Pair((setting, seed), setting, *losses))
    return found


def _terminations(path: Path) -> list[Termination]:
    facts = read_checkpoint(path, 'rstdp').facts
    return [Termination(*each) for each in facts['terminations']]


def print_equivalence(quantity: str, pairs: list[Pair]) -> list[tuple[str, dict[str, Any]]]:
    """Print a row for each group, and for all of them; return what was found."""
    results = []
    margin = MARGINS[quantity]
    groups = list(dict.fromkeys(pair.group for pair in pairs))
    for group in [*groups, 'all']:
        chosen = [pair for pair in pairs if group in (pair.group, 'all')]
        # The laps of one training share its weights: units, not laps, are independent.
        ratios = unit_means([pair.log_ratio for pair in chosen], [pair.unit for pair in chosen])
        found = equivalence_statistics(ratios, math.log(margin))
        means = (
            f'{np.mean([getattr(pair, engine) for pair in chosen]):,.4g}' for engine in ENGINES
        )
        print_row(
            *(quantity, group, str(found['n']), *means),
            *equivalence_cells(found, margin, '.4f'),
        )
        results.append((f'{quantity}: {group}', found))
    return results


# ---------------------------------------------------------------------------------- the figure


def draw(
    path: Path,
    drives: Mapping[str, list[Drive]],
    tests: list[tuple[str, dict[str, Any]]],
    losses: list[Pair],
) -> None:
    """Draw drives, learning times and tests."""
    with settings():
        figure = new_figure(9.0, 8.0)
        figure.set_layout_engine('constrained')
        axes = figure.subplot_mosaic([['drives', 'losses'], ['tests', 'tests']])
        _draw_drives(axes['drives'], drives)
        _draw_losses(axes['losses'], losses)
        draw_tests(axes['tests'], tests, 'rigid to pybullet')
        axes['tests'].set_title('The closed loop')
        save(figure, path)


def _draw_drives(axes: Axes, drives: Mapping[str, list[Drive]]) -> None:
    for (kind, found), colour in zip(drives.items(), SERIES, strict=True):
        for index, each in enumerate(found):
            shown = each.path_m > FROM_M
            axes.loglog(
                each.path_m[shown],
                1e3 * each.apart_m[shown],
                color=colour,
                linewidth=0.6,
                alpha=0.7,
                label=None if index else kind,
            )
    path_m = np.array([FROM_M, 30.0])
    for percent in (0.02, 0.2):
        axes.loglog(path_m, 10 * percent * path_m, color=PALE_INK, linewidth=0.9, linestyle='--')
        axes.annotate(f'{percent} %', (path_m[-1], 10 * percent * path_m[-1]), color=PALE_INK)
    axes.set(xlabel='path [m]', ylabel='apart [mm]', title='The same commands, P3-DX')
    axes.legend(fontsize=7, frameon=False, loc='lower right')


def _draw_losses(axes: Axes, losses: list[Pair]) -> None:
    for setting, linestyle in zip(LEARNT, ('-', '--'), strict=True):
        for engine, colour in zip(ENGINES, (RIGHT, LEFT), strict=True):
            values = sorted(getattr(pair, engine) for pair in losses if pair.group == setting)
            if values:
                share = 1 - np.arange(len(values) + 1) / len(values)
                label = f'{setting}, {engine}'
                axes.step(
                    [0, *values],
                    share,
                    where='post',
                    color=colour,
                    linestyle=linestyle,
                    label=label,
                )
    axes.set(
        xlabel='last lane loss [steps]',
        ylabel='share of trainings yet to come to it',
        title='R-STDP learns',
    )
    axes.legend(fontsize=6, frameon=False, loc='upper right')


def main() -> None:
    """Print the tables and draw the figure."""
    if sys.argv[1:] == ['steps']:
        print_steps()
        return
    if len(sys.argv) != 3:
        sys.exit('usage: rigid.py FOLDER FIGURE.png | rigid.py steps')
    folder, figure = map(Path, sys.argv[1:])
    drives = print_drives()
    print_completed(folder)
    pairs = {
        'steps of a lap': lap_pairs(folder, 'steps'),
        'mean error of a lap': lap_pairs(folder, 'mean_abs_distance_m'),
        'last lane loss': learning_pairs(folder),
    }
    print_row('quantity', 'of', 'units', 'pybullet', 'rigid', *EQUIVALENCE_COLUMNS)
    print_row(*['---'] * 9)
    tests = [
        row for name, found in pairs.items() if found for row in print_equivalence(name, found)
    ]
    draw(figure, drives, tests, pairs['last lane loss'])


if __name__ == '__main__':
    main()
