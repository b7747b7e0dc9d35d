#!/usr/bin/env python3
"""Draws what experiments/robustness.yaml has left.

source setup/env.sh; docs/results/robustness.py runs/robustness FIGURE.svg
"""

from __future__ import annotations

import json
from pathlib import Path
import sys

from spikelane.experiment.results import RESULTS_FILE
from spikelane.figures.robustness import draw_robustness


def main() -> None:
    """Draw the figure."""
    if len(sys.argv) != 3:
        sys.exit('usage: robustness.py FOLDER FIGURE.svg')
    folder, figure = map(Path, sys.argv[1:])
    results = json.loads((folder / RESULTS_FILE).read_text('utf-8'))
    for path in draw_robustness(results, figure, 'Robustness, scenario 1'):
        print(path)


if __name__ == '__main__':
    main()
