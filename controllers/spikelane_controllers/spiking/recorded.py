"""What spiking controllers record, in the form of `quantities`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spikelane_controllers.quantities import Axis, Quantity, SpikeTimes
from spikelane_controllers.spiking.neuron import SAMPLE_STEPS
from spikelane_controllers.spiking.spikes import GRID_MS, Spikes
from spikelane_sim.encoding import EncodingParameters

#: Grid on which neurons are integrated [ns].
GRID_NS = round(GRID_MS * 1e6)


def sample_offsets_ns(period_ns: int) -> tuple[int, ...]:
    """Return when in a step of this length potentials are sampled [ns after its beginning]."""
    interval_ns = GRID_NS * SAMPLE_STEPS
    return tuple(range(interval_ns, period_ns + 1, interval_ns))


def neuron_axis(neurons: Sequence[str]) -> Axis:
    """Return the axis of neurons with these names."""
    return Axis('neuron', tuple(neurons))


def input_axis(encoding: EncodingParameters) -> Axis:
    """Return the axis of the inputs, one for each cell of the image: 'row,column' from its top."""
    cells = np.ndindex(encoding.rows, encoding.columns)
    return Axis('input', tuple(f'{row},{column}' for row, column in cells))


def spikes_of(neurons: Axis) -> Quantity:
    """Return the quantity of the neurons' spikes."""
    return Quantity('spikes', 'spikes of the neurons', 'ns', (neurons,), is_spikes=True)


def input_spikes_of(inputs: Axis) -> Quantity:
    """Return the quantity of the inputs' spikes."""
    words = 'spikes of the inputs, which reach the neurons after the delays'
    return Quantity('input_spikes', words, 'ns', (inputs,), is_spikes=True)


def potentials_of(neurons: Axis, offsets_ns: tuple[int, ...]) -> Quantity:
    """Return the quantity of the neurons' membrane potentials."""
    return Quantity('potentials', 'membrane potentials', 'mV', (neurons,), offsets_ns)


def spike_times(spikes: Spikes, grid_ns: int = GRID_NS) -> SpikeTimes:
    """Return when spikes happened: one in a grid step is at its end.

    Args:
        spikes: In the order of grid steps.
        grid_ns: Length of a grid step.
    """
    return SpikeTimes((spikes['step'] + 1) * grid_ns, spikes['source'].copy())
