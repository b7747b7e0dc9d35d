#!/usr/bin/env python3
"""Measures cost against size: the data, tables, numbers and figure of docs/performance.md.

source setup/env.sh; docs/results/performance.py measure
source setup/env.sh; docs/results/performance.py show

The first command takes some minutes on two cores that do nothing else; `--quick` measures all
sizes for a shorter time, and less exactly. Each size is measured in a process of its own, several
times. The second one writes what was measured into the page, between its marks, and draws the
figure next to the data.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
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

from matplotlib.axes import Axes
import numpy as np
import pandas as pd
from shared.tables import table_header, table_row

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


def measure(path: Path, options: list[str]) -> None:
    """Measure all sizes, each in a process of its own, and write the data."""
    rows = []
    # What is measured first is measured once before: that compiles the kernel.
    everything = [(what, *pair) for what, pairs in SIZES.items() for pair in pairs]
    for what, size, other in [everything[0], *everything]:
        load = os.getloadavg()[0]
        print(f'{what} {size} {other}, load {load:.1f}', file=sys.stderr)
        command = [sys.executable, __file__, 'one', what, str(size), str(other), *options]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        rows.append({**json.loads(done.stdout), 'load': load, 'machine': machine()})
    pd.DataFrame(rows[1:]).to_csv(path, index=False, float_format='%.4g')


def machine() -> str:
    """Return how many processors of which kind there are."""
    found = re.search(r'model name\s*: (.*)', Path('/proc/cpuinfo').read_text())
    return f'{os.cpu_count()} x {found[1].strip() if found else "unknown"}'


#: What a row is called, and what its times are of.
UNITS = {
    'fleet': ('{} robots, {} threads', 'robot-step'),
    'camera': ('{0} x {0} px', 'step'),
    'camera, anti-aliased': ('{0} x {0} px, anti-aliased', 'step'),
    'network': ('{} neurons x {} inputs', 'window of 50 ms'),
    'ray': ('8 trainings on {} workers of Ray', 'experiment'),
}


def table(rows: pd.DataFrame) -> str:
    """Return rows as a table."""
    times = ('processor time [µs]', 'range [µs]', 'wall time [µs]')
    lines = [table_header('size', 'of a', *times, 'memory [MB]')]
    for row in rows.itertuples():
        size, unit = UNITS[str(row.what)]
        is_here = row.what != 'ray'  # its work and its memory are in other processes
        low, high = row.processor_low_us, row.processor_high_us
        cells = [
            size.format(f'{row.size:,}', f'{row.other:,}'),
            unit,
            number(row.processor_us) if is_here else '',
            f'{number(low)} to {number(high)}' if is_here else '',
            number(row.wall_us),
            f'{row.memory_mb:,}' if is_here else '',
        ]
        lines.append(table_row(*cells))
    return '\n'.join(lines)


def number(value: float) -> str:
    """Return a number with three digits that count."""
    return f'{float(f"{value:.3g}"):,g}' if value < 1e6 else f'{round(value, -4):,.0f}'


def tell_machine(data: pd.DataFrame) -> str:
    """Return what it was measured on, and how much else that had to do."""
    low, high = data['load'].min(), data['load'].max()
    processors = int(str(data['machine'].iloc[0]).split()[0])
    busy = (
        'The machine was busy with other work, so that wall times and what two threads gain say '
        'little, and processor times are longer than on a quiet one.'
        if high > 2 * processors
        else 'The machine had little else to do.'
    )
    return (
        'The numbers and tables of this page are from [the data](results/performance.csv). '
        f'Each size was measured {data["repeats"].max()} times (on Ray once), after one time that '
        f'does not count. Measured on {data["machine"].iloc[0]}, with a load average (of one '
        'minute, before each '
        f'measurement) of {low:.1f} to {high:.1f}. {busy}\n\n{FIGURE}'
    )


def tell_fleet(data: pd.DataFrame) -> str:
    """Return what a fleet costs."""
    rows = data[data['what'] == 'fleet'].set_index(['size', 'other'])
    first, last = rows.index[0][0], rows.index[-1][0]
    quickest = rows['wall_us'].idxmin()
    gains = [
        rows['wall_us'][size, 1] / rows['wall_us'][size, 2]
        for size in (64, 256)
        if (size, 2) in rows.index
    ]
    gain = ' and '.join(f'{each:.2f}' for each in gains)
    return (
        f'With {rows["count"].max():,} robot-steps in each measurement: a robot-step takes '
        f'{number(rows["processor_us"][first, 1])} µs of processor time with one robot and '
        f'{number(rows["processor_us"][last, 1])} µs with {last:,}. Most '
        f'robot-steps per second: {number(1e6 / rows["wall_us"][quickest])}, with '
        f'{quickest[0]:,} robots on {quickest[1]} threads. Two threads are {gain or "?"} times as '
        f'fast as one with 64 and 256 robots. A process with {last:,} robots takes '
        f'{rows["memory_mb"][last, 1]:,} MB, of which the libraries and one robot are '
        f'{rows["memory_mb"][first, 1]:,} MB.'
    )


def tell_camera(data: pd.DataFrame) -> str:
    """Return what a camera costs."""
    sentences = []
    for name, edges in (('camera', 'sharp edges'), ('camera, anti-aliased', 'anti-aliasing')):
        rows = data[data['what'] == name]
        first, last = rows.iloc[0], rows.iloc[-1]
        sentences.append(
            f'With {edges}, {(last["size"] / first["size"]) ** 2:,.0f} times as many pixels take '
            f'{last["processor_us"] / first["processor_us"]:.1f} times as long: '
            f'{number(first["processor_us"])} µs a step with {first["size"]} x {first["size"]} '
            f'and {number(last["processor_us"])} µs with {last["size"]} x {last["size"]}.'
        )
    return ' '.join(sentences)


def tell_network(data: pd.DataFrame) -> str:
    """Return what a network costs."""
    rows = data[data['what'] == 'network']
    paper, largest = rows.iloc[0], rows[rows['size'] * rows['other'] == 1_000_000]
    sentences = [
        f"50 ms of the paper's network, {paper['size']} neurons and {paper['other']} inputs, take "
        f'{number(paper["processor_us"])} µs, {number(50_000 / paper["processor_us"])} times as '
        'fast as real time.'
    ]
    for row in largest.itertuples():
        sentences.append(
            f'A million synapses, {row.size:,} neurons with {row.other:,} inputs each, take '
            f'{number(row.processor_us / 1000)} ms and {row.memory_mb:,} MB.'
        )
    return ' '.join(sentences)


def tell_ray(data: pd.DataFrame) -> str:
    """Return what an experiment on Ray takes."""
    walls = data[data['what'] == 'ray'].set_index('size')['wall_us'] / 1e6
    return (
        f'The eight trainings took {number(walls[1])} s on one worker and '
        f'{number(walls[2])} s on two ({walls[1] / walls[2]:.2f} times as fast), the start of Ray '
        'and of each process included.'
    )


FIGURE = (
    '![Robot-steps per second, memory, and the cost of cameras and networks]'
    '(results/performance.png)'
)

#: What is between the marks of the page, by their names.
BLOCKS: dict[str, Callable[[pd.DataFrame], str]] = {
    'machine': tell_machine,
    'fleet': lambda data: f'{tell_fleet(data)}\n\n{rows_of(data, "fleet")}',
    'camera': lambda data: (
        f'{tell_camera(data)}\n\n{rows_of(data, "camera", "camera, anti-aliased")}'
    ),
    'network': lambda data: f'{tell_network(data)}\n\n{rows_of(data, "network")}',
    'ray': tell_ray,
}


def rows_of(data: pd.DataFrame, *names: str) -> str:
    """Return the table of some things."""
    return table(data[data['what'].isin(names)])


def block(name: str, data: pd.DataFrame | None) -> str:
    """Return what is between two marks."""
    if data is None:
        return 'Not measured yet.'
    return re.sub(r'(?<![\d,])1 (robot|thread)s', r'1 \1', BLOCKS[name](data))


def fill(page: str, data: pd.DataFrame | None) -> str:
    """Return a page with what was measured between its marks.

    Args:
        page: The page.
        data: What was measured; None where nothing was.

    Raises:
        KeyError: The page has a mark of another name.
    """
    return re.sub(
        r'<!-- measured: (\w+) -->\n.*?<!-- end -->',
        lambda mark: f'<!-- measured: {mark[1]} -->\n{block(mark[1], data)}\n<!-- end -->',
        page,
        flags=re.DOTALL,
    )


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
    parser.add_argument('size', nargs='*', help='for `one` alone: what, size and other')
    parser.add_argument('--quick', action='store_true', help='a trial: all sizes, less exactly')
    parser.add_argument('--data', type=Path, default=DATA, help='the data (%(default)s)')
    parser.add_argument('--page', type=Path, default=PAGE, help='the page (%(default)s)')
    options = parser.parse_args()
    if options.what == 'one':
        name, size, other = options.size
        measure_here(name, int(size), int(other), QUICK if options.quick else FULL)
    elif options.what == 'measure':
        measure(options.data, ['--quick'] if options.quick else [])
    else:
        data = pd.read_csv(options.data)
        options.page.write_text(fill(options.page.read_text('utf-8'), data), 'utf-8')
        draw(data, options.data.with_suffix('.png'))


if __name__ == '__main__':
    main()
