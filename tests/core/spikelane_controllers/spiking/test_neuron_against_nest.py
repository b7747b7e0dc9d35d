"""NEST is the oracle of the neuron model."""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
import pytest

from spikelane_controllers.spiking.network import DelayParameters, resting_state, run_network
from spikelane_controllers.spiking.neuron import neuron_constants, NeuronParameters
from spikelane_controllers.spiking.spikes import SPIKE_DTYPE

NETWORKS = 120
NEURONS = 2
INPUTS = 32
WINDOWS = 5
WINDOW = 500
ORACLE = Path(__file__).with_name('nest_oracle.py')


def random_spikes(rng: np.random.Generator) -> NDArray[np.int64]:
    """Network, input and grid step of spikes whose rates differ by network, input and window.

    They range from silence to 1,500 Hz, where inputs fire several times in a grid step.
    """
    scale = np.geomspace(3.0, 300.0, NETWORKS)[:, None, None]
    rate = scale * rng.integers(0, 6, (NETWORKS, INPUTS, WINDOWS))
    numbers = rng.poisson(rate * WINDOW / 10_000)
    indices = np.indices(numbers.shape).reshape(3, -1)
    network, source, window = np.repeat(indices, numbers.ravel(), axis=1)
    steps = window * WINDOW + rng.integers(0, WINDOW, len(window))
    return np.column_stack([network, source, steps])[np.argsort(steps, kind='stable')]


def run_ours(
    weights_pa: NDArray[np.float64],
    spikes: NDArray[np.int64],
    neuron: NeuronParameters,
    delays: DelayParameters,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Run every network, window by window; return what `nest_oracle` does."""
    fired = []
    potential = np.empty((NETWORKS, NEURONS, WINDOWS))
    constants = neuron_constants(neuron)
    for network in range(NETWORKS):
        state = resting_state(NEURONS)
        mine = spikes[spikes[:, 0] == network]
        for window in range(WINDOWS):
            inside = mine[mine[:, 2] // WINDOW == window]
            inputs = np.empty(len(inside), SPIKE_DTYPE)
            inputs['source'], inputs['step'] = inside[:, 1], inside[:, 2] % WINDOW
            state, out = run_network(state, inputs, weights_pa[network], constants, delays.steps)
            potential[network, :, window] = state.neurons['potential_mv'] + neuron.e_l_mv
            fired += [(network, source, window * WINDOW + step) for step, source in out.tolist()]
    return np.array(fired), potential


def run_nest(folder: Path, **given: Any) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Run the same in NEST."""
    np.savez(folder / 'given.npz', windows=WINDOWS, window=WINDOW, **given)
    command = [sys.executable, str(ORACLE), str(folder / 'given.npz'), str(folder / 'nest.npz')]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    with np.load(folder / 'nest.npz') as result:
        return result['fired'], result['potential_mv']


OTHER_NEURON = NeuronParameters(
    e_l_mv=-65.0,
    v_th_mv=-50.0,
    v_reset_mv=-62.0,
    c_m_pf=200.0,
    tau_m_ms=15.0,
    tau_syn_ms=1.5,
    t_ref_ms=0.7,
    i_e_pa=120.0,
)


@pytest.mark.parametrize(
    ('neuron', 'delays', 'lightest_pa'),
    [
        pytest.param(NeuronParameters(), DelayParameters(), 200.0, id='the paper'),
        pytest.param(
            OTHER_NEURON,
            DelayParameters(to_relay_ms=0.1, to_neuron_ms=3.4),
            -1500.0,
            id='everything else',
        ),
    ],
)
def test_every_spike_falls_in_the_grid_step_of_nest(
    tmp_path: Path, neuron: NeuronParameters, delays: DelayParameters, lightest_pa: float
) -> None:
    """120 random networks over six windows: the same spikes, potentials within 1e-9 mV."""
    rng = np.random.default_rng(7)
    weights_pa = rng.uniform(lightest_pa, 3000.0, (NETWORKS, NEURONS, INPUTS))
    spikes = random_spikes(rng)
    fired, potential_mv = run_ours(weights_pa, spikes, neuron, delays)
    expected_fired, expected_potential_mv = run_nest(
        tmp_path,
        weights_pa=weights_pa,
        spikes=spikes,
        delay_to_relay=delays.to_relay_ms,
        delay_to_neuron=delays.to_neuron_ms,
        neuron_E_L=neuron.e_l_mv,
        neuron_V_m=neuron.e_l_mv,
        neuron_V_th=neuron.v_th_mv,
        neuron_V_reset=neuron.v_reset_mv,
        neuron_C_m=neuron.c_m_pf,
        neuron_tau_m=neuron.tau_m_ms,
        neuron_tau_syn_ex=neuron.tau_syn_ms,
        neuron_tau_syn_in=neuron.tau_syn_ms,
        neuron_t_ref=neuron.t_ref_ms,
        neuron_I_e=neuron.i_e_pa,
    )
    assert len(fired) > 5000
    assert sorted(map(tuple, fired)) == sorted(map(tuple, expected_fired))
    np.testing.assert_allclose(potential_mv, expected_potential_mv, rtol=0, atol=1e-9)
