"""The figure of docs/performance.md: costs over their sizes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
import pandas as pd

from spikelane_sim.figure_style import LEFT, new_figure, RIGHT, save, settings


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
