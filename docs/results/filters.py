#!/usr/bin/env python3
"""Draws what experiments/filters.yaml has left, and prints its tables in Markdown.

source setup/env.sh; docs/results/filters.py runs/filters FIGURE.png
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import json
from pathlib import Path
import sys
from typing import Any, NamedTuple

import numpy as np
from shared.tables import print_row, table_header
import yaml

from spikelane_sim import figure_style as style

_RATES = {'coppelia': 'pixels.coppelia.noise_rate_hz', 'esim': 'pixels.esim.shot_rate_hz'}
_TITLES = {
    'coppelia': "the paper's camera (coppelia)",
    'esim': 'pixels of a real sensor (esim)',
}
_COLOURS = (style.INK, '#cc79a7', style.LEFT, style.RIGHT, '#009e73')
_MARKERS = 'xv^so'
_SEEDS = 10  # of a condition that is driven whole


class Measured(NamedTuple):
    """The laps there are under one noise rate, with one filter."""

    rate_hz: float
    laps: int
    completed: int
    error_m: float | None  # mean error of completed laps, None without any


def main() -> None:
    """Draw the figure and print the tables."""
    if len(sys.argv) != 3:
        sys.exit('usage: filters.py FOLDER FIGURE.png')
    folder, figure = map(Path, sys.argv[1:])
    curves = curves_of(folder)
    draw(curves, figure)
    for pixels, by_filter in curves.items():
        print(f'\n{_TITLES[pixels]}:\n')
        rates = sorted({each.rate_hz for curve in by_filter.values() for each in curve})
        print(table_header('filter', *(f'{rate:g} Hz' for rate in rates)))
        for name, curve in by_filter.items():
            print_row(name, *(_cell(curve, rate) for rate in rates))


def curves_of(folder: Path) -> dict[str, dict[str, list[Measured]]]:
    """Return what was measured, by pixel model and filter, by rising noise rate.

    Also the laps of evaluations that are not finished count.
    """
    curves: dict[str, dict[str, list[Measured]]] = {}
    for run in sorted(folder.glob('evaluate-*')):
        config = yaml.safe_load((run / 'config.yaml').read_text('utf-8'))
        pixels = config['simulator']['pixels.model']
        rows = [json.loads(each.read_text('utf-8')) for each in run.glob('laps/*/metrics.json')]
        if rows:
            errors = [row['mean_abs_distance_m'] for row in rows if row['completed']]
            mean_m = sum(errors) / len(errors) if errors else None
            rate_hz = config['simulator'][_RATES[pixels]]
            measured = Measured(rate_hz, len(rows), len(errors), mean_m)
            name = _filter_name(config.get('filter'))
            curves.setdefault(pixels, {}).setdefault(name, []).append(measured)
    return {
        pixels: {name: sorted(of[name]) for name in sorted(of, key=_position)}
        for pixels, of in sorted(curves.items())
    }


def _position(name: str) -> int:
    """Return where a filter stands in the table."""
    starts = ('none', 'refractory', 'nearest', 'correlation, 2', 'correlation, 3')
    return next(number for number, start in enumerate(starts) if name.startswith(start))


def _filter_name(filters: Mapping[str, Any] | None) -> str:
    """Return what a filter is in words."""
    if filters is None:
        return 'none'
    chain = filters['chain']
    if chain == 'refractory':
        return f'refractory, {1000 * filters["refractory.period_s"]:g} ms'
    if chain == 'nearest_neighbour':
        return f'nearest neighbour, {1000 * filters["nearest_neighbour.window_s"]:g} ms'
    window_ms, supporters = (
        1000 * filters['correlation.window_s'],
        filters['correlation.supporters'],
    )
    return f'correlation, {supporters} within {window_ms:g} ms'


def _cell(curve: Sequence[Measured], rate_hz: float) -> str:
    """Return laps completed, and the mean error of these."""
    found = [each for each in curve if each.rate_hz == rate_hz]
    if not found:
        return 'not driven'
    [measured] = found
    text = f'{measured.completed} of {measured.laps}'
    return text if measured.error_m is None else f'{text}, {measured.error_m:.4f} m'


def draw(curves: Mapping[str, Mapping[str, Sequence[Measured]]], path: Path) -> None:
    """Draw laps completed and error against the noise rate, a column for each pixel model."""
    with style.settings():
        figure = style.new_figure(9.4, 5.6)
        style.write_title(
            figure,
            'R-STDP as shipped, scenario 1: noise and filters',
            'hollow: fewer than ten laps',
        )
        for index, (pixels, by_filter) in enumerate(curves.items()):
            left = 0.08 + index * 0.47
            errors = figure.add_axes((left, 0.6, 0.43, 0.31))
            completed = figure.add_axes((left, 0.27, 0.43, 0.29))
            for (name, curve), colour, marker in zip(
                by_filter.items(), _COLOURS, _MARKERS, strict=False
            ):
                look: dict[str, Any] = {
                    'color': colour,
                    'marker': marker,
                    'markersize': 5,
                    'linewidth': 1.2,
                }
                done = [(each.rate_hz, each.error_m) for each in curve if each.completed]
                errors.plot(*zip(*done, strict=True) if done else ([], []), **look)
                shares = [100 * each.completed / each.laps for each in curve]
                completed.plot([each.rate_hz for each in curve], shares, label=name, **look)
                few = [number for number, each in enumerate(curve) if each.laps < _SEEDS]
                for axes in (errors, completed):
                    [line] = axes.get_lines()[-1:]
                    points = np.array(line.get_xydata())
                    is_few = [x in [curve[number].rate_hz for number in few] for x, _ in points]
                    axes.plot(
                        *points[is_few].T,
                        linestyle='none',
                        marker=marker,
                        markersize=3,
                        color='white',
                        zorder=3,
                    )
            errors.set_title(_TITLES[pixels], fontsize=style.NORMAL_PT)
            errors.tick_params(labelbottom=False)
            completed.set_ylim(-4, 104)
            completed.set_xlabel('noise rate of a pixel [Hz]')
            for axes in (errors, completed):
                axes.set_xscale('log')
                axes.set_xlim(0.08, 12.5)
                axes.set_xticks([0.1, 0.3, 1, 3, 10], ['0.1', '0.3', '1', '3', '10'])
                axes.minorticks_off()
            errors.set_ylim(0, 0.05)
            if not index:
                errors.set_ylabel('mean error of laps [m]')
                completed.set_ylabel('laps completed [%]')
            completed.legend(
                loc='upper left',
                bbox_to_anchor=(0, -0.34),
                fontsize=style.SMALL_PT,
                ncols=2,
                frameon=False,
            )
        style.save(figure, path)


if __name__ == '__main__':
    main()
