#!/usr/bin/env python3
"""Trains R-STDP over 100 seeds in a fleet: the data, tables and figure of population.md.

source setup/env.sh; docs/results/population.py train docs/results/population.csv
source setup/env.sh; docs/results/population.py show docs/results/population.csv FIGURE.png

The first command trains and drives; it takes about a quarter of an hour of one core, and is
deterministic. The second one prints the tables and draws the figure from the data.
"""

from __future__ import annotations

from pathlib import Path
import sys
import tempfile
from typing import Any
import warnings

from matplotlib.axes import Axes
import numpy as np
from numpy.typing import NDArray
import pandas as pd
from scipy.stats import bootstrap, CensoredData, ecdf
from shared.driving import LANES, LAP_SEED
from shared.tables import print_row, range_text, table_header

from spikelane.fleet import Fleet
from spikelane.fleet.training import train_fleet
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import make_training
from spikelane_controllers.learning.settling import has_settled, last_lane_loss_step
from spikelane_controllers.learning.training import Training
from spikelane_controllers.registry import make_controller
from spikelane_sim.contract import TERMINATED_LAPS_COMPLETE
from spikelane_sim.figure_style import LEFT, new_figure, PALE_INK, RIGHT, save, settings

SEEDS = range(100)
#: Steps of a training by scenario, with the paper's settings and with the best camera setting.
STEPS = {'1': (30_000, 30_000), '2': (40_000, 30_000), '3': (120_000, 30_000)}
#: Where the paper's robot left its lane for the last time (about).
PAPER_STEPS = {'1': 10_000, '2': 14_000, '3': 75_000}
CAMERAS: dict[str, dict[str, Any]] = {
    'paper': {},
    'best': {
        'simulator.camera.antialias': True,
        'simulator.pixels.coppelia.threshold': 0.3,
        'rstdp.poisson.max_events': 30,
    },
}
COLOURS = {'paper': LEFT, 'best': RIGHT}


def train_setting(scenario: str, camera: str, folder: Path) -> list[dict[str, Any]]:
    """Train all seeds of a setting, and drive a lap of each lane with each."""
    parameters = {
        'simulator.robot.engine': 'rigid',
        'training.save_every': 10_000,  # changes no bit, and writes less
        **CAMERAS[camera],
    }
    steps = STEPS[scenario][list(CAMERAS).index(camera)]
    configs = [
        TrainConfig.make(Request(scenario, 'rstdp', seed, 'inprocess', parameters), steps)
        for seed in SEEDS
    ]
    trainings = []
    for seed, config in zip(SEEDS, configs, strict=True):
        path = folder / f'{scenario}-{camera}-{seed}'
        path.mkdir()
        trainings.append(make_training(config, RunFolder(path), resume=False))
    train_fleet(configs, trainings, lambda *_: None)
    rows = [
        {
            'scenario': scenario,
            'camera': camera,
            'seed': seed,
            'last_lane_loss_step': last_lane_loss_step(training.terminations),
            'settled': has_settled(training.terminations),
            'lane_losses': sum(e.reason == 'lane_lost' for e in training.terminations),
        }
        for seed, training in zip(SEEDS, trainings, strict=True)
    ]
    for lane in LANES:
        for row, (error_m, completed) in zip(
            rows, drive_laps(configs, trainings, lane), strict=True
        ):
            row |= {f'{lane}_error_m': error_m, f'{lane}_completed': completed}
    return rows


def drive_laps(
    configs: list[TrainConfig], trainings: list[Training], lane: str
) -> list[tuple[float, bool]]:
    """Drive a lap with each training's weights; return mean errors, and whether it is complete."""
    own = {**configs[0].controller_parameters.to_dict(), 'learning': False}
    seeds = [config.seed + LAP_SEED for config in configs]
    with Fleet('rstdp', seeds, simulator=configs[0].simulator, parameters=own) as fleet:
        for robot, training in enumerate(trainings):
            driver: Any = make_controller('rstdp', own)
            driver.restore(
                {**driver.state(), 'network.weights_pa': training.controller.weights_pa}
            )
            fleet.host(robot, driver, driver.reset)
        ends, table = fleet.lap(lane)
    errors = table['distance_m'].abs().groupby(table['robot']).mean()
    return [
        (float(errors[robot]), end.reason == TERMINATED_LAPS_COMPLETE)
        for robot, end in enumerate(ends)
    ]


def train(path: Path) -> None:
    """Train all settings and write the data."""
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for scenario in STEPS:
            for camera in CAMERAS:
                rows += train_setting(scenario, camera, Path(folder))
                print(f'scenario {scenario}, {camera}: done', file=sys.stderr)
    pd.DataFrame(rows).to_csv(path, index=False)


