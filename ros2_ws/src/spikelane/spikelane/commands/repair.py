"""`spikelane repair`: a bag whose recorder was killed becomes one that every program reads."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from spikelane.bag.repair import Repair, repair_bag
from spikelane.runs.output import add_output_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.description = (
        'Repair an MCAP bag that other programs refuse because its recorder was killed or a file '
        'is damaged: all messages that can be read are kept, with their times, types, QoS and '
        'custom data, and metadata.yaml is rewritten. Files without damage stay as they are, '
        'and each other file is replaced only when the new one has been read whole.'
    )
    parser.add_argument(
        'bag', type=Path, metavar='BAG', help="a bag's folder, or one .mcap file alone"
    )
    add_output_arguments(
        parser, 'new folder for the repaired bag, which leaves BAG as it is (default: repair BAG)'
    )


def run(options: argparse.Namespace) -> int:
    """Repair.

    Returns:
        0, also where there is nothing to repair.

    Raises:
        SpikelaneError: The bag cannot be repaired; it is then as it was.
    """
    repair = repair_bag(options.bag, options.out)
    if options.json:
        result = {**repair._asdict(), 'path': str(repair.path)}
        print(json.dumps(result))
    else:
        print(_summary(repair))
    return 0


def _summary(repair: Repair) -> str:
    if not repair.written:
        lines = [f'{repair.path}: nothing to repair, {repair.message_count} messages']
    else:
        names = ', '.join(repair.written)
        lines = [f'{repair.path}: {repair.message_count} messages saved; rewritten files: {names}']
    return '\n'.join(lines + [f'note: {note}' for note in repair.notes])
