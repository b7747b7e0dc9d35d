"""Our learning synapses against NEST's: the same network and inputs, the time of a step."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
import subprocess
import sys
import tempfile
import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_benches.unavailable import BenchmarkUnavailableError
from spikelane_controllers.spiking.network import DelayParameters
from spikelane_controllers.spiking.neuron import neuron_constants, NeuronParameters
from spikelane_controllers.spiking.plasticity import PlasticNetwork, resting_plastic_state
from spikelane_controllers.spiking.poisson import poisson_spikes
from spikelane_controllers.spiking.spikes import GRID_STEPS, Spikes
from spikelane_controllers.spiking.synapse import synapse_rule, SynapseParameters
from spikelane_sim.errors import SpikelaneError

NEST_VERSION = '3.10.0'
#: Time in which it must be installed, where it is missing [s].
INSTALLATION_S = 600
NEURONS, INPUTS = 2, 32

#: Spikes of all inputs in a second: about what the paper's camera causes on its course.
INPUT_RATE_HZ = 560.0


class Task(NamedTuple):
    """What both simulate."""

    weights_pa: NDArray[np.float64]  # at the start
    inputs: list[Spikes]  # of each window
    dopamine: NDArray[np.float64]  # (n_windows, n_neurons)


def measure_plasticity(windows: int = 400, seed: int = 0) -> dict[str, Any]:
    """Run the R-STDP network of the paper in NEST and here, in windows of 50 ms.

    Args:
        windows: How many.
        seed: Seed of inputs, weights and reward.

    Dopamine is set in NEST as the authors' program does it, by one value for all synapses of a
    neuron. A list with one value for each synapse is much quicker, for some reason inside PyNEST,
    and is measured too.

    Returns:
        `ratio`, NEST's time of a window over ours, dopamine set in both; `ratio_list`, the same
        with NEST's quicker way; `ratio_simulate`, without NEST's setting the dopamine; the
        usual times, `ours_us`, `nest_us` and `nest_simulate_us`; and how well both
        agree, `same_spikes` and `weight_difference_pa`.

    Raises:
        BenchmarkUnavailableError: NEST is missing and cannot be installed.
        SpikelaneError: NEST failed.
    """
    _provide_nest()
    task = _make_task(windows, seed)
    fired, weights_pa, ours_us = _run_ours(task)
    nest = _run_nest(task)
    nest_us = nest['simulate_us'] + nest['set_us']
    by_list_us, by_value_us, simulate_us = (
        _usual(times) for times in (nest_us[::2], nest_us[1::2], nest['simulate_us'])
    )
    return {
        'ratio': by_value_us / ours_us,
        'ratio_list': by_list_us / ours_us,
        'ratio_simulate': simulate_us / ours_us,
        'ours_us': ours_us,
        'nest_us': by_value_us,
        'nest_simulate_us': simulate_us,
        'same_spikes': fired == sorted(map(tuple, nest['fired'].tolist())),
        'weight_difference_pa': float(np.abs(weights_pa - nest['weights_pa']).max()),
    }


def _provide_nest() -> None:
    """Install NEST where it is missing; NumPy stays as it is, since others are compiled for it."""
    if importlib.util.find_spec('nest') is not None:
        return
    nest = f'nest-simulator=={NEST_VERSION}'
    how = f'expected NEST to compare with, it is missing: pip install {nest}'
    if sys.prefix == sys.base_prefix:
        raise BenchmarkUnavailableError(how)  # nothing is installed outside of an environment
    print(f'installing {nest} to compare with ...', file=sys.stderr)
    command = [sys.executable, '-m', 'pip', 'install', '--quiet', nest, f'numpy=={np.__version__}']
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=INSTALLATION_S
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise BenchmarkUnavailableError(f'{how} ({error})') from None
    importlib.invalidate_caches()
    if done.returncode or importlib.util.find_spec('nest') is None:
        why = (done.stdout + done.stderr).strip().splitlines()
        raise BenchmarkUnavailableError(f'{how} ({why[-1] if why else "it did not help"})')


def _make_task(windows: int, seed: int) -> Task:
    rng = np.random.default_rng(seed)
    rates_hz = np.full(INPUTS, INPUT_RATE_HZ / INPUTS)
    reward = 0.01 * rng.normal(0.0, 0.03, windows)
    return Task(
        rng.uniform(200.0, 600.0, (NEURONS, INPUTS)),
        [poisson_spikes(rates_hz, rng) for _ in range(windows)],
        np.stack([-reward, reward], axis=-1),
    )


def _run_ours(task: Task) -> tuple[list[tuple[int, int]], NDArray[np.float64], float]:
    """Return the spikes, the last weights, and the usual time of a window [us]."""
    delays = DelayParameters()
    constants = neuron_constants(NeuronParameters())
    rule = synapse_rule(SynapseParameters(), delays)
    begin = resting_plastic_state(task.weights_pa, delays)
    PlasticNetwork(begin, constants, rule).run(task.inputs[0])  # compiles
    network = PlasticNetwork(begin, constants, rule)
    spikes, times_us = [], []
    for window, inputs in enumerate(task.inputs):
        start = time.perf_counter()
        network.dopamine[:] = task.dopamine[window]
        fired = network.run(inputs)
        times_us.append((time.perf_counter() - start) * 1e6)
        spikes += [(step + window * GRID_STEPS, neuron) for step, neuron in fired.tolist()]
    return sorted(spikes), network.weights_pa, _usual(np.array(times_us))


def _usual(times_us: NDArray[np.float64]) -> float:
    """Return the lower quartile: what others do on the machine lengthens the longer windows."""
    return float(np.percentile(times_us, 25))


def _run_nest(task: Task) -> dict[str, NDArray[Any]]:
    steps = [inputs['step'] + k * GRID_STEPS for k, inputs in enumerate(task.inputs)]
    sources = [inputs['source'] for inputs in task.inputs]
    spikes = np.column_stack([np.concatenate(steps), np.concatenate(sources)])
    with tempfile.TemporaryDirectory() as folder:
        given, result = Path(folder, 'given.npz'), Path(folder, 'result.npz')
        np.savez(given, weights_pa=task.weights_pa, spikes=spikes, dopamine=task.dopamine)
        script = Path(__file__).with_name('nest_plasticity.py')
        command = [sys.executable, str(script), str(given), str(result)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SpikelaneError(f'NEST failed: {(done.stdout + done.stderr).strip()[-500:]}')
        with np.load(result) as read:
            return dict(read)
