"""The recording of what happens inside a controller: spikes, potentials, traces, weights."""
