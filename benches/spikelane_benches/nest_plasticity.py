"""The R-STDP network in NEST; a script, since NEST is noisy, global and no part of Spikelane.

    python benches/spikelane_benches/nest_plasticity.py INPUT.npz OUTPUT.npz

See `plasticity.measure_plasticity`, which writes INPUT and reads OUTPUT.
"""

from __future__ import annotations

import importlib
import sys
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray


def simulate(given: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Run the network window by window, dopamine set before each.

    Returns:
        `fired` (n_spikes, 2) as grid step and neuron; `weights_pa` at the end; `simulate_us` and
        `set_us` (n_windows,), how long NEST took to simulate each and to set the dopamine: of all
        synapses by a list in even windows, of each neuron's by one value in odd ones.
    """
    nest: Any = importlib.import_module('nest')
    nest.verbosity = nest.VerbosityLevel.ERROR
    nest.resolution = 0.1
    neurons, inputs = given['weights_pa'].shape
    stamps, sources = (given['spikes'] + [1, 0]).T
    trains = [{'spike_times': np.round(stamps[sources == j] * 0.1, 1)} for j in range(inputs)]
    generators = nest.Create('spike_generator', inputs, trains)
    parrots = nest.Create('parrot_neuron', inputs)
    cells = nest.Create('iaf_psc_alpha', neurons, {'t_ref': 2.0})
    recorder = nest.Create('spike_recorder')
    common = {
        'A_minus': 1.0,
        'Wmax': 3000.0,
        'volume_transmitter': nest.Create('volume_transmitter'),
    }
    nest.CopyModel('stdp_dopamine_synapse', 'learning', common)
    nest.Connect(generators, parrots, 'one_to_one')
    synapses = {'synapse_model': 'learning', 'weight': given['weights_pa']}
    nest.Connect(parrots, cells, 'all_to_all', synapses)
    nest.Connect(cells, recorder)

    connections = nest.GetConnections(synapse_model='learning')
    of_neuron = [nest.GetConnections(target=cell, synapse_model='learning') for cell in cells]
    neuron = np.array(connections.target) - cells[0].global_id
    source = np.array(connections.source) - parrots[0].global_id
    simulate_us, set_us = [], []
    for window, dopamine in enumerate(given['dopamine'].tolist()):
        start = time.perf_counter()
        if window % 2:
            for synapses, n in zip(of_neuron, dopamine, strict=True):
                synapses.set({'n': n})
        else:
            connections.set([{'n': dopamine[i]} for i in neuron])
        middle = time.perf_counter()
        nest.Simulate(50.0)
        simulate_us.append((time.perf_counter() - middle) * 1e6)
        set_us.append((middle - start) * 1e6)
    weights_pa = np.empty((neurons, inputs))
    weights_pa[neuron, source] = connections.weight
    times, senders = recorder.events['times'], recorder.events['senders']
    fired = np.column_stack(
        [np.round(times / 0.1).astype(np.int64) - 1, senders - cells[0].global_id]
    )
    return {
        'fired': fired,
        'weights_pa': weights_pa,
        'simulate_us': simulate_us,
        'set_us': set_us,
    }


if __name__ == '__main__':
    np.savez(sys.argv[2], **simulate(dict(np.load(sys.argv[1]))))
