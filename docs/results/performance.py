#!/usr/bin/env python3
"""Measures cost against size: the data, tables and figure of docs/performance.md.

source setup/env.sh; docs/results/performance.py measure docs/results/performance.csv
source setup/env.sh; docs/results/performance.py show docs/results/performance.csv FIGURE.png

The first command takes some minutes on two cores that do nothing else; `--small` is a trial of a
few small sizes. Each size is measured in a process of its own, several times. The second one
prints the table and draws the figure from the data.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import json
import os
from pathlib import Path
import resource
import subprocess
import sys
import tempfile
import time
from typing import Any, NamedTuple

from matplotlib.axes import Axes
import numpy as np
import pandas as pd

from spikelane.fleet import Fleet
from spikelane_controllers.spiking.network import DelayParameters
from spikelane_controllers.spiking.neuron import neuron_constants, NeuronParameters
from spikelane_controllers.spiking.plasticity import PlasticNetwork, resting_plastic_state
from spikelane_controllers.spiking.poisson import poisson_spikes
from spikelane_controllers.spiking.synapse import synapse_rule, SynapseParameters
from spikelane_sim.contract import WheelVelocities
from spikelane_sim.figure_style import LEFT, new_figure, RIGHT, save, settings
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

REPEATS = 5
#: What is measured, and for which sizes: robots; pixels of a side; neurons and inputs; workers.
SIZES: dict[str, list[tuple[int, int]]] = {
    'fleet': [(n, threads) for n in (1, 4, 16, 64, 256, 1024) for threads in (1, 2)],
    'camera': [(px, 1) for px in (64, 128, 256, 512)],
    'camera, anti-aliased': [(px, 1) for px in (64, 128, 256, 512)],
    'network': [(2, 32), (10, 100), (100, 100), (1000, 100), (10_000, 100), (1000, 1000)],
    'ray': [(1, 1), (2, 1)],
}
SMALL: dict[str, list[tuple[int, int]]] = {
    'fleet': [(1, 1), (16, 1), (16, 2)],
    'camera': [(64, 1), (128, 1)],
    'camera, anti-aliased': [(64, 1), (128, 1)],
    'network': [(2, 32), (10, 100)],
    'ray': [],  # takes minutes
}
#: Robot-steps of a repeat, steps of a camera, windows of 50 ms of a network.
FLEET_STEPS, CAMERA_STEPS, WINDOWS = 65_536, 500, 40
#: Mean rate of an input, about that of the paper's 32 inputs on the course.
INPUT_RATE_HZ = 17.5
LEARNING = {'learning': True, 'checkpoint': ''}
EXPERIMENT = """
name: growth
matrix:
  - controllers: [rstdp]
    scenarios: [1]
    robots: [rigid]
    seeds: 8
    variants: {short: {training.save_every: 100000}}
    tasks: {train: {steps: 40000}}
