"""Checks the state of a network whose synapses learn, when it comes from a file."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking.plasticity import PlasticState
from spikelane_controllers.spiking.synapse import SynapseRule
from spikelane_sim.errors import CheckpointError


def check_plastic_state(state: PlasticState, like: PlasticState, rule: SynapseRule) -> None:
    """Check what the kernel relies on, in a state that was stored.

    Args:
        state: The state, its arrays of the same types as like's.
        like: A state of the same network.
        rule: The synapses.

    Raises:
        CheckpointError: It is not a state of such a network.
    """
    n_neurons, n_inputs = like.weights_pa.shape
    scalars = rule.scalars[0]
    earliest = -scalars['to_relay'] - scalars['interval']
    in_flight, history = state.in_flight, state.history
    stamps = [history['stamp'][history['source'] == i] for i in range(n_neurons)]
    _expect(state.neurons.shape == like.neurons.shape, f'{n_neurons} neurons')
    _expect(_is_within(state.weights_pa, scalars['w_min'], scalars['w_max']), 'weights in range')
    _expect(_is_within(in_flight['source'], 0, n_inputs - 1), 'spikes in flight of its inputs')
    _expect(_is_within(in_flight['step'], earliest, -1), 'spikes in flight that are still so')
    _expect(bool((np.diff(in_flight['step']) >= 0).all()), 'spikes in flight in order')
    _expect(_is_within(history['source'], 0, n_neurons - 1), 'spikes of its neurons')
    _expect(all(_is_within(s, -np.inf, 0) and (np.diff(s) > 0).all() for s in stamps), 'a past')


def _is_within(values: NDArray[Any], low: float, high: float) -> bool:
    return bool(((values >= low) & (values <= high)).all())


def _expect(is_met: bool, what: str) -> None:
    if not is_met:
        raise CheckpointError(f'state of the network: expected {what}')
