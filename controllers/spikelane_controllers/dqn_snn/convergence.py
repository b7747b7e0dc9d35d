"""How firing rates approach the activations they stand for, as the simulated time grows.

A rectified unit's activation is the share of time steps in which its neuron would fire, if it
were simulated for long and nothing was lost. Some is: what a potential is above the threshold
when it is reset to 0, and what it would be below 0. So errors fall with time down to a floor.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.dqn_snn.feedforward import activate, FeedForward
from spikelane_controllers.dqn_snn.integrate_and_fire import (
    input_spikes,
    IntegrateAndFire,
    IntegrateAndFireParameters,
    resting_potentials,
)


class RateError(NamedTuple):
    """Differences between rates and activations after some time."""

    simulated_ms: float
    hidden: float  # root of the mean square over units and states
    output: float
    agreement: float  # share of states with the most spikes where the activation is largest


def rate_errors(
    network: FeedForward,
    values: NDArray[np.float32],
    durations_ms: Sequence[float],
    parameters: IntegrateAndFireParameters,
    rng: np.random.Generator,
) -> list[RateError]:
    """Simulate constant inputs and compare rates with activations.

    Args:
        network: Normalised weights.
        values: Values of the inputs, from 0 to 1, (n, n_inputs); each row is simulated from rest.
        durations_ms: When to compare, increasing.
        parameters: Parameters of the neurons.
        rng: Where the input spikes come from.

    Returns:
        One for each duration.
    """
    chances = values * np.float32(parameters.probability)
    hidden, output = activate(network, chances)
    spikes = np.array([_spikes(network, each, durations_ms, parameters, rng) for each in values])
    errors = []
    for index, duration_ms in enumerate(durations_ms):
        steps = round(duration_ms / parameters.step_ms)
        rates = spikes[:, index] / steps
        expected = np.hstack([hidden, np.maximum(output, 0)])
        squares = (rates - expected) ** 2
        split = hidden.shape[1]
        agree = rates[:, split:].argmax(axis=1) == output.argmax(axis=1)
        errors.append(
            RateError(
                duration_ms,
                float(np.sqrt(squares[:, :split].mean())),
                float(np.sqrt(squares[:, split:].mean())),
                float(agree.mean()),
            )
        )
    return errors


def _spikes(
    network: FeedForward,
    values: NDArray[np.float32],
    durations_ms: Sequence[float],
    parameters: IntegrateAndFireParameters,
    rng: np.random.Generator,
) -> NDArray[np.int64]:
    """Return the spikes of all neurons up to each duration, (n_durations, n_neurons)."""
    simulated = IntegrateAndFire(network, parameters)
    potentials = resting_potentials(network)
    counts, before_ms, total = [], 0.0, np.zeros(sum(map(len, potentials)), np.int64)
    for duration_ms in durations_ms:
        window = dataclasses.replace(parameters, simulated_ms=duration_ms - before_ms)
        inputs = input_spikes(values, window, rng)
        potentials, fired = simulated.run(potentials, inputs, window.steps)
        total = total + np.hstack([fired.hidden, fired.output.sum(axis=0, dtype=np.int64)])
        counts.append(total)
        before_ms = duration_ms
    return np.array(counts)
