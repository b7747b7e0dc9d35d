#!/usr/bin/env python3
"""Measures cost against size: the data, tables, numbers and figure of docs/performance.md.

source setup/env.sh; docs/results/performance.py measure
source setup/env.sh; docs/results/performance.py measure network
source setup/env.sh; docs/results/performance.py show

The first command takes some minutes on two cores that do nothing else; `--quick` measures all
sizes for a shorter time, and less exactly. Each size is measured in a process of its own, several
times. The second one measures networks alone, and keeps the other data. The third one writes what
was measured into the page, between its marks, and draws the figure next to the data.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
import json
import os
from pathlib import Path
import re
import resource
import subprocess
import sys
import tempfile
import time
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from performance_figure import draw
from performance_page import fill

from spikelane.fleet import Fleet
from spikelane_controllers.spiking.network import DelayParameters
from spikelane_controllers.spiking.neuron import neuron_constants, NeuronParameters
from spikelane_controllers.spiking.plasticity import PlasticNetwork, resting_plastic_state
from spikelane_controllers.spiking.poisson import poisson_spikes
from spikelane_controllers.spiking.synapse import synapse_rule, SynapseParameters
from spikelane_sim.contract import WheelVelocities
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

DATA = Path(__file__).with_suffix('.csv')
PAGE = Path(__file__).parents[1] / 'performance.md'
#: What is measured, and for which sizes: robots; pixels of a side; neurons and inputs; workers.
SIZES: dict[str, list[tuple[int, int]]] = {
    'fleet': [(n, threads) for n in (1, 4, 16, 64, 256, 1024) for threads in (1, 2)],
    'camera': [(px, 1) for px in (64, 128, 256, 512)],
    'camera, anti-aliased': [(px, 1) for px in (64, 128, 256, 512)],
    'network': [(2, 32), (10, 100), (100, 100), (1000, 100), (10_000, 100), (1000, 1000)],
    'ray': [(1, 1), (2, 1)],
}


class Effort(NamedTuple):
    """How much is measured at a time, and how often."""

    repeats: int  # but for Ray
    robot_steps: int
    camera_steps: int
    windows: int  # of 50 ms
    training_steps: int  # on Ray


FULL, QUICK = Effort(5, 32_768, 500, 20, 40_000), Effort(2, 4096, 50, 2, 4000)
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
    tasks: {train: {steps: STEPS}}
"""


class Times(NamedTuple):
    """Times of one thing [s], for each repeat, and how many things each repeat had."""

    wall_s: list[float]
    processor_s: list[float]
    count: int


