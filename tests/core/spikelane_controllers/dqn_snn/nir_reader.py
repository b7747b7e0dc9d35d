"""A reader of exported NIR files, written from `docs/nir.md` alone.

It shows that the file and that page are enough: nothing of Spikelane is imported here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nir
import numpy as np
from numpy.typing import NDArray


class Layer:
    """An Affine node and the IF node behind it."""

    def __init__(self, affine: Any, neurons: Any, start: float, v_min: float) -> None:
        self.weight = affine.weight.astype(np.float64)
        self.bias = affine.bias.astype(np.float64)
        self.threshold, self.reset = neurons.v_threshold, neurons.v_reset
        self.v_min = v_min
        self.potential = np.full(len(self.bias), float(start))

    def step(self, spikes: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Run one time step."""
        potential = self.potential + self.weight[:, spikes].sum(axis=1) + self.bias
        fires: NDArray[np.bool_] = potential >= self.threshold
        self.potential = np.where(fires, self.reset, np.maximum(potential, self.v_min))
        return fires


class Reader:
    """The controller in a NIR file, for one episode."""

    def __init__(self, path: Path, generator: np.random.Generator) -> None:
        graph = nir.read(path)
        self.metadata = graph.metadata
        assert self._text('format') == 'spikelane.dqn_snn'
        assert self.metadata['format_version'] == 1
        start = self.metadata['initial_potential']
        v_min = self.metadata.get('v_min', -np.inf)
        self.hidden = Layer(graph.nodes['to_hidden'], graph.nodes['hidden'], start, v_min)
        self.output = Layer(graph.nodes['to_output'], graph.nodes['action'], start, v_min)
        self.actions = self._text('actions').split()
        self.traces = np.full(len(self.actions), float(self.metadata['initial_trace']))
        inputs = self.metadata['input_rows'] * self.metadata['input_columns']
        self.frames = np.zeros((self.metadata['input_frames'], inputs), np.int64)
        self.generator = generator

    def answer(self, x: NDArray[Any], y: NDArray[Any]) -> tuple[float, float]:
        """Answer an observation: columns and rows of its events; return the wheels [rad/s]."""
        self.frames = np.vstack([self.frames[1:], self._count(x, y)])
        spikes = np.zeros(len(self.actions), np.int64)
        for inputs in self._input_spikes(self.frames.sum(axis=0)):
            spikes += self.output.step(self.hidden.step(inputs))
        self.traces = self.metadata['trace_decay'] * self.traces + spikes
        action = int(np.argmax(self.traces))
        return (
            float(self.metadata['action_left_wheel_rad_s'][action]),
            float(self.metadata['action_right_wheel_rad_s'][action]),
        )

    def _count(self, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.int64]:
        about = self.metadata
        x, y = x.astype(np.int64), y.astype(np.int64)
        end = about['sensor_height_px'] - about['crop_bottom_px']
        kept = (y >= about['crop_top_px']) & (y < end)
        rows = (y[kept] - about['crop_top_px']) // about['cell_px']
        index = rows * about['input_columns'] + x[kept] // about['cell_px']
        return np.bincount(index, minlength=self.frames.shape[1])

    def _input_spikes(self, counts: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which inputs fire, (time steps, inputs)."""
        steps = int(self.metadata['time_steps_per_observation'])
        active = np.flatnonzero(counts)
        values = np.minimum(counts[active] * self.metadata['input_value_per_event'], 1)
        probability = values.astype(np.float32) * np.float32(
            self.metadata['input_spike_probability']
        )
        spikes = np.zeros((steps, len(counts)), bool)
        spikes[:, active] = self.generator.random((steps, len(active))) < probability
        return spikes

    def _text(self, name: str) -> str:
        text = self.metadata[name]
        return text.decode() if isinstance(text, bytes) else str(text)
