"""Run networks of dopamine-modulated synapses in NEST; a script, as `nest_oracle` is.

    nest_dopamine_oracle.py INPUT.npz OUTPUT.npz

INPUT is that of `nest_oracle`, with weights_pa the initial ones, and holds dopamine (n_windows,
n_networks, n_neurons), to which n of every synapse on a neuron is set at each window's start, and
the synapses' common parameters by NEST's names as `synapse_...`. OUTPUT holds fired as that of
`nest_oracle`, and weights_pa and eligibility (n_windows, n_networks, n_neurons, n_inputs) at the
windows' ends.
"""

from __future__ import annotations

import importlib
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

GRID_MS = 0.1


def input_trains(spikes: NDArray[np.int64], networks: int, inputs: int) -> list[dict[str, Any]]:
    """Return the parameters of the spike generators; a spike in grid step k has stamp k + 1."""
    index = spikes[:, 0] * inputs + spikes[:, 1]
    stamps_ms = np.round((spikes[:, 2] + 1) * GRID_MS, 1)[np.argsort(index, kind='stable')]
    ends = np.cumsum(np.bincount(index, minlength=networks * inputs))[:-1]
    return [{'spike_times': stamps} for stamps in np.split(stamps_ms, ends)]


def simulate(given: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Build all the networks at once, run them and read what they did."""
    nest: Any = importlib.import_module('nest')
    nest.verbosity = nest.VerbosityLevel.ERROR
    nest.ResetKernel()
    nest.resolution = GRID_MS
    networks, neurons, inputs = given['weights_pa'].shape
    parameters = {k.removeprefix('neuron_'): float(given[k]) for k in given if k[:7] == 'neuron_'}
    common = {k.removeprefix('synapse_'): float(given[k]) for k in given if k[:8] == 'synapse_'}
    trains = input_trains(given['spikes'], networks, inputs)
    generators = nest.Create('spike_generator', networks * inputs, trains)
    parrots = nest.Create('parrot_neuron', networks * inputs)
    cells = nest.Create('iaf_psc_alpha', networks * neurons, parameters)
    recorder = nest.Create('spike_recorder')
    common['volume_transmitter'] = nest.Create('volume_transmitter')
    nest.CopyModel('stdp_dopamine_synapse', 'learning', common)
    to_relay = {'weight': 1.0, 'delay': float(given['delay_to_relay'])}
    nest.Connect(generators, parrots, 'one_to_one', to_relay)
    network, neuron, source = np.indices((networks, neurons, inputs)).reshape(3, -1)
    synapses = {
        'synapse_model': 'learning',
        'weight': given['weights_pa'].ravel(),
        'delay': np.full(network.size, float(given['delay_to_neuron'])),
    }
    sources = np.array(parrots)[network * inputs + source]
    nest.Connect(sources, np.array(cells)[network * neurons + neuron], 'one_to_one', synapses)
    nest.Connect(cells, recorder, 'all_to_all', {'delay': float(given['delay_to_neuron'])})

    connections = nest.GetConnections(synapse_model='learning')
    source = np.array(connections.source) - parrots[0].global_id
    neuron = np.array(connections.target) - cells[0].global_id
    place = neuron * inputs + source % inputs
    weights: list[NDArray[np.float64]] = []
    eligibility: list[NDArray[np.float64]] = []
    for dopamine in given['dopamine']:
        connections.n = dopamine.ravel()[neuron].tolist()
        nest.Simulate(int(given['window']) * GRID_MS)
        values = connections.get(['weight', 'c'])
        for kept, name in ((weights, 'weight'), (eligibility, 'c')):
            ordered = np.empty(place.size)
            ordered[place] = values[name]
            kept.append(ordered.reshape(networks, neurons, inputs))
    events = recorder.events
    grid_steps = np.round(np.array(events['times']) / GRID_MS).astype(np.int64) - 1
    network, neuron = np.divmod(events['senders'] - cells[0].global_id, neurons)
    fired = np.column_stack([network, neuron, grid_steps])
    return {
        'fired': fired[np.argsort(grid_steps, kind='stable')],
        'weights_pa': np.array(weights),
        'eligibility': np.array(eligibility),
    }


if __name__ == '__main__':
    np.savez(sys.argv[2], **simulate(dict(np.load(sys.argv[1]))))