def measure_fleet(robots: int, threads: int, effort: Effort) -> Times:
    """Train R-STDP in scenario 1 with the engine rigid; return the times of a step [s]."""
    simulator = {'robot.engine': 'rigid', 'episode.max_distance_m': 0.2}
    with Fleet(
        'rstdp', range(robots), simulator=simulator, parameters=LEARNING, threads=threads
    ) as fleet:
        fleet.initialise()
        steps = max(effort.robot_steps // robots, 1)
        return _times_s(lambda: fleet.drive(steps), steps * robots, effort.repeats)


def measure_camera(px: int, antialias: int, effort: Effort) -> Times:
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
            for _ in range(effort.camera_steps):
                simulator.step(wheels)

        return _times_s(drive, effort.camera_steps, effort.repeats)


def measure_network(neurons: int, inputs: int, effort: Effort) -> Times:
    """Run a network that learns, every input on every neuron; return times of a window [s]."""
    rng = np.random.default_rng(0)
    delays = DelayParameters()
    rule = synapse_rule(SynapseParameters(), delays)
    # As much current for each neuron as the paper's 32 inputs give, so that it fires as often.
    weights_pa = rng.uniform(200.0, 600.0, (neurons, inputs)) * 32 / inputs
    state = resting_plastic_state(weights_pa, delays)
    network = PlasticNetwork(state, neuron_constants(NeuronParameters()), rule)
    windows = [poisson_spikes(np.full(inputs, INPUT_RATE_HZ), rng) for _ in range(effort.windows)]
    rewards = 0.01 * rng.normal(0.0, 0.03, (effort.windows, neurons))

    def run() -> None:
        for spikes, reward in zip(windows, rewards, strict=True):
            network.dopamine[:] = reward
            network.run(spikes)

    return _times_s(run, effort.windows, effort.repeats)


def measure_ray(workers: int, _: int, effort: Effort) -> Times:
    """Do an experiment of 8 trainings on Ray; return its times [s]."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, 'growth.yaml')
        file.write_text(EXPERIMENT.replace('STEPS', str(effort.training_steps)))
        command = [sys.executable, '-m', 'spikelane.main', 'experiment', str(file), '--json']
        command += ['--engine', 'ray', '--jobs', str(workers), '--out', f'{folder}/out']
        return _times_s(
            lambda: subprocess.run(command, check=True, stdout=subprocess.DEVNULL), 1, 1, first=0
        )


def _times_s(work: Callable[[], Any], count: int, repeats: int, first: int = 1) -> Times:
    """Return the times of one of so many things, for each repeat after the first ones."""
    times = Times([], [], count)
    for repeat in range(first + repeats):
        wall_s, processor_s = time.perf_counter(), time.process_time()
        work()
        if repeat >= first:
            times.wall_s.append((time.perf_counter() - wall_s) / count)
            times.processor_s.append((time.process_time() - processor_s) / count)
    return times


MEASURES: dict[str, Callable[[int, int, Effort], Times]] = {
    'fleet': measure_fleet,
    'camera': lambda px, _, effort: measure_camera(px, 0, effort),
    'camera, anti-aliased': lambda px, _, effort: measure_camera(px, 1, effort),
    'network': measure_network,
    'ray': measure_ray,
}


def measure_here(what: str, size: int, other: int, effort: Effort) -> None:
    """Measure one size, and print the row as JSON."""
    times = MEASURES[what](size, other, effort)
    wall_us, processor_us = 1e6 * np.array(times.wall_s), 1e6 * np.array(times.processor_s)
    row = {
        'what': what,
        'size': size,
        'other': other,
        'processor_us': float(np.median(processor_us)),
        'processor_low_us': float(processor_us.min()),
        'processor_high_us': float(processor_us.max()),
        'wall_us': float(np.median(wall_us)),
        'repeats': len(times.wall_s),
        'count': times.count,
        'memory_mb': round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6),
    }
    print(json.dumps(row))


def measure(path: Path, named: Sequence[str], options: list[str]) -> None:
    """Measure sizes, each in a process of its own, and write the data.

    Args:
        path: The data.
        named: What is measured; all other data is kept. Everything where nothing is named.
        options: Those of this script.
    """
    rows = []
    # What is measured first is measured once before: that compiles the kernel.
    chosen = {what: SIZES[what] for what in named} or SIZES
    everything = [(what, *pair) for what, pairs in chosen.items() for pair in pairs]
    for what, size, other in [everything[0], *everything]:
        load = os.getloadavg()[0]
        print(f'{what} {size} {other}, load {load:.1f}', file=sys.stderr)
        command = [sys.executable, __file__, 'one', what, str(size), str(other), *options]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        rows.append({**json.loads(done.stdout), 'load': load, 'machine': machine()})
    data = pd.DataFrame(rows[1:])
    if named:
        kept = pd.read_csv(path)
        data = pd.concat([kept[~kept['what'].isin(named)], data])
        data = data.sort_values(
            'what', key=lambda each: each.map(list(SIZES).index), kind='stable'
        )
    data.to_csv(path, index=False, float_format='%.4g')


def machine() -> str:
    """Return how many processors of which kind there are."""
    found = re.search(r'model name\s*: (.*)', Path('/proc/cpuinfo').read_text())
    return f'{os.cpu_count()} x {found[1].strip() if found else "unknown"}'


def main() -> None:
    """Measure, or show what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('what', choices=('measure', 'show', 'one'))
    parser.add_argument(
        'named', nargs='*', help='for measure: what, all by default; for one: what, size and other'
    )
    parser.add_argument('--quick', action='store_true', help='a trial: all sizes, less exactly')
    parser.add_argument('--data', type=Path, default=DATA, help='the data (%(default)s)')
    parser.add_argument('--page', type=Path, default=PAGE, help='the page (%(default)s)')
    options = parser.parse_args()
    if options.what == 'measure' and (unknown := sorted(set(options.named) - set(SIZES))):
        parser.error(f'named: expected {", ".join(SIZES)}, got {", ".join(unknown)}')
    if options.what == 'one':
        name, size, other = options.named
        measure_here(name, int(size), int(other), QUICK if options.quick else FULL)
    elif options.what == 'measure':
        measure(options.data, options.named, ['--quick'] if options.quick else [])
    else:
        data = pd.read_csv(options.data)
        options.page.write_text(fill(options.page.read_text('utf-8'), data), 'utf-8')
        draw(data, options.data.with_suffix('.png'))


if __name__ == '__main__':
    main()
