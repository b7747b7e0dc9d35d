"""`spikelane report`: one page on many runs, with tables against the paper and its figures."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
import sys


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        'runs',
        nargs='+',
        type=Path,
        metavar='RUNS',
        help='folders of runs, or above them: of laps, evaluations, trainings, transfers, '
        'experiments',
    )
    parser.add_argument(
        '--out',
        type=Path,
        metavar='DIR',
        default=Path('runs/report'),
        help='folder of report.html and its figures, written over (default: runs/report)',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(options: argparse.Namespace) -> int:
    """Report.

    Returns:
        0.

    Raises:
        SpikelaneError: There is nothing to report on, or a file cannot be written.
    """
    # Here and not above: the figures take their time.
    from spikelane.report.page import write_report

    def show(what: str) -> None:
        if not options.json and sys.stderr.isatty():
            print(f'\r\x1b[K{what}', end='', file=sys.stderr, flush=True)

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
