"""The file of a recording: NetCDF-4, which is HDF5, written in parts as the run goes on.

Dimensions and variables, for a controller that recorded all of its quantities:

    stamp_ns(step)             simulation time at the end of each step, as in the trajectory
    episode(step)              the episode, counted from 1
    episode_step(step)         steps since the reset
    spikes_time_ns(spikes)     simulation time of each spike, and so on for other spikes
    spikes_neuron(spikes)      index of what fired, in the coordinate of that name
    weights(step, neuron, input)
    potentials(potentials_sample, neuron)
    potentials_time_ns(potentials_sample)
    neuron(neuron)             names, and so on for other axes

A quantity that is sampled once a step has the dimension `step`. One with several samples has a
dimension and times of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import os
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.quantities import Axis, checked_sample, Quantity, Sample, SpikeTimes
from spikelane_sim.errors import ParameterError
from spikelane_sim.period import PERIOD_MS

#: What is kept in memory before it is written.
_PART_BYTES = 4 << 20
_CHUNK_BYTES = 1 << 18
#: Space on the disk that is taken in advance, in addition to what is to be written.
_MARGIN_BYTES = 8 << 20
_ROWS = {'stamp_ns': 'i8', 'episode': 'i8', 'episode_step': 'i8'}
_WORDS = {
    'stamp_ns': 'simulation time at the end of the step [ns]',
    'episode': 'number of the episode',
    'episode_step': 'steps of 50 ms since the reset',
}


class RecordingFile:
    """A recording that is being written.

    Memory does not grow with its length: after every 4 MB what was added is written and forgotten.
    """

    def __init__(
        self, path: Path, quantities: Sequence[Quantity], facts: Mapping[str, Any]
    ) -> None:
        """Begin without steps.

        Args:
            path: The file, which is written over.
            quantities: What is recorded, at least one quantity.
            facts: Attributes of the file: numbers and texts; `period_ms` is the control period,
                50 ms where it is not given.

        Raises:
            ParameterError: Two quantities have axes of one name with other labels.
            OSError: It cannot be written.
        """
        self._quantities = tuple(quantities)
        axes = _axes(quantities)
        self._path = path
        self._kept_bytes = 0
        self._period_ns = int(facts.get('period_ms', PERIOD_MS)) * 1_000_000
        path.write_bytes(b'')
        _reserve(path, 0, _MARGIN_BYTES)
        self._hdf5 = h5py.File(path, 'w')
        self._file = h5netcdf.File(self._hdf5, 'w')
        _reserve(path, 0, _MARGIN_BYTES)
        self._parts: dict[str, list[NDArray[Any]]] = {}
        self._dimension: dict[str, str] = {}  # of each variable, the one along which it grows
        for name, value in facts.items():
            self._file.attrs[name] = value
        self._file.attrs['quantities'] = ' '.join(each.name for each in quantities)
        for axis in axes.values():
            self._file.dimensions[axis.name] = len(axis.labels)
            names = np.array(axis.labels, dtype=object)
            self._file.create_variable(
                axis.name, (axis.name,), dtype=h5py.string_dtype(), data=names
            )
        for name, kind in _ROWS.items():
            self._create(name, ('step',), kind, _WORDS[name])
        for quantity in self._quantities:
            self._create_quantity(quantity)

    def append(
        self, stamp_ns: int, episode: int, episode_step: int, samples: Mapping[str, Sample]
    ) -> None:
        """Add a step.

        Args:
            stamp_ns: Simulation time at its end [ns].
            episode: Number of the episode.
            episode_step: Steps since the reset.
            samples: Samples of every quantity.

        Raises:
            ParameterError: A sample is missing, or has another shape than its quantity.
            OSError: It cannot be written.
        """
        rows = dict(zip(_ROWS, (stamp_ns, episode, episode_step), strict=True))
        for name, value in rows.items():
            self._keep(name, np.array([value], np.int64))
        begin_ns = stamp_ns - self._period_ns
        for quantity in self._quantities:
            name, sample = quantity.name, checked_sample(quantity, samples)
            if isinstance(sample, SpikeTimes):
                self._keep(f'{name}_time_ns', begin_ns + sample.offsets_ns)
                self._keep(f'{name}_{quantity.axes[0].name}', sample.sources)
                continue
            self._keep(name, np.array(sample, np.float64))
            if len(quantity.offsets_ns) > 1:
                times_ns = begin_ns + np.array(quantity.offsets_ns, np.int64)
                self._keep(f'{name}_time_ns', times_ns)
        if self._kept_bytes >= _PART_BYTES:
            self._write()

    def close(self, *, is_complete: bool) -> None:
        """Write what is left, and whether the run went to its end.

        Raises:
            OSError: It cannot be written.
        """
        self._write()
        self._file.attrs['complete'] = int(is_complete)
        self.abandon()

    def abandon(self) -> None:
        """Close the file, whatever is in it."""
        self._file.flush()
        size = self._hdf5.id.get_filesize()
        self._file.close()
        self._hdf5.close()
        os.truncate(self._path, size)  # what was reserved is not needed

    def _create_quantity(self, quantity: Quantity) -> None:
        name, axes = quantity.name, tuple(axis.name for axis in quantity.axes)
        if quantity.is_spikes:
            words = f'{quantity.words}: simulation time [ns]'
            times = self._create(f'{name}_time_ns', (name,), 'i8', words)
            times.attrs['axis'] = axes[0]
            self._create(f'{name}_{axes[0]}', (name,), 'i8', f'index of the {axes[0]} that fired')
            return
        if len(quantity.offsets_ns) == 1:
            variable = self._create(name, ('step', *axes), 'f8', quantity.words)
            variable.attrs['offset_ns'] = min(quantity.offsets_ns[0], self._period_ns)
        else:
            sample = f'{name}_sample'
            variable = self._create(name, (sample, *axes), 'f8', quantity.words)
            words = f'{quantity.words}: simulation time [ns]'
            self._create(f'{name}_time_ns', (sample,), 'i8', words)
        variable.attrs['units'] = quantity.unit

    def _create(self, name: str, dimensions: tuple[str, ...], kind: str, words: str) -> Any:
        """Make a variable that grows along its first dimension."""
        growing, *others = dimensions
        if growing not in self._file.dimensions:
            self._file.dimensions[growing] = None
        shape = [self._file.dimensions[each].size for each in others]
        row_bytes = 8 * int(np.prod(shape, dtype=np.int64))
        rows = max(1, _CHUNK_BYTES // max(1, row_bytes))
        variable = self._file.create_variable(
            name,
            dimensions,
            kind,
            chunks=(rows, *shape),
            compression='gzip',
            compression_opts=1,
            shuffle=True,
        )
        variable.attrs['long_name'] = words
        self._parts[name], self._dimension[name] = [], growing
        return variable

    def _keep(self, name: str, values: NDArray[Any]) -> None:
        self._parts[name].append(values)
        self._kept_bytes += values.nbytes

    def _write(self) -> None:
        """Write what was added since the last time."""
        # Compressed it takes less; of each variable a chunk may be written anew.
        _reserve(self._path, self._hdf5.id.get_filesize(), self._kept_bytes + _MARGIN_BYTES)
        self._kept_bytes = 0
        parts = {name: np.concatenate(each) for name, each in self._parts.items() if each}
        sizes = {self._dimension[name]: len(values) for name, values in parts.items()}
        begins = {each: self._file.dimensions[each].size for each in sizes}
        for dimension, size in sizes.items():
            self._file.resize_dimension(dimension, begins[dimension] + size)
        for name, values in parts.items():
            begin = begins[self._dimension[name]]
            self._file.variables[name][begin : begin + len(values)] = values
            self._parts[name] = []


def _reserve(path: Path, begin: int, size: int) -> None:
    """Take space on the disk before it is written to: HDF5 does not survive a full one.

    Raises:
        OSError: There is not so much.
    """
    descriptor = os.open(path, os.O_RDWR)
    try:
        os.posix_fallocate(descriptor, begin, size)
    finally:
        os.close(descriptor)


def _axes(quantities: Sequence[Quantity]) -> dict[str, Axis]:
    """Return the axes of all quantities by name."""
    found: dict[str, Axis] = {}
    for quantity in quantities:
        for axis in quantity.axes:
            if found.setdefault(axis.name, axis) != axis:
                raise ParameterError(
                    f'{quantity.name}: expected the same labels on all axes {axis.name!r}, '
                    f'got {len(axis.labels)} others'
                )
    return found
