"""NEST is the oracle of the synapses."""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
import pytest

from spikelane_controllers.spiking.network import DelayParameters
from spikelane_controllers.spiking.neuron import neuron_constants, NeuronParameters
from spikelane_controllers.spiking.plasticity import resting_plastic_state, run_plastic_network
from spikelane_controllers.spiking.spikes import SPIKE_DTYPE
from spikelane_controllers.spiking.synapse import synapse_rule, SynapseParameters

NETWORKS = 24
NEURONS = 2
INPUTS = 32
WINDOWS = 200
WINDOW = 500
ORACLE = Path(__file__).with_name('nest_dopamine_oracle.py')


class Given(NamedTuple):
    """What both sides simulate."""

    weights_pa: NDArray[np.float64]
    spikes: NDArray[np.int64]  # network, input, grid step
    dopamine: NDArray[np.float64]  # (windows, networks, neurons)


class Result(NamedTuple):
    """What came of it."""

    fired: list[list[tuple[int, int]]]  # of each network: grid step, neuron
    weights_pa: NDArray[np.float64]  # (windows, networks, neurons, inputs)
    eligibility: NDArray[np.float64]


def random_task(seed: int, heaviest_pa: float = 1500.0, reward: float = 0.002) -> Given:
    """Inputs that come and go like markings, rewards that swing like a robot about its lane."""
    rng = np.random.default_rng(seed)
    shape = (NETWORKS, INPUTS, WINDOWS // 5)
    rate = rng.integers(0, 360, shape) * (rng.random(shape) < 0.3) * rng.random((NETWORKS, 1, 1))
    numbers = rng.poisson(np.repeat(rate, 5, axis=2) * WINDOW / 10_000)
    indices = np.indices(numbers.shape).reshape(3, -1)
    network, source, window = np.repeat(indices, numbers.ravel(), axis=1)
    steps = window * WINDOW + rng.integers(0, WINDOW, len(window))
    order = np.argsort(steps, kind='stable')
    time_s = np.arange(WINDOWS)[:, None] * 0.05
    swing = np.sin(2 * np.pi * (time_s * rng.uniform(0.1, 1, NETWORKS) + rng.random(NETWORKS)))
    distance = reward * swing + rng.normal(0, reward / 4, swing.shape)
    return Given(
        weights_pa=rng.uniform(200, heaviest_pa, (NETWORKS, NEURONS, INPUTS)),
        spikes=np.column_stack([network, source, steps])[order],
        dopamine=np.stack([-distance, distance], axis=-1),
    )


def run_ours(
    given: Given,
    synapse: SynapseParameters,
    delays: DelayParameters,
    neuron: NeuronParameters | None = None,
) -> Result:
    """Run every network, window by window."""
    constants = neuron_constants(neuron or NeuronParameters())
    rule = synapse_rule(synapse, delays)
    shape = (WINDOWS, NETWORKS, NEURONS, INPUTS)
    result = Result([[] for _ in range(NETWORKS)], np.empty(shape), np.empty(shape))
    for network in range(NETWORKS):
        state = resting_plastic_state(given.weights_pa[network], delays)
        mine = given.spikes[given.spikes[:, 0] == network]
        for window in range(WINDOWS):
            inside = mine[mine[:, 2] // WINDOW == window]
            inputs = np.empty(len(inside), SPIKE_DTYPE)
            inputs['source'], inputs['step'] = inside[:, 1], inside[:, 2] % WINDOW
            state = state._replace(dopamine=given.dopamine[window, network])
            state, fired = run_plastic_network(state, inputs, constants, rule)
            result.weights_pa[window, network] = state.weights_pa
            result.eligibility[window, network] = state.eligibility
            result.fired[network] += [(k + window * WINDOW, i) for k, i in fired.tolist()]
    return result


def run_nest(
    folder: Path,
    given: Given,
    synapse: SynapseParameters,
    delays: DelayParameters,
    neuron: NeuronParameters | None = None,
) -> Result:
    """Run the same in NEST."""
    neuron = neuron or NeuronParameters()
    np.savez(
        folder / 'given.npz',
        **given._asdict(),
        window=WINDOW,
        delay_to_relay=delays.to_relay_ms,
        delay_to_neuron=delays.to_neuron_ms,
        neuron_tau_minus=synapse.tau_minus_ms,
        neuron_t_ref=neuron.t_ref_ms,
        neuron_C_m=neuron.c_m_pf,
        synapse_A_plus=synapse.a_plus,
        synapse_A_minus=synapse.a_minus,
        synapse_tau_plus=synapse.tau_plus_ms,
        synapse_tau_c=synapse.tau_c_ms,
        synapse_tau_n=synapse.tau_n_ms,
        synapse_Wmin=synapse.w_min_pa,
        synapse_Wmax=synapse.w_max_pa,
    )
    command = [sys.executable, str(ORACLE), str(folder / 'given.npz'), str(folder / 'nest.npz')]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    with np.load(folder / 'nest.npz') as read:
        fired: list[list[tuple[int, int]]] = [[] for _ in range(NETWORKS)]
        for network, neuron, step in read['fired'].tolist():
            fired[network].append((step, neuron))
        return Result(fired, read['weights_pa'], read['eligibility'])


OTHER_SYNAPSE = SynapseParameters(
    a_plus=1.3,
    a_minus=0.7,
    tau_plus_ms=12.0,
    tau_minus_ms=33.0,
    tau_c_ms=400.0,
    tau_n_ms=90.0,
    w_min_pa=150.0,
    w_max_pa=1000.0,
    interval_ms=0.5,
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('synapse', 'delays', 'heaviest_pa'),
    [
        pytest.param(SynapseParameters(), DelayParameters(), 1500.0, id='the paper'),
        pytest.param(
            OTHER_SYNAPSE,
            DelayParameters(to_relay_ms=0.5, to_neuron_ms=2.3),
            1000.0,
            id='everything else',
        ),
    ],
)
def test_spikes_and_weights_are_those_of_nest(
    tmp_path: Path, synapse: SynapseParameters, delays: DelayParameters, heaviest_pa: float
) -> None:
    """24 runs of 10 s, reward changing sign: all spikes the same, weights but for rounding."""
    given = random_task(1, heaviest_pa)
    ours = run_ours(given, synapse, delays)
    nest = run_nest(tmp_path, given, synapse, delays)
    assert [sorted(fired) for fired in ours.fired] == [sorted(fired) for fired in nest.fired]
    np.testing.assert_allclose(ours.weights_pa, nest.weights_pa, rtol=0, atol=1e-8)
    np.testing.assert_allclose(ours.eligibility, nest.eligibility, rtol=0, atol=1e-8)
    # It was not for lack of activity.
    assert sum(map(len, ours.fired)) > 50_000
    moved = np.abs(ours.weights_pa[-1] - given.weights_pa).max(axis=(1, 2))
    assert np.median(moved) > 30.0


@pytest.mark.slow
def test_neurons_may_fire_once_in_an_interval(tmp_path: Path) -> None:
    """Every 1.0 ms, which is the interval: still NEST's weights; oftener is refused by R-STDP."""
    given, synapse, delays = random_task(4, 3000.0), SynapseParameters(), DelayParameters()
    neuron = NeuronParameters(t_ref_ms=0.9, c_m_pf=25.0)
    ours = run_ours(given, synapse, delays, neuron)
    nest = run_nest(tmp_path, given, synapse, delays, neuron)
    trains = [
        np.sort([step for step, index in fired if index == neuron_index])
        for fired in ours.fired
        for neuron_index in range(NEURONS)
    ]
    assert min(np.diff(train).min() for train in trains) == 10  # grid steps
    assert [sorted(fired) for fired in ours.fired] == [sorted(fired) for fired in nest.fired]
    np.testing.assert_allclose(ours.weights_pa, nest.weights_pa, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_without_dopamine_it_is_a_static_network_in_nest_too(tmp_path: Path) -> None:
    """Learning off: the same spikes, and weights that do not change by a bit."""
    given = random_task(2)
    given = given._replace(dopamine=np.zeros_like(given.dopamine))
    ours = run_ours(given, SynapseParameters(), DelayParameters())
    nest = run_nest(tmp_path, given, SynapseParameters(), DelayParameters())
    assert [sorted(fired) for fired in ours.fired] == [sorted(fired) for fired in nest.fired]
    assert (ours.weights_pa == given.weights_pa).all()
    assert (nest.weights_pa == given.weights_pa).all()


def test_the_bookkeeping_makes_a_difference_that_matters() -> None:
    """Why NEST's is followed: without it, weights change otherwise by 70 % of what they change."""
    given = random_task(1)
    nest = run_ours(given, SynapseParameters(), DelayParameters())
    exact = run_ours(given, SynapseParameters(interval_ms=0.1), DelayParameters())
    changes = nest.weights_pa[-1] - given.weights_pa
    difference = np.abs(nest.weights_pa[-1] - exact.weights_pa[-1])
    share = np.median(difference.mean(axis=(1, 2)) / np.abs(changes).mean(axis=(1, 2)))
    assert share == pytest.approx(0.70, abs=0.05)
