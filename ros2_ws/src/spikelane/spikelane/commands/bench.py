"""`spikelane bench`: measures what is promised about speed, with the benches of a checkout."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
import sys

from spikelane_sim.errors import SpikelaneError

#: In the root of a checkout; no part of an installation.
_BENCHES = Path('benches')
_PACKAGE = 'spikelane_benches'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.add_argument(
        'names',
        nargs='*',
        metavar='NAME',
        help='benchmarks to run, by their printed names (default: all)',
    )
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(options: argparse.Namespace) -> int:
    """Measure; what cannot be measured here is skipped, with a message.

    Returns:
        0 where all that was promised and measured is kept, otherwise 1.

    Raises:
        SpikelaneError: There are no benches, a name is unknown, or a measurement failed.
    """
    sys.path.insert(0, str(find_benches(Path(__file__))))
    measured = importlib.import_module(f'{_PACKAGE}.benchmarks')
    return int(measured.run(options.names, as_json=options.json))


def find_benches(module: Path) -> Path:
    """Return the folder of the benches of the checkout that a module belongs to.

    Raises:
        SpikelaneError: The module belongs to an installed copy, which has no benches.
    """
    for parent in module.resolve().parents:
        if (parent / _BENCHES / _PACKAGE).is_dir():
            return parent / _BENCHES
    raise SpikelaneError(
        f'expected {_BENCHES / _PACKAGE} in a folder above {module.parent}, got none: '
        "an installed copy has no benches; use ./spikelane in a checkout of Spikelane's repository"
    )
