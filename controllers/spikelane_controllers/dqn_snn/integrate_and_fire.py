"""Integrate-and-fire neurons that do what rectified linear units do (paper section 3.5).

Time goes in steps of 1 ms. In each, a neuron adds the weights of the inputs that fire to its
membrane potential, and its bias as the input of a constant current; where that reaches the
threshold it fires and its potential is reset. Potentials never fall below the reset potential.
The layers follow each other within the step, so that a spike gets through in the step in which
its cause came in. Potentials and weights are in units of the threshold.

The inputs fire at most once in a step, with the probability that their value is.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.dqn_snn.feedforward import FeedForward
from spikelane_controllers.spiking.spikes import SPIKE_DTYPE, Spikes
from spikelane_sim.compiled import inner
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import parameter, Parameters

_TABLE = 'table "DQN-SNN parameters"'

RESETS = ('zero', 'subtract')

#: Time steps in a step of the simulator.
_MOST_STEPS = 1_000_000


@dataclasses.dataclass(frozen=True, kw_only=True)
class IntegrateAndFireParameters(Parameters):
    """Neurons, and how long they are simulated for each step of the simulator."""

    simulated_ms: float = parameter(
        10.0,
        'Time that the neurons are simulated for each 50 ms, in shorter steps their share of it.',
        unit='ms',
        low=1e-3,
        high=1e6,
        source=_TABLE,
    )
    step_ms: float = parameter(
        1.0, 'Time step of the neurons.', unit='ms', low=1e-3, high=1e6, source=_TABLE
    )
    max_rate_hz: float = parameter(
        1000.0, 'Firing rate of an input of value 1.', unit='Hz', low=0.0, high=1e6, source=_TABLE
    )
    threshold_mv: float = parameter(
        1.0,
        'Firing threshold, in the unit of the weights.',
        unit='mV',
        low=1e-3,
        high=1e6,
        source=_TABLE,
    )
    reset: str = parameter(
        'zero',
        'Potential after a spike: 0 (zero), or the potential minus the threshold (subtract).',
        choices=RESETS,
    )
    clamped: bool = parameter(True, 'Potentials never fall below 0.')

    def _check_relations(self) -> None:
        if abs(self.steps * self.step_ms - self.simulated_ms) > 1e-9 or not self.steps:
            raise ParameterError(
                f'simulated_ms: expected a multiple of step_ms = {self.step_ms:g} ms, '
                f'got {self.simulated_ms:g}'
            )
        if self.steps > _MOST_STEPS:
            raise ParameterError(
                f'simulated_ms: expected at most {_MOST_STEPS} steps of step_ms = '
                f'{self.step_ms:g} ms, got {self.simulated_ms:g} ms'
            )
        if self.probability > 1:
            raise ParameterError(
                f'max_rate_hz: expected at most one spike in step_ms = {self.step_ms:g} ms, '
                f'got {self.max_rate_hz:g} Hz'
            )

    @property
    def steps(self) -> int:
        """Time steps in a step of the simulator."""
        return round(self.simulated_ms / self.step_ms)

    @property
    def probability(self) -> float:
        """Probability of a spike of an input of value 1 in a time step."""
        return self.max_rate_hz * self.step_ms / 1000


class Potentials(NamedTuple):
    """Membrane potentials, in units of the weights."""

    hidden: NDArray[np.float64]  # (n_hidden,)
    output: NDArray[np.float64]  # (n_outputs,)


class Fired(NamedTuple):
    """What neurons fired in a window of time."""

    hidden: NDArray[np.int64]  # spikes of each, (n_hidden,)
    output: NDArray[np.uint8]  # 0 or 1 in each time step, (steps, n_outputs)


class Watched(NamedTuple):
    """What all neurons did in a window of time, the hidden ones first."""

    spikes: Spikes
    potentials: NDArray[np.float64]  # after each time step, (steps, n_hidden + n_outputs)


def resting_potentials(network: FeedForward) -> Potentials:
    """Return potentials of 0."""
    hidden, outputs = len(network.hidden_weights), len(network.output_weights)
    return Potentials(np.zeros(hidden), np.zeros(outputs))


def input_spikes(
    values: NDArray[np.float32], parameters: IntegrateAndFireParameters, rng: np.random.Generator
) -> Spikes:
    """Draw the inputs' spikes in one step of the simulator.

    An input that is not 0 takes a uniform number in each time step and fires where that is below
    its probability.

    Args:
        values: Values of the inputs, from 0 to 1, (n_inputs,).
        parameters: Time and rate.
        rng: Where the numbers come from.

    Returns:
        Spikes in the order of time steps, then inputs.
    """
    active = np.flatnonzero(values)
    fires = rng.random((parameters.steps, len(active))) < values[active] * parameters.probability
    steps, columns = np.nonzero(fires)
    spikes = np.empty(len(steps), SPIKE_DTYPE)
    spikes['step'], spikes['source'] = steps, active[columns]
    return spikes


class IntegrateAndFire:
    """A network of such neurons; its state goes in and out of `run`.

    Args:
        network: Weights in units of mV, normalised: no sum of positive ones is above 1.
        parameters: Parameters of the neurons.
    """

    def __init__(
        self, network: FeedForward, parameters: IntegrateAndFireParameters | None = None
    ) -> None:
        self.network = network
        self.parameters = parameters or IntegrateAndFireParameters()
        # By input, since only those that fire are looked at.
        self._from_inputs = np.ascontiguousarray(network.hidden_weights.T)
        self._from_hidden = np.ascontiguousarray(network.output_weights.T)

    def run(
        self, potentials: Potentials, spikes: Spikes, steps: int | None = None
    ) -> tuple[Potentials, Fired]:
        """Run the network for a window of time.

        Args:
            potentials: At the window's start.
            spikes: Spikes of the inputs in it, in the order of time steps; sources are below
                n_inputs, which is not checked.
            steps: Length of the window [time steps], None for that of a step of the simulator.

        Returns:
            Potentials at the window's end, and what fired in it.
        """
        parameters = self.parameters
        *potentials_after, hidden, output = _run(
            *potentials,
            spikes,
            self._from_inputs,
            self.network.hidden_bias,
            self._from_hidden,
            parameters.steps if steps is None else steps,
            parameters.threshold_mv,
            parameters.reset == 'subtract',
            parameters.clamped,
        )
        return Potentials(*potentials_after), Fired(hidden, output)

    def run_watched(
        self, potentials: Potentials, spikes: Spikes
    ) -> tuple[Potentials, Fired, Watched]:
        """Run the network for a step of the simulator as `run` does, and watch every neuron.

        It runs the time steps one by one, which makes no difference to what happens in them.
        """
        fired: list[Fired] = []
        passed: list[Potentials] = []
        for step in range(self.parameters.steps):
            arriving = spikes[spikes['step'] == step].copy()
            arriving['step'] = 0
            potentials, each = self.run(potentials, arriving, 1)
            fired.append(each)
            passed.append(potentials)
        hidden = np.stack([each.hidden for each in fired])
        output = np.concatenate([each.output for each in fired])
        steps, sources = np.nonzero(np.concatenate([hidden, output], axis=1))
        found = np.empty(len(steps), SPIKE_DTYPE)
        found['step'], found['source'] = steps, sources
        watched = Watched(found, np.stack([np.concatenate(each) for each in passed]))
        return potentials, Fired(hidden.sum(axis=0), output), watched


@inner
def _integrate(
    potential: float, arriving: float, threshold: float, subtracts: bool, is_clamped: bool
) -> tuple[float, bool]:
    """Return a neuron's potential after a time step, and whether it fires."""
    potential += arriving
    fires = potential >= threshold
    if fires:
        potential = potential - threshold if subtracts else 0.0
    elif is_clamped and potential < 0.0:
        potential = 0.0
    return potential, fires


