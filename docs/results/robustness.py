#!/usr/bin/env python3
"""Draws what experiments/robustness.yaml has left, and prints its table in Markdown.

source setup/env.sh; docs/results/robustness.py runs/robustness FIGURE.png
"""

from __future__ import annotations

from collections.abc import Mapping
import json
from pathlib import Path
import sys

from spikelane.experiment.results import RESULTS_FILE
from spikelane.figures.robustness import (
    DIFFICULTIES,
    draw_robustness,
    robustness_curves,
    RobustnessPoint,
)


def main() -> None:
    """Draw the figure and print the table."""
    if len(sys.argv) != 3:
        sys.exit('usage: robustness.py FOLDER FIGURE.png')
    folder, figure = map(Path, sys.argv[1:])
    results = json.loads((folder / RESULTS_FILE).read_text('utf-8'))
    draw_robustness(results, figure, 'Robustness, scenario 1')
    curves = robustness_curves(results)
    controllers = list(dict.fromkeys(name for found in curves.values() for name in found))
    print('| difficulty | ' + ' | '.join(controllers) + ' |')
    print('|---' * (1 + len(controllers)) + '|')
    for difficulty, by_controller in curves.items():
        values = sorted({each.value for curve in by_controller.values() for each in curve})
        for value in values:
            cells = [_cell(by_controller, name, value) for name in controllers]
            print(f'| {DIFFICULTIES[difficulty]}: {value:g} | ' + ' | '.join(cells) + ' |')


def _cell(
    by_controller: Mapping[str, list[RobustnessPoint]], controller: str, value: float
) -> str:
    """Return laps completed, and the mean error of these."""
    found = [each for each in by_controller.get(controller, ()) if each.value == value]
    if not found:
        return 'not driven'
    [measured] = found
    completed = measured.completed
    text = f'{completed["successes"]} of {completed["n"]}'
    return text if measured.error_m is None else f'{text}, {measured.error_m["mean"]:.4f} m'


if __name__ == '__main__':
    main()
