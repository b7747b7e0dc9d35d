"""The DQN-SNN controller: the policy of a deep Q-network in a spiking network (section 3.5).

The events of each step make the rates of Poisson inputs. The network has one output neuron for
each action; an action's trace counts its spikes and decays, and the robot does the action with
the largest trace, which is chosen at each step.
"""

from __future__ import annotations

from collections.abc import Collection
import dataclasses
import functools
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.dqn_snn.integrate_and_fire import (
    Fired,
    input_spikes,
    IntegrateAndFire,
    IntegrateAndFireParameters,
    resting_potentials,
)
from spikelane_controllers.dqn_snn.transferred import InputScale, read_transferred
from spikelane_controllers.operations import Operations
from spikelane_controllers.quantities import Axis, Quantity, Sample
from spikelane_controllers.shown import Shown
from spikelane_controllers.spiking.recorded import (
    input_axis,
    input_spikes_of,
    neuron_axis,
    potentials_of,
    spike_times,
    spikes_of,
)
from spikelane_controllers.spiking.spikes import Spikes
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.encoding import Counts, StateImage, StateImageParameters
from spikelane_sim.events import no_events
from spikelane_sim.parameters import check_size, nested, parameter, Parameters
from spikelane_sim.period import TimedParameters
from spikelane_sim.task import action_wheels, ActionParameters, ACTIONS


