"""`spikelane report`: one page on many runs, with tables against the paper and its figures."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from spikelane.runs.output import add_output_arguments, status_line


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        'runs',
        nargs='+',
        type=Path,
        metavar='RUNS',
        help='folders that contain runs at any depth: laps, evaluations, trainings, transfers, '
        'experiments',
    )
    add_output_arguments(
        parser,
        'folder of report.html and its figures, which are overwritten (default: runs/report)',
        Path('runs/report'),
    )


def run(options: argparse.Namespace) -> int:
    """Report.

    Returns:
        0.

    Raises:
        SpikelaneError: There is nothing to report on, or a file cannot be written.
    """
    # Here and not above: the figures take their time.
    from spikelane.report.page import write_report

    show = status_line(options.json)
    result = write_report(options.runs, options.out, show)
    show('\r')
    if options.json:
        print(json.dumps(result))
        return 0
    files = f'{result["runs"]} runs, {len(result["figures"])} files of figures'
    print(f'{"page":10} {result["page"]}\n{"from":10} {files}')
    if result['left_out']:
        print(f'{"left out":10} {len(result["left_out"])}, named in it')
    return 0
