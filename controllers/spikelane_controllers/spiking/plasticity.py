"""Networks whose synapses learn by reward; `synapse` has the model of one synapse."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.spiking.network import DelayParameters
from spikelane_controllers.spiking.neuron import (
    Constants,
    membrane_potentials,
    NEURON_DTYPE,
    Neurons,
)
from spikelane_controllers.spiking.plasticity_kernel import run_two
from spikelane_controllers.spiking.plasticity_lanes import run_many
from spikelane_controllers.spiking.plasticity_window import NETWORK_DTYPE, Workspace
from spikelane_controllers.spiking.spikes import (
    GRID_STEPS,
    grid_steps,
    no_spikes,
    SPIKE_DTYPE,
    Spikes,
)
from spikelane_controllers.spiking.synapse import SynapseRule
from spikelane_controllers.spiking.synapse_kernel import POST_DTYPE, Posts, SYNAPSE_DTYPE
from spikelane_sim.errors import ParameterError

Weights = NDArray[np.float64]


class PlasticState(NamedTuple):
    """State of the neurons and of their synapses, all brought up to date at a window's end."""

    neurons: Neurons
    weights_pa: Weights  # w, (n_neurons, n_inputs)
    eligibility: NDArray[np.float64]  # c, (n_neurons, n_inputs)
    k_plus: NDArray[np.float64]  # (n_neurons, n_inputs)
    dopamine: NDArray[np.float64]  # n [1/ms], (n_neurons,); set it with _replace
    in_flight: Spikes  # of inputs, not yet handed to the synapses: steps may be negative
    arriving_pa: NDArray[np.float64]  # on its way to the neurons, (delay, n_neurons)
    history: Posts  # the neurons' spikes that may still pair, by neuron and stamp, which is <= 0


def resting_plastic_state(weights_pa: Weights, delays: DelayParameters) -> PlasticState:
    """Return neurons at rest and synapses that know of no spikes and no dopamine.

    Args:
        weights_pa: Initial weights [pA], (n_neurons, n_inputs).
        delays: As in `synapse_rule`.
    """
    neurons = len(weights_pa)
    return PlasticState(
        neurons=np.zeros(neurons, NEURON_DTYPE),
        weights_pa=np.array(weights_pa, np.float64),
        eligibility=np.zeros(weights_pa.shape),
        k_plus=np.zeros(weights_pa.shape),
        dopamine=np.zeros(neurons),
        in_flight=no_spikes(),
        arriving_pa=np.zeros((grid_steps('to_neuron_ms', delays.to_neuron_ms), neurons)),
        history=np.empty(0, POST_DTYPE),
    )


def run_plastic_network(
    state: PlasticState,
    inputs: Spikes,
    constants: Constants,
    rule: SynapseRule,
    window: int = GRID_STEPS,
) -> tuple[PlasticState, Spikes]:
    """Run a network whose synapses learn for a window of time.

    Without dopamine the weights stay as they are, and only the traces go on.

    Args:
        state: State at the window's start.
        inputs: What the inputs fire in this window, in the order of grid steps; an input may do
            so several times in one. Sources are below n_inputs, which is not checked.
        constants: The neurons.
        rule: The synapses.
        window: Length of the window [grid steps], a multiple of the rule's interval and not
            longer than the rule was made for.

    Returns:
        State at the window's end, and the spikes of the neurons in the window.
    """
    network = PlasticNetwork(state, constants, rule, window)
    fired = network.run(inputs)
    return network.state, fired


