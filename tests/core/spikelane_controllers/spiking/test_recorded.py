"""What controllers record of themselves: it is what happened, and changes nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from spikelane_controllers.quantities import ALL, begin_to_record, SpikeTimes
from spikelane_controllers.registry import make_controller
from spikelane_controllers.shown import Shown
from spikelane_controllers.spiking.network import DelayParameters, resting_state, run_network
from spikelane_controllers.spiking.neuron import neuron_constants, NeuronParameters
from spikelane_controllers.spiking.plasticity import PlasticNetwork, resting_plastic_state
from spikelane_controllers.spiking.poisson import poisson_spikes
from spikelane_controllers.spiking.synapse import synapse_rule, SynapseParameters
from spikelane_sim.contract import (
    controller_rng,
    LaneState,
    Observation,
    WheelVelocities,
)
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import make_events
from spikelane_sim.period import PERIOD_NS

#: What each controller offers.
OFFERED = {
    'braitenberg': ['spikes', 'input_spikes', 'potentials'],
    'rstdp': ['spikes', 'input_spikes', 'potentials', 'traces', 'dopamine', 'weights'],
    'dqn_snn': ['spikes', 'input_spikes', 'potentials', 'action_traces'],
}
STEPS = 12


def observations() -> list[Observation]:
    """Make steps with random events, in which the robot is right of the centre."""
    lane = LaneState('outer', 0.05, 0.0, 0.0, 'A', 0.0, 0, 1, 1, False, '')
    made = []
    for step in range(STEPS):
        rng = np.random.default_rng(step)
        x_px, y_px = rng.integers(0, 128, 150), np.sort(rng.integers(40, 104, 150))
        stamp_ns = PERIOD_NS * (step + 1)
        made.append(Observation(stamp_ns, make_events(stamp_ns, x_px, y_px, 1), lane))
    return made


def drive(name: str, record: Sequence[str]) -> tuple[Any, list[WheelVelocities], list[Shown]]:
    """Answer the observations, recording some quantities."""
    learning = {'learning': True, 'checkpoint': ''} if name == 'rstdp' else {}
    controller: Any = make_controller(name, learning)
    begin_to_record(name, controller, record)
    controller.reset(controller_rng(3, 1))
    answers, shown = [], []
    for each in observations():
        answers.append(controller.step(each))
        shown.append(controller.shown)
    return controller, answers, shown


@pytest.mark.parametrize('name', OFFERED)
def test_recording_changes_no_bit(name: str) -> None:
    """Answers, spikes and all that lives on are those of a drive without."""
    plain, answers, shown = drive(name, [])
    recording, same_answers, same_shown = drive(name, [ALL])
    assert repr(same_answers) == repr(answers)
    assert [each.spikes for each in same_shown] == [each.spikes for each in shown]
    assert not any(each.recorded for each in shown)
    if name == 'rstdp':
        states = plain.state(), recording.state()
        assert [repr(value) for value in states[0].values()] == [
            repr(value) for value in states[1].values()
        ]


@pytest.mark.parametrize('name', OFFERED)
def test_what_is_recorded_is_as_the_controller_says(name: str) -> None:
    """Names, shapes, sources and times."""
    _, _, shown = drive(name, [ALL])
    assert [each.name for each in shown[0].quantities] == OFFERED[name]
    for each in shown:
        assert set(each.recorded) == set(OFFERED[name])
        for quantity in each.quantities:
            sample = each.recorded[quantity.name]
            if isinstance(sample, SpikeTimes):
                assert quantity.is_spikes
                assert (np.diff(sample.offsets_ns) >= 0).all()
                assert set(sample.sources) <= set(range(len(quantity.axes[0].labels)))
                assert all(0 < offset <= PERIOD_NS for offset in sample.offsets_ns)
            else:
                assert (sample.shape, sample.dtype) == (quantity.shape, np.float64)


@pytest.mark.parametrize('name', OFFERED)
def test_recorded_spikes_are_the_spikes_counted(name: str) -> None:
    """Neuron by neuron in each step; there are some."""
    _, _, shown = drive(name, ['spikes'])
    labels = shown[0].quantities[0].axes[0].labels
    for each in shown:
        assert list(each.recorded) == ['spikes']
        spikes: Any = each.recorded['spikes']
        counted = np.bincount(spikes.sources, minlength=len(labels))[-len(each.neurons) :]
        assert labels[-len(each.neurons) :] == each.neurons
        assert tuple(counted.tolist()) == each.spikes
    assert sum(sum(each.spikes) for each in shown) > 0


def test_dopamine_is_the_reward_and_traces_have_their_signs() -> None:
    """0.05 m right of the centre make 0.0005 / ms, with both signs; weights go with c n."""
    controller, _, shown = drive('rstdp', [ALL])
    for each in shown:
        assert each.recorded['dopamine'].tolist() == [[-0.0005, 0.0005]]
    weights = [np.asarray(each.recorded['weights'])[0] for each in shown]
    assert np.array_equal(weights[-1], controller.weights_pa)
    state = controller.state()
    assert np.array_equal(shown[-1].recorded['traces'][0], state['network.eligibility'])
    assert np.abs(weights[-1] - weights[0]).max() > 0


def test_potentials_are_those_between_shorter_windows() -> None:
    """Networks with learning and with static synapses are run millisecond by millisecond."""
    inputs = poisson_spikes(np.full(4, 300.0), np.random.default_rng(1))
    weights_pa = np.linspace(400.0, 900.0, 8).reshape(2, 4)
    delays, constants = DelayParameters(), neuron_constants(NeuronParameters())
    rule = synapse_rule(SynapseParameters(), delays)
    rest = resting_plastic_state(weights_pa, delays)
    fired, potentials_mv = PlasticNetwork(rest, constants, rule).run_watched(inputs)
    short, static = PlasticNetwork(rest, constants, rule, 10), resting_state(2)
    for sample in range(50):
        part = inputs[(inputs['step'] >= 10 * sample) & (inputs['step'] < 10 * sample + 10)].copy()
        part['step'] -= 10 * sample
        short.run(part)
        static, _ = run_network(static, part, weights_pa, constants, delays.steps, 10)
        assert potentials_mv[sample].tolist() == short.state.neurons['potential_mv'].tolist()
        assert potentials_mv[sample].tolist() == static.neurons['potential_mv'].tolist()
    assert len(fired) > 4
    assert potentials_mv.max() < 15.0  # the threshold, above the potential at rest


@pytest.mark.parametrize(
    ('name', 'asked', 'message'),
    [
        (
            'braitenberg',
            ['spikes', 'traces'],
            'record: expected any of spikes, input_spikes, potentials, or all, which braitenberg '
            'offers, got traces',
        ),
        ('dqn', ['spikes'], 'record: expected nothing, which dqn offers, got spikes'),
        ('dqn', ['all'], 'record: expected nothing, which dqn offers, got all'),
    ],
)
def test_what_is_not_offered_is_refused(name: str, asked: list[str], message: str) -> None:
    """The message names what the controller offers."""
    with pytest.raises(ParameterError) as caught:
        begin_to_record(name, make_controller(name), asked)
    assert str(caught.value) == message
