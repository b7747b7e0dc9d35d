"""Spiking building blocks: neurons and network, synapses that learn, Poisson inputs, steering."""
