"""Run networks of iaf_psc_alpha neurons in NEST; a script, since NEST is noisy and global.

    nest_oracle.py INPUT.npz OUTPUT.npz

INPUT holds weights_pa (n_networks, n_neurons, n_inputs), spikes (n_spikes, 3) as network, input,
grid step in the order of grid steps, windows (their number), window (grid steps), and the neurons'
and connections' parameters by NEST's names as `neuron_...` and `delay_...`. Every input is a
spike_generator with a parrot_neuron. OUTPUT holds fired (n_spikes, 3) as network, neuron, grid
step in the order of grid steps, and potential_mv (n_networks, n_neurons, n_windows) at their ends.
"""

from __future__ import annotations

import importlib
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

GRID_MS = 0.1


def connect(nest: Any, sources: Any, targets: Any, weights: Any, delay_ms: float) -> None:
    """Connect pairs of nodes."""
    synapses = {'weight': weights, 'delay': np.full(len(sources), delay_ms)}
    nest.Connect(np.array(sources), np.array(targets), 'one_to_one', synapses)


def input_trains(spikes: NDArray[np.int64], networks: int, inputs: int) -> list[dict[str, Any]]:
    """Return the parameters of the spike generators; a spike in grid step k has stamp k + 1."""
    index = spikes[:, 0] * inputs + spikes[:, 1]
    stamps_ms = np.round((spikes[:, 2] + 1) * GRID_MS, 1)[np.argsort(index, kind='stable')]
    ends = np.cumsum(np.bincount(index, minlength=networks * inputs))[:-1]
    return [{'spike_times': stamps} for stamps in np.split(stamps_ms, ends)]


def simulate(given: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Build all the networks at once, run them and read what they did."""
    nest: Any = importlib.import_module('nest')
    nest.verbosity = nest.VerbosityLevel.ERROR
    nest.ResetKernel()
    nest.resolution = GRID_MS
    networks, neurons, inputs = given['weights_pa'].shape
    parameters = {k.removeprefix('neuron_'): float(given[k]) for k in given if k[:7] == 'neuron_'}
    generators = nest.Create(
        'spike_generator', networks * inputs, input_trains(given['spikes'], networks, inputs)
    )
    parrots = nest.Create('parrot_neuron', networks * inputs)
    cells = nest.Create('iaf_psc_alpha', networks * neurons, parameters)
    recorder = nest.Create('spike_recorder')
    connect(nest, generators, parrots, np.ones(len(parrots)), float(given['delay_to_relay']))
    network, neuron, source = np.indices((networks, neurons, inputs)).reshape(3, -1)
    connect(
        nest,
        np.array(parrots)[network * inputs + source],
        np.array(cells)[network * neurons + neuron],
        given['weights_pa'].ravel(),
        float(given['delay_to_neuron']),
    )
    nest.Connect(cells, recorder)

    potentials = []
    for _ in range(int(given['windows'])):
        nest.Simulate(int(given['window']) * GRID_MS)
        potentials.append(cells.V_m)
    events = recorder.events
    grid_steps = np.round(np.array(events['times']) / GRID_MS).astype(np.int64) - 1
    network, neuron = np.divmod(events['senders'] - cells[0].global_id, neurons)
    fired = np.column_stack([network, neuron, grid_steps])
    return {
        'fired': fired[np.argsort(grid_steps, kind='stable')],
        'potential_mv': np.array(potentials).T.reshape(networks, neurons, -1),
    }


if __name__ == '__main__':
    result = simulate(dict(np.load(sys.argv[1])))
    np.savez(sys.argv[2], fired=result['fired'], potential_mv=result['potential_mv'])
