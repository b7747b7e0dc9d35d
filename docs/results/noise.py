#!/usr/bin/env python3
"""Drives laps under noise and with perturbed robots: data, tables and figure of noise.md.

source setup/env.sh; docs/results/noise.py drive runs/noise docs/results/noise.csv
source setup/env.sh; docs/results/noise.py show docs/results/noise.csv FIGURE.png

The first command drives what the file lacks, with the trainings that experiments/noise.yaml has
left in a folder; it is deterministic, and can be stopped at any time. It takes names of cases
after the file, to drive these alone. The second one prints the tables and draws the figure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
import sys
from typing import Any, NamedTuple

from matplotlib.axes import Axes
import numpy as np
import pandas as pd
from shared.driving import Driven, fleet_laps, LANES, LAP_SEED, single_lap
from shared.tables import error_text, print_row, table_header

from spikelane.fleet import Fleet
from spikelane.statistics import share_statistics
from spikelane_controllers.registry import make_controller, title
from spikelane_sim.figure_style import INK, LEFT, new_figure, RIGHT, save, settings, write_title
from spikelane_sim.sensor_preset import load_preset, preset_parameters

SEEDS = range(10)  # of trainings
MOST = 20  # robots at a time
LAPS = 4  # of each lane and training: the interval of 80 of 80 laps lies above 95 %

NOISE = {'pixels.esim.leak_rate_hz': 0.0, 'pixels.esim.shot_bright_factor': 1.0}
ESIM = {'camera.antialias': True, 'pixels.model': 'esim', **NOISE}
FILTER = {
    'chain': 'correlation',
    'correlation.window_s': 0.002,
    'correlation.supporters': 2,
    'correlation.same_polarity': True,
}
PERTURBATIONS: Mapping[str, Mapping[str, Any]] = {
    'nothing': {},
    'left wheel 20 % smaller': {'robot.left_wheel_factor': 0.8},
    'camera turned by 5°': {'camera.yaw_deg': 5.0},
    'contrast halved': {'camera.contrast': 0.5},
    'edge lines gone': {'markings': 'scenario_2'},
    '30 % of pixels dead': {'pixels.dead_share': 0.3},
    'latency of 200 ms': {'link.latency_ms': 200},
    'half of the events lost': {'link.event_loss': 0.5},
    'noise of 0.03 Hz': {'pixels.coppelia.noise_rate_hz': 0.03},
    'noise of 0.1 Hz': {'pixels.coppelia.noise_rate_hz': 0.1},
    'drawn in each lap': {'randomisation.enabled': True, 'randomisation.noise_hz': 0.0},
}
VARIANTS = ('nominal', 'randomised')
#: Trainings with and without domain randomisation, by controller and variant.
RANDOMISATION = {
    'rstdp': {each: f'train-rstdp-1-rigid-{each}-seed{{}}' for each in VARIANTS},
    'dqn': {
        'nominal': 'train-dqn-1-rigid-best-seed{}',
        'randomised': 'train-dqn-1-rigid-randomised-seed{}',
    },
}


class Case(NamedTuple):
    """Laps of one setting.

    Attributes:
        controller: Name in the registry.
        training: Folder of the trainings, with the place of the seed; after '!' the name of
            weights that are shipped.
        simulator: Parameters of the simulator.
        filters: Parameters of the filters; none for no filter.
        courses: On which each training drives.
        seeds: Trainings that drive.
        laps: Laps of each lane, training and course.
        parameters: Parameters of the controller.
    """

    controller: str
    training: str
    simulator: Mapping[str, Any]
    filters: Mapping[str, Any] = {}
    courses: Sequence[str] = ('scenario_1',)
    seeds: Sequence[int] = SEEDS
    laps: int = 1
    parameters: Mapping[str, Any] = {}


def _esim(rate_hz: float) -> dict[str, Any]:
    return {**ESIM, 'pixels.esim.substeps': 2, 'pixels.esim.shot_rate_hz': rate_hz}


def _v2e() -> dict[str, Any]:
    found = preset_parameters(load_preset('v2e_noisy'))
    names = {name.removeprefix('simulator.'): value for name, value in found.items()}
    return {**names, 'pixels.esim.substeps': 2}


_TRAINED = 'train-rstdp-{}-rigid-esim-smooth-filtered-seed{{}}'


def cases() -> dict[str, Case]:
    """Return all cases by name."""
    found = {
        f'rstdp scenario {each} 1 Hz': Case(
            'rstdp', _TRAINED.format(each), _esim(1.0), FILTER, (f'scenario_{each}',), laps=LAPS
        )
        for each in '123'
    }
    one = 'rstdp', _TRAINED.format(1)
    found['rstdp scenario 1 v2e_noisy'] = Case(*one, _v2e(), FILTER, laps=LAPS)
    found['rstdp scenario 1 10 Hz'] = Case(*one, _esim(10.0), FILTER, laps=LAPS)
    for each in '123':
        found[f'rstdp shipped, scenario {each} 1 Hz'] = Case(
            'rstdp', f'!scenario_{each}', _esim(1.0), FILTER, (f'scenario_{each}',), (0, 1)
        )
    random = tuple(f'random:{number}' for number in range(10))
    found['rstdp shipped, random 1 Hz'] = Case(
        'rstdp', '!scenario_1', _esim(1.0), FILTER, random, (0,)
    )
    found['rstdp random 1 Hz'] = Case(*one, _esim(1.0), FILTER, random, (0,))
    shipped = 'rstdp', '!scenario_1'
    found['rstdp shipped, random, neither noise nor filter'] = Case(
        *shipped, _esim(0.0), {}, random, (0,)
    )
    found['rstdp shipped, random, filter without noise'] = Case(
        *shipped, _esim(0.0), FILTER, random, (0,)
    )
    longer = {**FILTER, 'correlation.window_s': 0.02}
    hundred = tuple(f'random:{number}' for number in range(100))
    found['rstdp shipped, random, 20 ms 1 Hz'] = Case(*shipped, _esim(1.0), longer, hundred, (0,))
    behind_20_ms = 'rstdp', 'train-rstdp-1-rigid-esim-smooth-filtered_20ms-seed{}'
    found['rstdp 20 ms, scenario 1 1 Hz'] = Case(*behind_20_ms, _esim(1.0), longer, laps=LAPS)
    found['rstdp 20 ms, random 1 Hz'] = Case(*behind_20_ms, _esim(1.0), longer, random)
    q_network = 'train-dqn-1-rigid-best-seed{}'
    found['dqn scenario 1 1 Hz'] = Case(
        'dqn', q_network, _esim(1.0), FILTER, parameters={'averaged': True}
    )
    found['dqn trained with noise, scenario 1 1 Hz'] = Case(
        'dqn',
        'train-dqn-1-rigid-esim-smooth-filtered-seed{}',
        _esim(1.0),
        FILTER,
        parameters={'averaged': True},
        laps=LAPS,
    )
    found['dqn_snn shipped, scenario 1 1 Hz'] = Case(
        'dqn_snn', '!scenario_1', _esim(1.0), FILTER, seeds=(0, 1)
    )
    with_noise = 'dqn_snn', 'transfer-dqn_snn-1-rigid-esim-smooth-filtered-seed{}'
    frames = {'encoding.frames': 10}
    found['dqn_snn trained with noise, scenario 1 1 Hz'] = Case(
        *with_noise, _esim(1.0), FILTER, parameters=frames, laps=LAPS
    )
    for name, filters in (('', FILTER), (', 20 ms', longer)):
        found[f'dqn_snn trained with noise, random{name} 1 Hz'] = Case(
            *with_noise, _esim(1.0), filters, hundred, (0,), parameters=frames
        )
    for controller, folders in RANDOMISATION.items():
        parameters = {'averaged': True} if controller == 'dqn' else {}
        for variant, folder in folders.items():
            for name, values in PERTURBATIONS.items():
                found[f'{controller} {variant}: {name}'] = Case(
                    controller, folder, values, parameters=parameters
                )
    return found


class Lap(NamedTuple):
    """One lap to drive."""

    seed: int  # of the training
    course: str
    lane: str
    lap_seed: int


def laps_of(case: Case) -> Iterator[Lap]:
    """Yield the laps of a case, one of each training, course and lane after the other."""
    for number in range(case.laps):
        for course in case.courses:
            for seed in case.seeds:
                for lane in LANES:
                    yield Lap(seed, course, lane, LAP_SEED + 2 * seed + 100 * number)


def main() -> None:
    """Drive, or show."""
    arguments = sys.argv[1:]
    if len(arguments) > 2 and arguments[0] == 'drive':
        drive(Path(arguments[1]), Path(arguments[2]), arguments[3:] or list(cases()))
    elif len(arguments) == 3 and arguments[0] == 'show':
        show(pd.read_csv(arguments[1]), Path(arguments[2]))
    else:
        sys.exit('usage: noise.py drive FOLDER DATA.csv [CASE ...] | show DATA.csv FIGURE.png')


def drive(folder: Path, data: Path, names: Sequence[str]) -> None:
    """Drive the laps that a file lacks, and add them to it."""
    for name in names:
        case = cases()[name]
        rows = pd.read_csv(data) if data.exists() else pd.DataFrame({'case': []})
        of = rows[rows['case'] == name]
        done = {Lap(*each) for each in of.reindex(columns=Lap._fields).itertuples(index=False)}
        missing = [lap for lap in laps_of(case) if lap not in done]
        for first in range(0, len(missing), MOST):
            laps = missing[first : first + MOST]
            found = [
                {'case': name, **lap._asdict(), **_result(driven)}
                for lap, driven in zip(laps, _driven(case, folder, laps), strict=True)
            ]
            rows = pd.concat([rows, pd.DataFrame(found)]).astype({'seed': int, 'lap_seed': int})
            rows.to_csv(data, index=False, float_format='%.5f')
            print(name, sum(each['completed'] for each in found), 'of', len(found), flush=True)


def _result(driven: Driven) -> dict[str, Any]:
    """Return how a lap went, and its largest error [m]."""
    return {**driven.result(), 'max_m': float(np.abs(driven.distances_m).max())}


def _controller(case: Case, folder: Path, seed: int) -> Any:
    """Return the controller of a training."""
    name = case.training
    path = name[1:] if name.startswith('!') else str(folder / name.format(seed))
    return make_controller(case.controller, {**case.parameters, 'checkpoint': path})


def _driven(case: Case, folder: Path, laps: Sequence[Lap]) -> list[Driven]:
    """Drive laps, in a fleet where the controller has one."""
    values = {'robot.engine': 'rigid', **case.simulator}
    controllers = [_controller(case, folder, lap.seed) for lap in laps]
    if case.controller == 'dqn_snn':
        return [
            single_lap(
                {**values, 'course': lap.course}, controller, lap.lane, lap.lap_seed, case.filters
            )
            for controller, lap in zip(controllers, laps, strict=True)
        ]
    with Fleet(
        case.controller,
        [lap.lap_seed for lap in laps],
        simulator=values,
        parameters=case.parameters,
        filters=case.filters,
        courses=[lap.course for lap in laps],
    ) as fleet:
        for robot, controller in enumerate(controllers):
            fleet.host(robot, controller, controller.reset)
        return fleet_laps(fleet, [lap.lane for lap in laps])


def _share(successes: pd.Series[bool]) -> str:
    """Return how many there are, of how many, with the interval of their share."""
    share = share_statistics(int(successes.sum()), len(successes))
    return (
        f'{share["successes"]} of {share["n"]} '
        f'({100 * share["ci_low"]:.0f} to {100 * share["ci_high"]:.0f} %)'
    )


def _counts(rows: pd.DataFrame) -> str:
    """Return laps completed with the interval of their share."""
    return _share(rows['completed'].astype(bool))


def _whole(rows: pd.DataFrame, unit: str) -> str:
    """Return of how many trainings or courses all laps are completed."""
    return _share(rows.groupby(unit)['completed'].all())


def _noisy(data: pd.DataFrame) -> list[str]:
    """Return the names of the cases with noise of which there are laps."""
    driven = set(data['case'])
    return [each for each in cases() if each in driven and ':' not in each]


def _words(name: str) -> str:
    """Return the name of a case for a reader."""
    controller, *rest = name.split(' ')
    text = ' '.join(rest).replace('random', 'random courses')
    for noise in ('1 Hz', '10 Hz', 'v2e_noisy'):
        text = text.replace(f' {noise}', f', {noise}') if text.endswith(f' {noise}') else text
    return f'{title(controller)}, {text}'


def show(data: pd.DataFrame, path: Path) -> None:
    """Print the tables and draw the figure."""
    every_lap = 'trainings or courses with all laps completed (95 %)'
    print(table_header('laps', 'completed (95 %)', every_lap, 'mean error (95 %)'))
    for name in _noisy(data):
        rows = data[data['case'] == name]
        unit = 'course' if 'random' in name else 'seed'
        whole = (
            'the weights shipped' if 'shipped' in name and unit == 'seed' else _whole(rows, unit)
        )
        print_row(_words(name), _counts(rows), whole, error_text(rows, unit))
    for controller in RANDOMISATION:
        _print_perturbed(data, controller)
    draw(data, path)


def _print_perturbed(data: pd.DataFrame, controller: str) -> None:
    """Print what domain randomisation brings a controller, and costs it."""
    print()
    columns = [f'{title(controller)}, judged with']
    for variant in VARIANTS:
        columns += [f'trained {variant}: laps', 'mean error (95 %)']
    print(table_header(*columns))
    for name in PERTURBATIONS:
        cells = [name]
        for variant in VARIANTS:
            rows = data[data['case'] == f'{controller} {variant}: {name}']
            cells += [_counts(rows), error_text(rows)] if len(rows) else ['', '']
        print_row(*cells)


def draw(data: pd.DataFrame, path: Path) -> None:
    """Draw laps completed under noise, and errors with and without domain randomisation."""
    with settings():
        figure = new_figure(9.4, 4.4)
        write_title(
            figure, 'Laps under noise, and with a robot that is not nominal', 'rigid robot'
        )
        _draw_shares(figure.add_axes((0.245, 0.2, 0.22, 0.66)), data)
        _draw_errors(figure.add_axes((0.68, 0.2, 0.29, 0.66)), data)
        save(figure, path)


def _draw_shares(axes: Axes, data: pd.DataFrame) -> None:
    names = [each for each in _noisy(data) if 'shipped' not in each or '20 ms' in each]
    for place, name in enumerate(names):
        completed = data[data['case'] == name]['completed'].astype(bool)
        share = share_statistics(int(completed.sum()), len(completed))
        low, high = 100 * share['ci_low'], 100 * share['ci_high']
        axes.plot([low, high], [place, place], color=INK, linewidth=1.2)
        axes.plot([100 * share['share']], [place], color=INK, marker='o', linestyle='none')
        text = f'{share["successes"]} of {share["n"]} '
        axes.annotate(
            text, (min(low, 94.0), place), ha='right', va='center', fontsize=7, color=INK
        )
    axes.axvline(95, color=RIGHT, linewidth=0.8)
    words = [
        _words(name)
        .replace('random courses', 'random')
        .replace('R-STDP, shipped', 'R-STDP shipped')
        .replace('trained with noise, scenario 1', 'noisy training')
        .replace('trained with noise, random', 'random')
        for name in names
    ]
    axes.set_yticks(range(len(words)), words, fontsize=8)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(0, 102)
    axes.set_xlabel('laps completed [%], interval of 95 %')


def _draw_errors(axes: Axes, data: pd.DataFrame) -> None:
    looks = (('nominal', LEFT, 'o', -0.15), ('randomised', RIGHT, 's', 0.15))
    for variant, colour, marker, offset in looks:
        for place, name in enumerate(PERTURBATIONS):
            rows = data[data['case'] == f'rstdp {variant}: {name}']
            done = rows[rows['completed'].astype(bool)]
            label = f'trained {variant}' if not place else None
            errors = [1000 * done['error_m'].mean()] if len(done) else []
            axes.plot(
                errors, [place + offset][: len(errors)],
                color=colour, marker=marker, linestyle='none', markersize=5, label=label,
            )  # fmt: skip
            if len(done) < len(rows):
                axes.annotate(
                    f'{len(done)} of {len(rows)} laps', (0.99, place + offset),
                    xycoords=('axes fraction', 'data'), ha='right', va='center', fontsize=7,
                    color=colour,
                )  # fmt: skip
    axes.set_yticks(range(len(PERTURBATIONS)), list(PERTURBATIONS))
    axes.set_ylim(len(PERTURBATIONS) - 0.5, -0.5)
    axes.set_xlim(0, 58)  # with room for the numbers of laps
    axes.set_xlabel('mean error of the laps completed [mm]')
    axes.legend(loc='upper left', bbox_to_anchor=(-0.7, -0.12), ncols=2, frameon=False)


if __name__ == '__main__':
    main()
