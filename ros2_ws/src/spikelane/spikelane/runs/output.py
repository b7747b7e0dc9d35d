"""The output of commands: where results go, and what shows people how far a run is."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
import contextlib
from pathlib import Path
import sys

#: Shows how a drive goes on: steps driven, metres along the lane.
OnProgress = Callable[[int, float], None]

#: Shows how a run goes on: steps done, share of it that is done.
ShowShare = Callable[[int, float], None]

_SHOWN_EVERY_STEPS = 100


def add_output_arguments(
    parser: argparse.ArgumentParser, out: str, default: Path | None = None
) -> None:
    """Declare where the results go, which `out` says, and in which form they are printed."""
    parser.add_argument('--out', type=Path, metavar='DIR', default=default, help=out)
    parser.add_argument('--json', action='store_true', help='print one JSON object')


@contextlib.contextmanager
def progress(is_quiet: bool, unit: str = 'm') -> Iterator[OnProgress]:
    """Give what shows progress to people: on one line of a terminal's standard error.

    It is called with steps and how far they have led, in the unit.
    """
    if is_quiet or not sys.stderr.isatty():
        yield lambda step, progress: None
        return
    due = 0

    def show(step: int, progress: float) -> None:
        nonlocal due
        if step >= due:
            due = step + _SHOWN_EVERY_STEPS
            print(f'\r{step:6d} steps, {progress:5.1f} {unit} ', end='', file=sys.stderr)

    try:
        yield show
    finally:
        print(file=sys.stderr)


def status_line(is_quiet: bool) -> Callable[[str], None]:
    """Return what shows people a text in place of the one before, on a terminal's last line."""
    if is_quiet or not sys.stderr.isatty():
        return lambda what: None
    return lambda what: print(f'\r\x1b[K{what}', end='', file=sys.stderr, flush=True)


def in_lines(lines: Mapping[str, str]) -> str:
    """Return results for people, one line each."""
    return '\n'.join(f'{name:15} {value}' for name, value in lines.items())