"""


class Times(NamedTuple):
    """Times of one thing [s]."""

    wall_s: float
    processor_s: float


def measure_fleet(robots: int, threads: int) -> list[Times]:
    """Train R-STDP in scenario 1 with the engine rigid; return the times of a step [s]."""
    simulator = {'robot.engine': 'rigid', 'episode.max_distance_m': 0.2}
    with Fleet(
        'rstdp', range(robots), simulator=simulator, parameters=LEARNING, threads=threads
    ) as fleet:
        fleet.initialise()
        steps = max(FLEET_STEPS // robots, 1)
        return _times_s(lambda: fleet.drive(steps), steps * robots)


def measure_camera(px: int, antialias: int) -> list[Times]:
    """Drive with a square image, straight on; return the times of a step [s]."""
    values = {
        'robot.engine': 'kinematic',
        'camera.width': px,
        'camera.height': px,
        'camera.antialias': bool(antialias),
        'episode.max_distance_m': 100.0,
    }
    with Simulator(SimulatorParameters.from_mapping(values)) as simulator:
        wheels = WheelVelocities(5.0, 5.1)

        def drive() -> None:
            simulator.reset('outer', 0)
            for _ in range(CAMERA_STEPS):
                simulator.step(wheels)

        return _times_s(drive, CAMERA_STEPS)


def measure_network(neurons: int, inputs: int) -> list[Times]:
    """Run a network that learns, every input on every neuron; return times of a window [s]."""
    rng = np.random.default_rng(0)
    delays = DelayParameters()
    rule = synapse_rule(SynapseParameters(), delays)
    # As much current for each neuron as the paper's 32 inputs give, so that it fires as often.
    weights_pa = rng.uniform(200.0, 600.0, (neurons, inputs)) * 32 / inputs
    state = resting_plastic_state(weights_pa, delays)
    network = PlasticNetwork(state, neuron_constants(NeuronParameters()), rule)
    windows = [poisson_spikes(np.full(inputs, INPUT_RATE_HZ), rng) for _ in range(WINDOWS)]
    rewards = 0.01 * rng.normal(0.0, 0.03, (WINDOWS, neurons))

    def run() -> None:
        for spikes, reward in zip(windows, rewards, strict=True):
            network.dopamine[:] = reward
            network.run(spikes)

    return _times_s(run, WINDOWS)


def measure_ray(workers: int, _: int) -> list[Times]:
    """Do an experiment of 8 trainings on Ray; return its times [s]."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, 'growth.yaml')
        file.write_text(EXPERIMENT)
        command = [sys.executable, '-m', 'spikelane.main', 'experiment', str(file), '--json']
        command += ['--engine', 'ray', '--jobs', str(workers), '--out', f'{folder}/out']
        return _times_s(
            lambda: subprocess.run(command, check=True, stdout=subprocess.DEVNULL), 1, 0
        )


def _times_s(work: Callable[[], Any], count: int, first: int = 1) -> list[Times]:
    """Return the times of one of so many things, for each repeat but the first ones."""
    times = []
    for repeat in range(first + REPEATS if first else 1):
        wall_s, processor_s = time.perf_counter(), time.process_time()
        work()
        if repeat >= first:
            wall_s, processor_s = time.perf_counter() - wall_s, time.process_time() - processor_s
            times.append(Times(wall_s / count, processor_s / count))
    return times


MEASURES: dict[str, Callable[[int, int], list[Times]]] = {
    'fleet': measure_fleet,
    'camera': lambda px, _: measure_camera(px, 0),
    'camera, anti-aliased': lambda px, _: measure_camera(px, 1),
    'network': measure_network,
    'ray': measure_ray,
}


def measure_here(what: str, size: int, other: int) -> None:
    """Measure one size, and print the row as JSON."""
    wall_us, processor_us = 1e6 * np.array(MEASURES[what](size, other)).T
    row = {
        'what': what,
        'size': size,
        'other': other,
        'processor_us': float(np.median(processor_us)),
        'processor_low_us': float(processor_us.min()),
        'processor_high_us': float(processor_us.max()),
        'wall_us': float(np.median(wall_us)),
        'memory_mb': round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6),
    }
    print(json.dumps(row))


def measure(path: Path, sizes: dict[str, list[tuple[int, int]]]) -> None:
    """Measure all sizes, each in a process of its own, and write the data."""
    rows = []
    for what, pairs in sizes.items():
        for size, other in pairs:
            command = [sys.executable, __file__, 'one', what, str(size), str(other)]
            print(f'{what} {size} {other}, load {os.getloadavg()[0]:.1f}', file=sys.stderr)
            done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
            rows.append(json.loads(done.stdout))
    pd.DataFrame(rows).to_csv(path, index=False, float_format='%.4g')


