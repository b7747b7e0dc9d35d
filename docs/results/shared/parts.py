"""Data that grows part by part: a CSV file, of which a column names the part of each row."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

Rows = list[dict[str, Any]]


def put_part(
    data: Path,
    column: str,
    part: str,
    rows: Sequence[Mapping[str, Any]],
    float_format: str | None = None,
) -> None:
    """Write the rows of a part, in place of those that there were.

    Args:
        data: The file; it need not exist.
        column: The one that names the parts.
        part: Name of the part.
        rows: Its rows, without this column.
        float_format: How fractions are written, as '%.6g'; None for all their digits.
    """
    found = pd.DataFrame([{column: part, **row} for row in rows])
    if data.exists():
        others = pd.read_csv(data)
        found = pd.concat([others[others[column] != part], found])
    found.to_csv(data, index=False, float_format=float_format)


def add_missing(
    data: Path,
    column: str,
    parts: Mapping[str, Callable[[], Rows]],
    float_format: str | None = None,
) -> None:
    """Make the parts that a file lacks, one after the other; for arguments see `put_part`."""
    for name, make in parts.items():
        if not data.exists() or name not in set(pd.read_csv(data)[column]):
            put_part(data, column, name, make(), float_format)