def interval(values: NDArray[np.float64]) -> str:
    """Return the median with its bootstrap interval (95 %), as text of the values' unit."""
    found = bootstrap((values,), np.median, rng=np.random.default_rng(0), method='percentile')
    low, high = found.confidence_interval
    median = float(np.median(values))
    return range_text(median, low, high, ',.0f' if median > 1 else '.4f')


def print_tables(data: pd.DataFrame) -> None:
    """Print a row for each scenario and camera setting."""
    columns = ['scenario', 'camera', 'settled', 'last lane loss: median (95 %)', '10 % to 90 %']
    for lane in LANES:
        columns += [f'{lane} laps', f'{lane} error [m]']
    print(table_header(*columns))
    for (scenario, camera), rows in data.groupby(['scenario', 'camera'], sort=False):
        steps = np.where(rows['settled'], rows['last_lane_loss_step'], np.inf)
        low, high = np.quantile(steps, [0.1, 0.9], method='inverted_cdf')
        cells = [
            str(scenario),
            str(camera),
            f'{rows["settled"].sum()} of {len(rows)}',
            interval(steps),
            f'{low:,.0f} to {high:,.0f}' if np.isfinite(high) else f'{low:,.0f} to not settled',
        ]
        for lane in LANES:
            done = rows[f'{lane}_completed']
            cells.append(f'{done.sum()} of {len(rows)}')
            cells.append(interval(rows.loc[done, f'{lane}_error_m'].to_numpy()))
        print_row(*cells)


def draw_survival(axes: Axes, rows: pd.DataFrame, scenario: str) -> None:
    """Draw the share of trainings that will still lose their lane, over steps."""
    for camera, mine in rows.groupby('camera', sort=False):
        length = STEPS[scenario][list(CAMERAS).index(str(camera))]
        settled = mine['settled']
        times = CensoredData(
            uncensored=mine.loc[settled, 'last_lane_loss_step'].to_numpy(float),
            right=np.full((~settled).sum(), float(length)),
        )
        found = ecdf(times).sf
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # where all or none have settled, there is no band
            band = found.confidence_interval()
        steps = np.concatenate([[1.0], found.quantiles])
        colour = COLOURS[str(camera)]
        axes.step(steps, [1.0, *found.probabilities], where='post', color=colour, label=camera)
        axes.fill_between(
            found.quantiles,
            band.low.probabilities,
            band.high.probabilities,
            step='post',
            color=colour,
            alpha=0.2,
            linewidth=0,
        )
    axes.axvline(PAPER_STEPS[scenario], color=PALE_INK, linestyle=':', label="paper's robot")
    axes.set_xscale('log')
    axes.set_xlim(200, 130_000)
    axes.set_ylim(0, 1.02)
    axes.set_title(f'scenario {scenario}')
    axes.set_xlabel('steps of 50 ms')


def draw_errors(axes: Axes, rows: pd.DataFrame) -> None:
    """Draw the distributions of the mean errors of completed laps."""
    for camera, mine in rows.groupby('camera', sort=False):
        for lane, style in (('outer', '-'), ('inner', '--')):
            done = mine[f'{lane}_completed']
            found = ecdf(mine.loc[done, f'{lane}_error_m'].to_numpy() * 1000).cdf
            axes.step(
                found.quantiles,
                found.probabilities,
                where='post',
                color=COLOURS[str(camera)],
                linestyle=style,
                label=f'{camera}, {lane} lane',
            )
    axes.set_xlim(0, 25)
    axes.set_ylim(0, 1.02)
    axes.set_xlabel('mean error of a lap [mm]')


def draw(data: pd.DataFrame, path: Path) -> None:
    """Draw survival curves of the last lane loss, and distributions of the error."""
    with settings():
        figure = new_figure(10.0, 6.4)
        grid = figure.subplots(2, 3, sharey='row')
        figure.subplots_adjust(left=0.09, right=0.98, bottom=0.08, top=0.94, hspace=0.35)
        for column, (scenario, rows) in enumerate(data.groupby('scenario', sort=False)):
            draw_survival(grid[0, column], rows, str(scenario))
            draw_errors(grid[1, column], rows)
        grid[0, 0].set_ylabel('share of trainings that\nwill still lose their lane')
        grid[1, 0].set_ylabel('share of trainings\nwith a smaller error')
        grid[0, 2].legend(loc='lower left')
        grid[1, 2].legend(loc='lower right')
        save(figure, path)


def main() -> None:
    """Train, or show what was trained."""
    what, path, *others = sys.argv[1:]
    if what == 'train':
        train(Path(path))
        return
    data = pd.read_csv(path, dtype={'scenario': str})
    print_tables(data)
    draw(data, Path(others[0]))


if __name__ == '__main__':
    main()
