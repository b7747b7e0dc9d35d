"""Columns that grow by rows and take little memory, however long a drive is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_CHUNK_ROWS = 4096


class ColumnStore:
    """Rows kept as arrays, one for each column, a chunk at a time: 8 bytes for each number."""

    def __init__(self, kinds: Mapping[str, type]) -> None:
        """Begin without rows.

        Args:
            kinds: NumPy type of each column, by name, in the order of the values of a row.
        """
        self._kinds = dict(kinds)
        self._chunks: dict[str, list[NDArray[Any]]] = {name: [] for name in kinds}
        self._rows: list[tuple[Any, ...]] = []
        self._packed = 0

    def __len__(self) -> int:
        """Return the number of rows."""
        return self._packed + len(self._rows)

    def append(self, row: tuple[Any, ...]) -> None:
        """Add a row, one value for each column."""
        self._rows.append(row)
        if len(self._rows) >= _CHUNK_ROWS:
            self.pack()

    def pack(self) -> None:
        """Turn the rows that are not yet in arrays into arrays."""
        if not self._rows:
            return
        columns = zip(self._kinds.items(), zip(*self._rows, strict=True), strict=True)
        for (name, kind), values in columns:
            self._chunks[name].append(np.array(values, kind))
        self._packed += len(self._rows)
        self._rows = []

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns by name, each (n,); the store holds them once afterwards."""
        self.pack()
        for name, chunks in self._chunks.items():
            whole = np.concatenate(chunks) if chunks else np.empty(0, self._kinds[name])
            self._chunks[name] = [whole]
        return {name: chunks[0] for name, chunks in self._chunks.items()}
