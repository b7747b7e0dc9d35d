"""The Braitenberg controller: two neurons whose weights are set by hand (paper section 5.3).

The left half of the image excites the left motor neuron, the right half the right one, the more
the closer a marking is to the bottom's centre, so the robot turns away from markings.

By default only the lowest row of cells excites the neurons, as in the authors' program: with it
the laps are like the paper's (see the deviations in the docs).
"""

from __future__ import annotations

from collections.abc import Collection
import dataclasses
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.operations import Operations
from spikelane_controllers.quantities import Quantity, Sample
from spikelane_controllers.shown import Shown
from spikelane_controllers.spiking.network import (
    DelayParameters,
    network_potentials,
    NetworkState,
    resting_state,
    run_network,
)
from spikelane_controllers.spiking.neuron import neuron_constants, NeuronParameters
from spikelane_controllers.spiking.poisson import (
    check_spikes,
    firing_rates,
    poisson_spikes,
    PoissonParameters,
)
from spikelane_controllers.spiking.recorded import (
    input_axis,
    input_spikes_of,
    neuron_axis,
    potentials_of,
    sample_offsets_ns,
    spike_times,
    spikes_of,
)
from spikelane_controllers.spiking.spikes import grid_steps, spike_counts, Spikes
from spikelane_controllers.spiking.steering import (
    initial_steering,
    MOTOR_NEURONS,
    steer,
    SteeringParameters,
)
from spikelane_controllers.spiking.weights_by_hand import (
    LEFT_WEIGHTS_PA,
    mirrored,
)
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.encoding import count_events, EncodingParameters
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import nested, parameter
from spikelane_sim.period import TimedParameters


