"""What the scripts here share: reading what a command printed, and saying how values spread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import json
from pathlib import Path
import statistics
from typing import Any


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


def verdict(found: Mapping[str, Any] | None, aim: float) -> str:
    """Say whether a value to be kept below an aim is, as far as its 95 % interval tells."""
    if found is None or found['ci_low'] is None:
        return 'too few to tell'
    if found['ci_low'] > aim:
        return 'no'
    return 'yes' if found['ci_high'] is not None and found['ci_high'] <= aim else 'open'