def print_table(data: pd.DataFrame) -> None:
    """Print the rows as a table."""
    units = {
        'fleet': ('{} robots, {} threads', 'robot-step'),
        'camera': ('{0} x {0} px', 'step'),
        'camera, anti-aliased': ('{0} x {0} px, anti-aliased', 'step'),
        'network': ('{} neurons x {} inputs', 'window of 50 ms'),
        'ray': ('8 trainings on {} workers of Ray', 'experiment'),
    }
    print('| size | of a | processor time [µs] | range [µs] | wall time [µs] | memory [MB] |')
    print('|---' * 6 + '|')
    for row in data.itertuples():
        size, unit = units[str(row.what)]
        is_here = row.what != 'ray'  # its work and its memory are in other processes
        low, high = row.processor_low_us, row.processor_high_us
        cells = [
            size.format(row.size, row.other),
            unit,
            f'{row.processor_us:,.4g}' if is_here else '',
            f'{low:,.4g} to {high:,.4g}' if is_here else '',
            f'{row.wall_us:,.4g}',
            f'{row.memory_mb:,}' if is_here else '',
        ]
        print(f'| {" | ".join(cells)} |')


def draw_fleet(axes: Axes, memory: Axes, data: pd.DataFrame) -> None:
    """Draw the robot-steps per second, and the memory, over the number of robots."""
    for threads, colour in ((1, LEFT), (2, RIGHT)):
        mine = data[data['other'] == threads]
        label = f'{threads} thread' + 's' * (threads > 1)
        for each, values in ((axes, 1e6 / mine['wall_us']), (memory, mine['memory_mb'])):
            each.plot(mine['size'], values, marker='o', color=colour, label=label)
    axes.set_ylabel('robot-steps per second')
    memory.set_ylabel('memory of the process [MB]')
    for each in (axes, memory):
        each.set_xscale('log')
        each.set_xticks(data['size'].unique(), [f'{size:,}' for size in data['size'].unique()])
        each.set_xticks([], minor=True)
        each.set_xlabel('robots')
        each.set_ylim(0, 1.1 * each.dataLim.y1)
        each.legend()


def draw_cost(axes: Axes, sizes: pd.Series[Any], rows: pd.DataFrame, label: str, at: int) -> None:
    """Draw a cost over sizes, with logarithmic axes."""
    axes.plot(sizes, rows['processor_us'], marker='o', color=(LEFT, RIGHT)[at], label=label)
    axes.set_xscale('log')
    axes.set_yscale('log')


def draw(data: pd.DataFrame, path: Path) -> None:
    """Draw all costs over their sizes."""
    with settings():
        figure = new_figure(10.0, 6.8)
        (speed, memory), (camera, network) = figure.subplots(2, 2)
        figure.subplots_adjust(left=0.09, right=0.98, bottom=0.09, top=0.97, hspace=0.32)
        groups = {str(what): rows for what, rows in data.groupby('what')}
        draw_fleet(speed, memory, groups['fleet'])
        for at, name in enumerate(('camera', 'camera, anti-aliased')):
            rows = groups[name]
            draw_cost(camera, rows['size'], rows, ('sharp edges', 'anti-aliased')[at], at)
        rows = groups['network'].sort_values('size')
        draw_cost(network, rows['size'] * rows['other'], rows, '', 0)
        camera.set_xticks(groups['camera']['size'], groups['camera']['size'])
        camera.set_xticks([], minor=True)
        camera.set_xlabel('width and height of the image [px]')
        camera.set_ylabel('a step of the simulator [µs]')
        camera.legend()
        network.set_xlabel('synapses')
        network.set_ylabel('50 ms of a learning network [µs]')
        save(figure, path)


def main() -> None:
    """Measure, or show what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('what', choices=('measure', 'show', 'one'))
    parser.add_argument('arguments', nargs='+')
    parser.add_argument('--small', action='store_true', help='a trial of a few small sizes')
    options = parser.parse_args()
    if options.what == 'one':
        name, size, other = options.arguments
        measure_here(name, int(size), int(other))
    elif options.what == 'measure':
        measure(Path(options.arguments[0]), SMALL if options.small else SIZES)
    else:
        data = pd.read_csv(options.arguments[0])
        print_table(data)
        draw(data, Path(options.arguments[1]))


if __name__ == '__main__':
    main()