class PlasticNetwork:
    """A network whose synapses learn, in progress: `run_plastic_network` without new arrays.

    Attributes:
        workspace: Its arrays.
        network: What it is made of, of NETWORK_DTYPE, (1,).
        tables: Those of its synapses' rule.
    """

    def __init__(
        self,
        state: PlasticState,
        constants: Constants,
        rule: SynapseRule,
        window: int = GRID_STEPS,
    ) -> None:
        """Begin with a copy of a state.

        Args:
            state: State at the first window's start.
            constants: The neurons.
            rule: The synapses.
            window: Length of the windows, as in `run_plastic_network`.

        Raises:
            ParameterError: It is no multiple of the rule's interval.
        """
        scalars = rule.scalars[0]
        if window % int(scalars['interval']):
            raise ParameterError(
                f"window: expected a multiple of the rule's interval of {scalars['interval']} "
                f'grid steps, got {window}'
            )
        neurons = len(state.neurons)
        per_neuron = 1 + (window - 1) // (1 + int(constants[0]['refractory']))
        remembered = max(len(state.history), int(scalars['delay'] + scalars['interval'])) + 1
        work = self.workspace = Workspace(
            neurons=state.neurons.copy(),
            synapses=np.zeros(state.weights_pa.shape, SYNAPSE_DTYPE),
            dopamine=state.dopamine.copy(),
            arriving_pa=np.zeros((window + scalars['delay'], neurons)),
            arrived_pa=np.zeros((0, neurons)),
            posts=np.zeros((neurons, remembered + per_neuron), POST_DTYPE),
            flying=state.in_flight.copy(),
            fired=np.empty(neurons * per_neuron, SPIKE_DTYPE),
            counts=np.zeros(neurons, np.int64),
        )
        work.synapses['weight_pa'] = state.weights_pa
        work.synapses['eligibility'], work.synapses['k_plus'] = state.eligibility, state.k_plus
        work.arriving_pa[: scalars['delay']] = state.arriving_pa
        for post in state.history:
            i = post['source']
            work.posts[i, work.counts[i]] = post
            work.counts[i] += 1
        self._n_flying = len(state.in_flight)
        self.network = np.zeros(1, NETWORK_DTYPE)
        self.network[0] = constants[0], scalars, window
        self.tables = rule.tables
        self._arguments = (*work, self.network, self.tables)

    @property
    def weights_pa(self) -> Weights:
        """Weights now [pA], (n_neurons, n_inputs)."""
        return self.workspace.synapses['weight_pa'].copy()

    @property
    def eligibility(self) -> NDArray[np.float64]:
        """Eligibility traces now, (n_neurons, n_inputs)."""
        return self.workspace.synapses['eligibility'].copy()

    @property
    def dopamine(self) -> NDArray[np.float64]:
        """Dopamine at each neuron's synapses now [1/ms], (n_neurons,); may be written to."""
        return self.workspace.dopamine

    @property
    def state(self) -> PlasticState:
        """A copy of the state now."""
        work, rule = self.workspace, self.network[0]['synapse']
        history = [posts[:n] for posts, n in zip(work.posts, work.counts, strict=True)]
        for i, posts in enumerate(history):
            posts['source'] = i
        return PlasticState(
            neurons=work.neurons.copy(),
            weights_pa=work.synapses['weight_pa'].copy(),
            eligibility=work.synapses['eligibility'].copy(),
            k_plus=work.synapses['k_plus'].copy(),
            dopamine=work.dopamine.copy(),
            in_flight=work.flying[: self._n_flying].copy(),
            arriving_pa=work.arriving_pa[: rule['delay']].copy(),
            history=np.concatenate(history),
        )

    def run_watched(self, inputs: Spikes) -> tuple[Spikes, NDArray[np.float64]]:
        """Run a window as `run` does, and return the membrane potentials in it as well.

        Returns:
            The neurons' spikes, and their potentials as `membrane_potentials` returns them.
        """
        window = int(self.network[0]['window'])
        if len(self.workspace.arrived_pa) != window:
            arrived_pa = np.zeros((window, len(self.workspace.neurons)))
            self.workspace = self.workspace._replace(arrived_pa=arrived_pa)
            self._arguments = (*self.workspace, self.network, self.tables)
        before = self.workspace.neurons.copy()
        fired = self.run(inputs)
        constants = self.network['neuron']
        return fired, membrane_potentials(before, self.workspace.arrived_pa, constants)

    def copy_to(self, workspace: Workspace) -> int:
        """Copy the arrays into those of another workspace; return how many spikes are flying."""
        _copy_workspace(self.workspace, workspace, self._n_flying)
        return self._n_flying

    def copy_from(self, workspace: Workspace, n_flying: int) -> None:
        """Copy another workspace's arrays, with so many spikes flying, into these."""
        self._make_room(n_flying)
        _copy_workspace(workspace, self.workspace, n_flying)
        self._n_flying = n_flying

    def run(self, inputs: Spikes) -> Spikes:
        """Run a window; inputs and what is returned are those of `run_plastic_network`."""
        self._make_room(self._n_flying + len(inputs))
        kernel = run_two if len(self.workspace.neurons) == 2 else run_many
        self._n_flying, n_fired = kernel(*self._arguments, self._n_flying, inputs)
        fired: Spikes = self.workspace.fired[:n_fired].copy()
        return fired

    def _make_room(self, n_spikes: int) -> None:
        """Make sure that so many spikes can fly."""
        if n_spikes > len(self.workspace.flying):
            flying = np.resize(self.workspace.flying, 2 * n_spikes)
            self.workspace = self.workspace._replace(flying=flying)
            self._arguments = (*self.workspace, self.network, self.tables)


def _copy_workspace(source: Workspace, target: Workspace, n_flying: int) -> None:
    """Copy arrays; there may be more room for spikes in one than in the other."""
    for name, values in source._asdict().items():
        if name not in ('flying', 'posts', 'arrived_pa'):
            getattr(target, name)[...] = values
    target.flying[:n_flying] = source.flying[:n_flying]
    remembered = int(source.counts.max())
    target.posts[:, :remembered] = source.posts[:, :remembered]
