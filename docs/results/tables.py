"""What the scripts here share: reading what a command printed, and saying how values spread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import json
from pathlib import Path
import statistics
from typing import Any

from spikelane.statistics import share_statistics


def read_json(path: Path) -> dict[str, Any]:
    """Return what a command printed, or nothing where it has not run yet."""
    content: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    return content


def print_row(*cells: str) -> None:
    """Print a row of a table."""
    print(f'| {" | ".join(cells)} |')


def spread(values: Sequence[float | None], form: str, unit: str = '') -> str:
    """Return median, smallest and largest in words; of a single value, or equal ones, that."""
    known = [value for value in values if value is not None]
    if len(set(known)) < 2:
        return f'{known[0]:{form}}{unit}' if known else 'none'
    median = statistics.median(known)
    if all(isinstance(value, int) for value in known):
        median = round(median)
    return f'{median:{form}}{unit} ({min(known):{form}} to {max(known):{form}})'


def verdict(found: Mapping[str, Any] | None, aim: float, at_least: bool = False) -> str:
    """Say whether an aim is reached, as far as the 95 % interval of a value tells.

    Args:
        found: `ci_low` and `ci_high`, either of them None where there is none.
        aim: What the value is to be at most.
        at_least: Whether it is to be at least that instead.
    """
    low, high = (None, None) if found is None else (found['ci_low'], found['ci_high'])
    if low is None:
        return 'too few to tell'
    is_below = high is not None and high <= aim
    is_above = low >= aim
    if not is_below and not is_above:
        return 'open'
    return 'yes' if is_above == at_least else 'no'


def share_in_words(successes: int, n: int) -> str:
    """Return a share of independent units, with its 95 % interval (Wilson's)."""
    share = share_statistics(successes, n)
    return f'{successes} of {n} ({share["ci_low"]:.0%} to {share["ci_high"]:.0%})'