@numba.njit(cache=True)
def _run(
    hidden: NDArray[np.float64],
    output: NDArray[np.float64],
    spikes: Spikes,
    from_inputs: NDArray[np.float32],
    bias: NDArray[np.float32],
    from_hidden: NDArray[np.float32],
    steps: int,
    threshold: float,
    subtracts: bool,
    is_clamped: bool,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]:
    hidden, output = hidden.copy(), output.copy()
    fired_hidden = np.zeros(len(hidden), np.int64)
    fired_output = np.zeros((steps, len(output)), np.uint8)
    to_hidden, to_output = np.empty(len(hidden)), np.empty(len(output))
    taken = 0
    for step in range(steps):
        to_hidden[:] = bias
        while taken < len(spikes) and spikes[taken].step == step:
            weights = from_inputs[spikes[taken].source]
            for index in range(len(hidden)):
                to_hidden[index] += weights[index]
            taken += 1
        to_output[:] = 0.0
        for index in range(len(hidden)):
            hidden[index], fires = _integrate(
                hidden[index], to_hidden[index], threshold, subtracts, is_clamped
            )
            if fires:
                fired_hidden[index] += 1
                for out in range(len(output)):
                    to_output[out] += from_hidden[index, out]
        for out in range(len(output)):
            output[out], fires = _integrate(
                output[out], to_output[out], threshold, subtracts, is_clamped
            )
            fired_output[step, out] = fires
    return hidden, output, fired_hidden, fired_output