@dataclasses.dataclass(frozen=True, kw_only=True)
class FrameParameters(StateImageParameters):
    """What the inputs see: the cells of the Q-network, over 50 ms rather than 0.5 s."""

    frames: int = parameter(
        1,
        'For how long events are counted, in steps of frame_ms whatever the control period.',
        low=1,
        high=1000,
        source='section 3.5',
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class SpikingParameters(Parameters):
    """How the network spikes, and how actions follow from its spikes."""

    trace_decay: float = parameter(
        0.8,
        'Factor by which an action trace decays in 50 ms (c in the paper).',
        low=0.0,
        high=1.0,
        source="the authors' program",
    )
    neurons: IntegrateAndFireParameters = nested(IntegrateAndFireParameters)


@dataclasses.dataclass(frozen=True, kw_only=True)
class DqnSnnParameters(TimedParameters, SpikingParameters):
    """The DQN-SNN controller."""

    checkpoint: str = parameter(
        'scenario_1',
        "The network: the name of a shipped one, the path of a transfer's folder or of a "
        'checkpoint.',
    )
    event_value: float = parameter(
        0.0,
        'Value that each event adds to the input of its cell, whose value is at most 1; 0: '
        "the scale of the training; 1: the authors' driver, which does not scale.",
        low=0.0,
        high=1.0,
    )
    encoding: FrameParameters = nested(FrameParameters)
    actions: ActionParameters = nested(ActionParameters)

    def _check_relations(self) -> None:
        inputs = self.encoding.rows * self.encoding.columns
        steps = {'time steps (neurons.simulated_ms, neurons.step_ms)': self.step_neurons.steps}
        check_size('numbers drawn in a step', {**steps, 'inputs (encoding)': inputs}, 1e7)

    @functools.cached_property
    def step_neurons(self) -> IntegrateAndFireParameters:
        """The neurons as they are simulated in a step: simulated_ms is for 50 ms.

        Raises:
            ParameterError: That is no whole number of time steps.
        """
        simulated_ms = self.neurons.simulated_ms * self.share
        return dataclasses.replace(self.neurons, simulated_ms=simulated_ms)


def value_per_event(parameters: DqnSnnParameters, scale: InputScale) -> float:
    """Return the value of an input for each event in its cell.

    Unless `event_value` is set, values are on average those of the training.

    Args:
        parameters: Parameters of the controller.
        scale: Scale of the training, in which a count over scale.frames frames is divided by its
            maximum.
    """
    encoding = parameters.encoding
    trained_ms, ms = scale.frames * scale.frame_ms, encoding.frames * encoding.frame_ms
    return parameters.event_value or trained_ms / (ms * scale.maximum)


def input_values(counts: Counts, per_event: float) -> NDArray[np.float32]:
    """Return the inputs' values.

    Args:
        counts: Events in each cell over the last steps, (rows, columns).
        per_event: As `value_per_event` returns it.

    Returns:
        Values from 0 to 1 in the order of rows, then columns, (rows * columns,).
    """
    values: NDArray[np.float32] = np.minimum(counts.ravel() * per_event, 1.0).astype(np.float32)
    return values


def offered(parameters: DqnSnnParameters, n_hidden: int) -> tuple[Quantity, ...]:
    """Return what the controller can record; hidden neurons are 'hidden 0' and so on."""
    hidden = [f'hidden {index}' for index in range(n_hidden)]
    neurons, inputs = neuron_axis((*hidden, *ACTIONS)), input_axis(parameters.encoding)
    steps = range(1, parameters.step_neurons.steps + 1)
    traces = Axis('action', ACTIONS)
    return (
        spikes_of(neurons),
        input_spikes_of(inputs),
        potentials_of(neurons, tuple(step * _grid_ns(parameters) for step in steps)),
        Quantity(
            'action_traces', 'traces of the actions', '1', (traces,), (parameters.period_ns,)
        ),
    )


def _grid_ns(parameters: DqnSnnParameters) -> int:
    """Return the length of a time step of the neurons."""
    return round(parameters.neurons.step_ms * 1e6)


class DqnSnn:
    """Controller of a spiking network that has taken over a policy; see `contract.Controller`.

    Attributes:
        neurons: Names of the output neurons, one for each action.
        spikes: How often each of them fired in the last step.
        operations: Operations of the last step.
        action: The last action, an index of `neurons`; -1 before the first step.
        traces: Traces of the actions, (n_actions,).
    """

    parameters_class: ClassVar[type[DqnSnnParameters]] = DqnSnnParameters
    neurons: ClassVar[tuple[str, ...]] = ACTIONS

    def __init__(self, parameters: DqnSnnParameters | None = None) -> None:
        """Make a controller at rest.

        Raises:
            CheckpointError: Its network cannot be read, or is not one for these inputs.
        """
        self.parameters = parameters or DqnSnnParameters()
        encoding = self.parameters.encoding
        transferred = read_transferred(
            self.parameters.checkpoint, encoding.rows * encoding.columns, len(self.neurons)
        )
        self._per_event = value_per_event(self.parameters, transferred.scale)
        self._network = IntegrateAndFire(transferred.network, self.parameters.step_neurons)
        self._decay = self.parameters.trace_decay**self.parameters.share
        self._image = StateImage(
            encoding, self.parameters.steps_of(encoding.frames, encoding.frame_ms)
        )
        self._quantities = offered(self.parameters, len(transferred.network.hidden_weights))
        self._recording: frozenset[str] = frozenset()
        self.reset(np.random.default_rng(0))
        # So that what is compiled is ready before a simulator waits for the first answer.
        self.step(Observation(0, no_events(), None))
        self.reset(np.random.default_rng(0))

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode: neurons at rest, no traces, nothing seen."""
        self._rng = rng
        self._potentials = resting_potentials(self._network.network)
        self._image.clear()
        self.traces = np.zeros(len(self.neurons))
        self.spikes: tuple[int, ...] = (0,) * len(self.neurons)
        self.operations = Operations()
        self.action = -1
        self._recorded: dict[str, Sample] = {}

    def record(self, names: Collection[str]) -> None:
        """Begin to record quantities, of `shown.quantities`; see `quantities`."""
        self._recording = frozenset(names)

    @property
    def shown(self) -> Shown:
        """What is shown of the last step."""
        return Shown(
            neurons=self.neurons,
            spikes=self.spikes,
            action=self.action,
            operations=self.operations,
            quantities=self._quantities,
            recorded=self._recorded,
        )

    def step(self, observation: Observation) -> WheelVelocities:
        """Answer one observation: its events drive the network for one step."""
        self._image.add(observation.events)
        values = input_values(self._image.counts, self._per_event)
        inputs = input_spikes(values, self.parameters.step_neurons, self._rng)
        fired = self._run(inputs)
        hidden = len(fired.hidden)
        synaptic = len(inputs) * hidden + int(fired.hidden.sum()) * len(self.neurons)
        self.operations = Operations(decisions=1, synaptic=synaptic)
        counts = fired.output.sum(axis=0, dtype=np.int64)
        self.spikes = tuple(counts.tolist())
        self.traces = self._decay * self.traces + counts
        self.action = int(np.argmax(self.traces))
        if 'action_traces' in self._recording:
            self._recorded['action_traces'] = self.traces[None]
        return action_wheels(self.action, self.parameters.actions)

    def _run(self, inputs: Spikes) -> Fired:
        """Run the network for a step, and keep what is to be recorded of its neurons."""
        if not self._recording:
            self._potentials, fired = self._network.run(self._potentials, inputs)
            return fired
        self._potentials, fired, watched = self._network.run_watched(self._potentials, inputs)
        grid_ns = _grid_ns(self.parameters)
        samples: dict[str, Sample] = {
            'spikes': spike_times(watched.spikes, grid_ns),
            'input_spikes': spike_times(inputs, grid_ns),
            'potentials': watched.potentials,
        }
        self._recorded = {name: samples[name] for name in self._recording if name in samples}
        return fired
