"""Operations: what networks had to compute, counted by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from spikelane.runs.configuration import Request
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.run import drive_lap
from spikelane_controllers.dqn.q_network import (
    decision_operations,
    initial_network,
    QNetworkParameters,
)
from spikelane_controllers.operations import Operations, operations_metrics, sum_operations
from spikelane_controllers.registry import make_controller
from spikelane_sim.contract import Observation
from spikelane_sim.events import make_events, no_events

SHORT: dict[str, Any] = {'simulator.robot.model': 'kinematic', 'simulator.episode.max_steps': 20}


def busy() -> Observation:
    """Return an observation of an event at every pixel."""
    x, y = np.tile(np.arange(128), 128), np.repeat(np.arange(128), 128)
    return Observation(50_000_000, make_events(0, x, y, 1), None)


@pytest.mark.parametrize('name', ['braitenberg', 'rstdp', 'dqn_snn'])
def test_without_spikes_a_spiking_network_has_nothing_to_do(name: str) -> None:
    """It decides all the same, each step; with spikes there is work."""
    controller: Any = make_controller(name, {})
    controller.reset(np.random.default_rng(0))
    controller.step(Observation(50_000_000, no_events(), None))
    assert controller.operations == Operations(decisions=1)
    controller.step(busy())
    assert controller.operations.synaptic > 0
    controller.reset(np.random.default_rng(0))
    assert controller.operations == Operations()


@pytest.mark.parametrize(
    ('name', 'inputs', 'rate_hz', 'synapses'),
    [('braitenberg', 8, 500, 1), ('rstdp', 32, 300, 2)],
)
def test_each_input_spike_counts_at_the_synapses_it_has(
    name: str, inputs: int, rate_hz: int, synapses: int
) -> None:
    """Each input has one neuron or both, and fires for 50 ms; the numbers drawn are Poisson's."""
    controller: Any = make_controller(name, {})
    controller.reset(np.random.default_rng(3))
    counts = []
    for _ in range(100):
        controller.step(busy())
        counts.append(controller.operations.synaptic)
    spikes = inputs * rate_hz * 0.05
    assert all(count % synapses == 0 for count in counts)
    assert np.mean(counts) == pytest.approx(synapses * spikes, abs=4 * synapses * spikes**0.5 / 10)


def test_a_dqn_multiplies_every_weight_for_a_decision() -> None:
    """512-200-200-3: 102,400 + 40,000 + 600; the first layer's for its active inputs alone."""
    network = initial_network(np.random.default_rng(0), 512, 3, QNetworkParameters())
    state = np.zeros(512, np.uint8)
    state[[3, 77, 500]] = 1
    assert decision_operations(network, state) == Operations(1, 0, 143_000, 3, 41_200)


def test_a_dqn_decides_every_tenth_step() -> None:
    """At steps 0 and 10, and not with the observation that ends the episode."""
    driven = drive_lap(
        LapConfig.make(Request('1', 'dqn', 0, 'inprocess', SHORT), 'outer'),
        lambda step, progress_m: None,
    )
    assert driven.operations is not None
    assert driven.operations.decisions == 2
    assert driven.operations.multiply_accumulates == 286_000


def test_they_are_told_for_each_decision_and_second() -> None:
    """Kinds that did not occur are left out."""
    total = sum_operations([Operations(1, 30), Operations(1, 0), Operations(0, 6)])
    assert total == Operations(2, 36)
    assert operations_metrics(total, 0.1) == pytest.approx(
        {
            'decisions_per_s': 20.0,
            'synaptic_operations_per_decision': 18.0,
            'synaptic_operations_per_s': 360.0,
        }
    )


def test_operations_without_a_decision_are_told_for_each_second_alone() -> None:
    """As another package's controller may count them."""
    assert operations_metrics(Operations(synaptic=6), 2.0) == {
        'decisions_per_s': 0.0,
        'synaptic_operations_per_s': 3.0,
    }
