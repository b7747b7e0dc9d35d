"""The R-STDP controller: two neurons whose synapses learn from the lane distance (section 4).

Every input excites both motor neurons. The robot's distance d to the right of its lane's centre is
the reward: at each step dopamine is set to -c_r d in the left neuron's synapses and to +c_r d in
the right one's, so that what made the robot turn back is strengthened.

An episode is no boundary for the network: as in the paper's procedure, where one simulation of
the network goes on while the robot is put back, potentials, traces, weights and spikes on their
way live on. Only the steering restarts.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.operations import Operations
from spikelane_controllers.quantities import Axis, Quantity, Sample
from spikelane_controllers.rstdp.learnt_weights import read_weights
from spikelane_controllers.saved_state import (
    array,
    check_names,
    gather,
    gather_generator,
    number,
    SavedState,
    spread,
    spread_generator,
)
from spikelane_controllers.shown import Shown
from spikelane_controllers.spiking.network import DelayParameters
from spikelane_controllers.spiking.neuron import neuron_constants, NeuronParameters
from spikelane_controllers.spiking.plastic_state_check import check_plastic_state
from spikelane_controllers.spiking.plasticity import (
    PlasticNetwork,
    PlasticState,
    resting_plastic_state,
)
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
from spikelane_controllers.spiking.spikes import GRID_MS, grid_steps, spike_counts, Spikes
from spikelane_controllers.spiking.steering import (
    initial_steering,
    MOTOR_NEURONS,
    steer,
    SteeringParameters,
)
from spikelane_controllers.spiking.synapse import synapse_rule, SynapseParameters
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.encoding import count_events, EncodingParameters
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import nested, NEXT_STEP, parameter, Parameters
from spikelane_sim.period import TimedParameters

_TABLE = 'table "Simulation parameters specification"'


@dataclasses.dataclass(frozen=True, kw_only=True)
class InitialWeights(Parameters):
    """Weights before training: uniform in a range."""

    low_pa: float = parameter(
        200.0, 'Smallest initial weight.', unit='pA', low=-1e6, high=1e6, source='section 4.4'
    )
    high_pa: float = parameter(
        201.0,
        'Largest initial weight.',
        unit='pA',
        low=-1e6,
        high=1e6,
        source="the authors' program",
    )

    def _check_relations(self) -> None:
        if self.high_pa < self.low_pa:
            raise ParameterError(
                f'high_pa: expected at least low_pa = {self.low_pa:g} pA, got {self.high_pa:g}'
            )


@dataclasses.dataclass(frozen=True, kw_only=True)
class RStdpParameters(TimedParameters):
    """The R-STDP controller."""

    learning: bool = parameter(False, 'Change the weights while driving.', changes=NEXT_STEP)
    checkpoint: str = parameter(
        'scenario_1',
        "Initial weights: the name of shipped ones, the path of a training's folder or of a "
        'checkpoint, or empty for untrained ones.',
    )
    c_r: float = parameter(
        0.01,
        'Dopamine for each metre of distance from the lane centre.',
        unit='1/(ms m)',
        low=0.0,
        high=1e6,
        source=_TABLE,
        changes=NEXT_STEP,
    )
    initial_weights: InitialWeights = nested(InitialWeights)
    encoding: EncodingParameters = nested(EncodingParameters)
    poisson: PoissonParameters = nested(PoissonParameters)
    neuron: NeuronParameters = nested(NeuronParameters)
    delays: DelayParameters = nested(DelayParameters)
    synapse: SynapseParameters = nested(SynapseParameters)
    steering: SteeringParameters = nested(SteeringParameters)

    def _check_relations(self) -> None:
        check_spikes(self.poisson, self.encoding, self.period_s)
        synapse_rule(self.synapse, self.delays, self.window)
        self._check_bookkeeping()
        if self.initial_weights.low_pa < self.synapse.w_min_pa:
            raise ParameterError(
                f'initial_weights.low_pa: expected at least synapse.w_min_pa = '
                f'{self.synapse.w_min_pa:g} pA, got {self.initial_weights.low_pa:g}'
            )
        if self.initial_weights.high_pa > self.synapse.w_max_pa:
            raise ParameterError(
                f'initial_weights.high_pa: expected at most synapse.w_max_pa = '
                f'{self.synapse.w_max_pa:g} pA, got {self.initial_weights.high_pa:g}'
            )

    @property
    def window(self) -> int:
        """Length of a step [grid steps]."""
        return grid_steps('period_ms', self.period_ms)

    def _check_bookkeeping(self) -> None:
        """Refuse neurons that can fire twice in an interval: NEST then learns other weights."""
        shortest_ms = self.neuron.t_ref_ms + GRID_MS
        if self.synapse.interval_ms > shortest_ms + 1e-9:
            raise ParameterError(
                f'synapse.interval_ms: expected at most {shortest_ms:g} ms, the shortest time '
                f'between two spikes of a neuron (neuron.t_ref_ms + {GRID_MS:g} ms), '
                f'got {self.synapse.interval_ms:g}'
            )


def offered(parameters: RStdpParameters) -> tuple[Quantity, ...]:
    """Return what the controller can record."""
    neurons, inputs = neuron_axis(MOTOR_NEURONS), input_axis(parameters.encoding)
    end_ns = (parameters.period_ns,)
    synapses: tuple[Axis, ...] = (neurons, inputs)
    return (
        spikes_of(neurons),
        input_spikes_of(inputs),
        potentials_of(neurons, sample_offsets_ns(parameters.period_ns)),
        Quantity('traces', 'eligibility traces c of the synapses', '1', synapses, end_ns),
        Quantity('dopamine', "dopamine n at a neuron's synapses", '1/ms', (neurons,), (0,)),
        Quantity('weights', 'weights of the synapses', 'pA', synapses, end_ns),
    )


class RStdp:
    """Controller of two neurons with synapses that learn; see `contract.Controller`.

    It is made with the weights of its checkpoint; where it has none, they are drawn from seed 0,
    and `initialise` draws others. `restore` continues from a state. It changes its weights while
    `learning` is true, which may be set between steps.

    Attributes:
        neurons: Names of the neurons.
        spikes: How often each of them fired in the last step.
        reward: Reward of the last step, that of the right neuron's synapses; the left one's is its
            negative. NaN where the observation had no lane distance.
        operations: Operations of the last step, learning not counted.
        learning: Whether the weights change.
        network: The network in progress.
        steering: What the steering smooths, after the last step.
        rng: Where the inputs' spikes come from.
    """

    parameters_class: ClassVar[type[RStdpParameters]] = RStdpParameters
    neurons: ClassVar[tuple[str, ...]] = MOTOR_NEURONS

    def __init__(self, parameters: RStdpParameters | None = None) -> None:
        """Make a controller at rest.

        Raises:
            CheckpointError: Its weights cannot be read, or are not of such a network.
        """
        self.parameters = parameters or RStdpParameters()
        self.learning = self.parameters.learning
        self._constants = neuron_constants(self.parameters.neuron)
        self._window = self.parameters.window
        self._rule = synapse_rule(self.parameters.synapse, self.parameters.delays, self._window)
        self._trained_pa = self._trained_weights()
        self._quantities = offered(self.parameters)
        self._recording: frozenset[str] = frozenset()
        self.initialise(np.random.default_rng(0))
        self.reset(np.random.default_rng(0))

    @property
    def weights_pa(self) -> NDArray[np.float64]:
        """Weights now [pA], (2, n_inputs)."""
        return self.network.weights_pa

    def initialise(self, rng: np.random.Generator) -> None:
        """Forget all: neurons at rest, no traces, the checkpoint's weights or drawn from rng."""
        initial = self.parameters.initial_weights
        weights_pa = self._trained_pa
        if weights_pa is None:
            weights_pa = rng.uniform(initial.low_pa, initial.high_pa, self._shape)
        self.network = self._in_progress(resting_plastic_state(weights_pa, self.parameters.delays))

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode: straight on, slowly; the network and its weights live on."""
        self.rng = rng
        self.steering = initial_steering(self.parameters.steering)
        self.spikes: tuple[int, ...] = (0,) * len(self.neurons)
        self.operations = Operations()
        self.reward = math.nan
        self._recorded: dict[str, Sample] = {}

    def change(self, parameters: RStdpParameters) -> None:
        """Go on with other values of the parameters that may be changed."""
        if parameters.learning != self.parameters.learning:  # it may have been set by hand
            self.learning = parameters.learning
        self.parameters = parameters

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
            reward=self.reward,
            operations=self.operations,
            weights_pa=self.weights_pa,
            quantities=self._quantities,
            recorded=self._recorded,
        )

    def step(self, observation: Observation) -> WheelVelocities:
        """Answer one observation: its events drive the network, its distance is the reward."""
        counts = count_events(observation.events, self.parameters.encoding)
        share = self.parameters.share
        rates_hz = firing_rates(counts, self.parameters.poisson, share)
        inputs = poisson_spikes(rates_hz, self.rng, self._window)
        lane = observation.lane
        self.reward = math.nan if lane is None else self.parameters.c_r * lane.distance_m
        dopamine = self.reward if self.learning and lane is not None else 0.0
        self.network.dopamine[:] = -dopamine, dopamine
        fired = self._run_recorded(inputs) if self._recording else self.network.run(inputs)
        self.spikes = spike_counts(fired, len(self.neurons))
        self.operations = self.operations_of(1, len(inputs))
        left, right = self.spikes
        self.steering, wheels = steer(self.steering, left, right, self.parameters.steering, share)
        return wheels  # type: ignore[no-any-return]  # numba carries no types

    def operations_of(self, decisions: int, inputs: int) -> Operations:
        """Return the operations of so many decisions with so many spikes of the inputs."""
        return Operations(decisions=decisions, synaptic=inputs * len(self.neurons))

    def state(self) -> SavedState:
        """Return all that the next steps depend on, as arrays and finite numbers.

        `restore` takes it, also in another controller with the same parameters, and the steps
        that follow are the same, bit for bit.
        """
        return {
            **spread('network', self.network.state),
            **spread('steering', self.steering),
            **spread_generator('rng', self.rng),
            'spikes': np.array(self.spikes, np.int64),
            'learning': self.learning,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state.

        Raises:
            CheckpointError: It is not one of this controller with these parameters; nothing has
                changed then.
        """
        check_names(state, self.state())
        like = self.network.state
        network = gather('network', like, state)
        check_plastic_state(network, like, self._rule)
        steering = gather('steering', self.steering, state)
        rng = gather_generator('rng', state)
        spikes = array(state, 'spikes', np.dtype(np.int64), (len(self.neurons),))
        learning = number(state, 'learning', bool)
        self.network = self._in_progress(network)
        self.steering, self.rng = steering, rng
        self.spikes, self.learning = tuple(spikes.tolist()), learning

    def _run_recorded(self, inputs: Spikes) -> Spikes:
        """Run the network for a step, and keep what is to be recorded."""
        network, e_l_mv = self.network, self.parameters.neuron.e_l_mv
        dopamine = network.dopamine.copy()
        if 'potentials' in self._recording:
            fired, potentials_mv = network.run_watched(inputs)
        else:
            fired, potentials_mv = network.run(inputs), np.empty(0)
        samples: dict[str, Callable[[], Sample]] = {
            'spikes': lambda: spike_times(fired),
            'input_spikes': lambda: spike_times(inputs),
            'potentials': lambda: e_l_mv + potentials_mv,
            'traces': lambda: network.eligibility[None],
            'dopamine': lambda: dopamine[None],
            'weights': lambda: network.weights_pa[None],
        }
        self._recorded = {name: samples[name]() for name in self._recording}
        return fired

    def _in_progress(self, state: PlasticState) -> PlasticNetwork:
        return PlasticNetwork(state, self._constants, self._rule, self._window)

    @property
    def _shape(self) -> tuple[int, int]:
        encoding = self.parameters.encoding
        return len(self.neurons), encoding.rows * encoding.columns

    def _trained_weights(self) -> NDArray[np.float64] | None:
        name, synapse = self.parameters.checkpoint, self.parameters.synapse
        if not name:
            return None
        return read_weights('rstdp', name, self._shape, synapse.w_min_pa, synapse.w_max_pa)
