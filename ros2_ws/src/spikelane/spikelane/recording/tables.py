"""A recording as tables of pandas."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import pandas as pd

from spikelane_sim.files import FileError
from spikelane_sim.period import PERIOD_MS


def recorded_names(path: Path) -> tuple[str, ...]:
    """Return the names of the quantities in a recording.

    Raises:
        FileError: It cannot be read.
    """
    with opened(path) as file:
        return quantity_names(file)


def recorded_table(path: Path, name: str) -> pd.DataFrame:
    """Return a quantity of a recording as a table.

    Args:
        path: The file.
        name: Name of the quantity.

    Returns:
        Spikes have a row each, in the order of time: `time_ns` and what fired, as `neuron`. Other
        quantities have a row for each value: `time_ns`, a column for each axis, as `neuron` and
        `input`, and `value` in the quantity's unit. Columns of axes are categories.

    Raises:
        FileError: It cannot be read.
        KeyError: It does not have the quantity.
    """
    with opened(path) as file:
        if name not in quantity_names(file):
            raise KeyError(name)
        if name not in file.variables:
            return _spikes(file, name)
        variable = file.variables[name]
        growing, *axes = variable.dimensions
        times_ns = _times_ns(file, name, growing)
        shape = tuple(variable.shape)
        columns: dict[str, Any] = {'time_ns': np.repeat(times_ns, int(np.prod(shape[1:])))}
        for number, axis in enumerate(axes, 1):
            within = np.arange(shape[number]).repeat(int(np.prod(shape[number + 1 :])))
            codes = np.tile(within, int(np.prod(shape[:number])))
            columns[axis] = pd.Categorical.from_codes(codes, labels_of(file, axis))
        return pd.DataFrame({**columns, 'value': variable[...].ravel()})


def opened(path: Path) -> Any:
    """Open a recording.

    Raises:
        FileError: It cannot be read.
    """
    try:
        return h5netcdf.File(path, 'r')
    except OSError as error:
        raise FileError(f'{path}: cannot be read: {error}') from None


def quantity_names(file: Any) -> tuple[str, ...]:
    """Return the names of the quantities in an open recording."""
    return tuple(str(file.attrs['quantities']).split())


def _spikes(file: Any, name: str) -> pd.DataFrame:
    times = file.variables[f'{name}_time_ns']
    axis = str(times.attrs['axis'])
    codes = file.variables[f'{name}_{axis}'][...]
    return pd.DataFrame(
        {
            'time_ns': times[...],
            axis: pd.Categorical.from_codes(codes, labels_of(file, axis)),
        }
    )


def _times_ns(file: Any, name: str, growing: str) -> Any:
    """Return when the samples of a quantity were taken."""
    if growing != 'step':
        return file.variables[f'{name}_time_ns'][...]
    stamps_ns = file.variables['stamp_ns'][...]
    period_ns = int(file.attrs.get('period_ms', PERIOD_MS)) * 1_000_000
    return stamps_ns - period_ns + int(file.variables[name].attrs['offset_ns'])


def labels_of(file: Any, axis: str) -> list[str]:
    """Return the labels of an axis in an open recording."""
    return [
        each.decode() if isinstance(each, bytes) else str(each)
        for each in file.variables[axis][...]
    ]