@dataclasses.dataclass(frozen=True, kw_only=True)
class BraitenbergPoisson(PoissonParameters):
    """Rates of the Braitenberg network's inputs, higher than in the paper's R-STDP table."""

    max_rate_hz: float = parameter(
        500.0, 'Largest firing rate of an input.', unit='Hz', low=0.0, high=1e4
    )
    max_events: int = parameter(
        10,
        'Events in one cell and 50 ms at which an input reaches its largest rate.',
        low=1,
        high=1_000_000,
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class BraitenbergDelays(DelayParameters):
    """Delays of the Braitenberg network, whose inputs reach the neurons without a relay."""

    to_relay_ms: float = parameter(
        0.0,
        'Delay from an input to its relay neuron; 0: there is no relay.',
        unit='ms',
        low=0.0,
        high=1000.0,
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class BraitenbergSteering(SteeringParameters):
    """Steering of the Braitenberg controller: full activity is what the neurons can do."""

    n_max: int = parameter(
        25,
        'Spikes of a neuron in 50 ms that count as full activity.',
        low=1,
        high=10_000,
        source='equation of n_max',
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class BraitenbergParameters(TimedParameters):
    """The Braitenberg controller."""

    weights_pa: tuple[float, ...] = parameter(
        LEFT_WEIGHTS_PA,
        'Weights from the left half of the image to the left neuron, row by row; the right '
        'half mirrors them.',
        unit='pA',
        low=-1e6,
        high=1e6,
        source='figure "Scenario 1: Braitenberg network weights"',
    )
    lowest_rows: int = parameter(
        1,
        'Number of rows of cells that excite the neurons, counted from the lowest row up.',
        low=1,
        high=2048,
    )
    encoding: EncodingParameters = nested(EncodingParameters)
    poisson: BraitenbergPoisson = nested(BraitenbergPoisson)
    neuron: NeuronParameters = nested(NeuronParameters)
    delays: BraitenbergDelays = nested(BraitenbergDelays)
    steering: BraitenbergSteering = nested(BraitenbergSteering)

    def _check_relations(self) -> None:
        check_spikes(self.poisson, self.encoding, self.period_s)
        rows, columns = self.encoding.rows, self.encoding.columns
        if columns % 2:
            raise ParameterError(
                f'encoding.cell: expected an even number of columns, got {columns}'
            )
        if len(self.weights_pa) != rows * columns // 2:
            raise ParameterError(
                f'weights_pa: expected {rows} x {columns // 2} weights, got {len(self.weights_pa)}'
            )
        if self.lowest_rows > rows:
            raise ParameterError(
                f'lowest_rows: expected at most the {rows} rows of cells, got {self.lowest_rows}'
            )


def braitenberg_weights(parameters: BraitenbergParameters) -> NDArray[np.float64]:
    """Return the weights [pA] to the left and the right neuron, (2, rows * columns).

    They include those of rows above the lowest ones, which have no effect.
    """
    return mirrored(parameters.weights_pa, parameters.encoding.rows)


def offered(parameters: BraitenbergParameters) -> tuple[Quantity, ...]:
    """Return what the controller can record."""
    neurons, inputs = neuron_axis(MOTOR_NEURONS), input_axis(parameters.encoding)
    potentials = potentials_of(neurons, sample_offsets_ns(parameters.period_ns))
    return spikes_of(neurons), input_spikes_of(inputs), potentials


class Braitenberg:
    """Controller of two neurons with static weights; see `contract.Controller`.

    Attributes:
        neurons: Names of the neurons.
        spikes: How often each of them fired in the last step.
        operations: Operations of the last step.
        weights_pa: Weights [pA], (2, n_inputs).
        constants: The neurons'.
        network: The network after the last step.
        steering: What the steering smooths, after the last step.
        rng: Where the inputs' spikes come from.
    """

    parameters_class: ClassVar[type[BraitenbergParameters]] = BraitenbergParameters
    neurons: ClassVar[tuple[str, ...]] = MOTOR_NEURONS

    def __init__(self, parameters: BraitenbergParameters | None = None) -> None:
        self.parameters = parameters or BraitenbergParameters()
        self.weights_pa = braitenberg_weights(self.parameters)
        self.constants = neuron_constants(self.parameters.neuron)
        self._delay = self.parameters.delays.steps
        self._window = grid_steps('period_ms', self.parameters.period_ms)
        self._quantities = offered(self.parameters)
        self._recording: frozenset[str] = frozenset()
        self.reset(np.random.default_rng(0))

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode: neurons at rest, no spikes on their way, straight on, slowly."""
        self.rng = rng
        self.network = resting_state(len(self.neurons))
        self.steering = initial_steering(self.parameters.steering)
        self.spikes: tuple[int, ...] = (0,) * len(self.neurons)
        self.operations = Operations()
        self._recorded: dict[str, Sample] = {}

    def record(self, names: Collection[str]) -> None:
        """Begin to record quantities, of `shown.quantities`; see `quantities`."""
        self._recording = frozenset(names)

    @property
    def is_recording(self) -> bool:
        """Whether anything is recorded."""
        return bool(self._recording)

    @property
    def shown(self) -> Shown:
        """What is shown of the last step."""
        return Shown(
            neurons=self.neurons,
            spikes=self.spikes,
            operations=self.operations,
            weights_pa=self.weights_pa,
            quantities=self._quantities,
            recorded=self._recorded,
        )

    def step(self, observation: Observation) -> WheelVelocities:
        """Answer one observation: its events drive the network for one step."""
        counts = count_events(observation.events, self.parameters.encoding)
        counts[: -self.parameters.lowest_rows] = 0
        share = self.parameters.share
        rates_hz = firing_rates(counts, self.parameters.poisson, share)
        inputs = poisson_spikes(rates_hz, self.rng, self._window)
        before = self.network
        self.network, fired = run_network(
            before, inputs, self.weights_pa, self.constants, self._delay, self._window
        )
        if self._recording:
            self._keep(before, inputs, fired)
        self.spikes = spike_counts(fired, len(self.neurons))
        self.operations = self.operations_of(1, len(inputs))
        left, right = self.spikes
        self.steering, wheels = steer(self.steering, left, right, self.parameters.steering, share)
        return wheels  # type: ignore[no-any-return]  # numba carries no types

    def operations_of(self, decisions: int, inputs: int) -> Operations:
        """Return the operations of so many decisions with so many spikes of the inputs."""
        # An input excites the neuron of its side alone.
        return Operations(decisions=decisions, synaptic=inputs)

    def _keep(self, before: NetworkState, inputs: Spikes, fired: Spikes) -> None:
        """Keep what is to be recorded of a step that began with a state of the network."""
        potentials = network_potentials(
            before, inputs, self.weights_pa, self.constants, self._delay, self._window
        )
        samples: dict[str, Sample] = {
            'spikes': spike_times(fired),
            'input_spikes': spike_times(inputs),
            'potentials': self.parameters.neuron.e_l_mv + potentials,
        }
        self._recorded = {name: samples[name] for name in self._recording}
