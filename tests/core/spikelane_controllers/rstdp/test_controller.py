"""The R-STDP controller as a whole."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from spikelane_controllers.rstdp.controller import RStdp, RStdpParameters
from spikelane_controllers.spiking.synapse import SynapseParameters
from spikelane_sim.contract import LaneState, Observation, WheelVelocities
from spikelane_sim.errors import CheckpointError, ParameterError
from spikelane_sim.events import make_events, no_events
from spikelane_sim.period import PERIOD_NS
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

CONFIG = Path(__file__).parents[4] / 'controllers' / 'config' / 'rstdp.yaml'


UNTRAINED = RStdpParameters(learning=True, checkpoint='')


def observation(seed: int, distance_m: float | None = 0.1, number: int = 200) -> Observation:
    """Make random events in the rows that are not cropped, seen at a distance from the centre."""
    rng = np.random.default_rng(seed)
    x_px, y_px = rng.integers(0, 128, number), np.sort(rng.integers(40, 104, number))
    events = make_events(PERIOD_NS, x_px, y_px, 1)
    if distance_m is None:
        return Observation(PERIOD_NS, events, None)
    lane = LaneState('outer', distance_m, 0.0, 0.0, 'A', 0.0, 0, 1, 1, False, '')
    return Observation(PERIOD_NS, events, lane)


Answer = tuple[WheelVelocities, tuple[int, ...], bytes]


def drive(controller: RStdp, first: int = 0, steps: int = 20) -> list[Answer]:
    """Answer observations to the left and to the right of the lane."""
    answers = []
    for seed in range(first, first + steps):
        wheels = controller.step(observation(seed, 0.2 * np.sin(seed)))
        answers.append((wheels, controller.spikes, controller.weights_pa.tobytes()))
    return answers


def trained(seed: int = 3) -> RStdp:
    """Return a controller in the midst of an episode."""
    controller = RStdp(UNTRAINED)
    controller.initialise(np.random.default_rng(seed))
    controller.reset(np.random.default_rng(seed))
    drive(controller)
    return controller


def test_initial_weights_are_the_papers_and_drawn_from_the_generator() -> None:
    """32 inputs to both neurons, uniform in 200 to 201 pA."""
    controller = RStdp(UNTRAINED)
    controller.initialise(np.random.default_rng(1))
    first = controller.weights_pa
    assert first.shape == (2, 32)
    assert 200.0 <= first.min() < 200.1
    assert 200.9 < first.max() <= 201.0
    controller.initialise(np.random.default_rng(1))
    assert (controller.weights_pa == first).all()
    controller.initialise(np.random.default_rng(2))
    assert (controller.weights_pa != first).all()


def test_right_of_the_centre_the_right_neuron_is_rewarded() -> None:
    """So the robot learns to turn left; the left neuron's synapses are weakened."""
    for distance_m, sign in ((0.1, 1.0), (-0.1, -1.0)):
        controller = RStdp(dataclasses.replace(UNTRAINED, synapse=SynapseParameters(a_minus=0.0)))
        controller.reset(np.random.default_rng(0))
        before = controller.weights_pa
        for seed in range(10):
            controller.step(observation(seed, distance_m))
        assert controller.reward == pytest.approx(0.01 * distance_m)
        left, right = controller.weights_pa - before
        assert (sign * right > 0.0).all()
        assert (sign * left < 0.0).all()


@pytest.mark.parametrize('distance_m', [0.0, None])
def test_without_a_reward_nothing_is_learnt(distance_m: float | None) -> None:
    """In the centre, or where nobody knows where the robot is."""
    controller = RStdp(UNTRAINED)
    before = controller.weights_pa
    for seed in range(10):
        controller.step(observation(seed, distance_m))
    assert sum(controller.spikes) > 0
    assert (controller.weights_pa == before).all()
    assert np.isnan(controller.reward) == (distance_m is None)


def test_learning_can_be_turned_off_and_on() -> None:
    """The parameter is the start; between steps the attribute decides."""
    controller = RStdp(RStdpParameters(learning=False, checkpoint=''))
    before = controller.weights_pa
    drive(controller)
    assert (controller.weights_pa == before).all()
    controller.learning = True
    drive(controller)
    assert (controller.weights_pa != before).any()


def test_an_episode_begins_with_new_steering_and_the_same_network() -> None:
    """Straight on and slowly, though the network goes on where it was."""
    controller = trained()
    assert controller.step(observation(0)) != (1.0, 1.0)
    before = controller.state()
    controller.reset(np.random.default_rng(9))
    after = controller.state()
    network = [name for name in before if name.startswith('network.')]
    assert len(network) > 10
    assert all(np.array_equal(before[name], after[name]) for name in network)
    assert (after['steering.speed'], after['steering.turn']) == (1.0, 0.0)
    assert controller.spikes == (0, 0)


def test_a_restored_controller_goes_on_bit_for_bit() -> None:
    """In another controller, after the state went through JSON and plain arrays."""
    one = trained()
    state = one.state()
    arrays = {name: value for name, value in state.items() if isinstance(value, np.ndarray)}
    facts = {name: value for name, value in state.items() if name not in arrays}
    assert all(array.dtype.names is None for array in arrays.values())
    facts = json.loads(json.dumps(facts, allow_nan=False))
    other = RStdp(UNTRAINED)
    other.restore({**arrays, **facts})
    assert other.spikes == one.spikes
    assert drive(other, 20, 50) == drive(one, 20, 50)


def test_a_state_does_not_change_when_the_controller_goes_on() -> None:
    """It is a copy."""
    controller = trained()
    state = controller.state()
    before = {name: np.array(value) for name, value in state.items()}
    drive(controller)
    assert all(np.array_equal(before[name], state[name]) for name in before)


@pytest.mark.parametrize(
    ('name', 'value', 'message'),
    [
        (
            'network.weights_pa',
            np.zeros((2, 30)),
            r'expected shape \(2, 32\), got shape \(2, 30\)',
        ),
        ('network.weights_pa', np.full((2, 32), np.nan), 'expected finite numbers, got nan'),
        ('network.weights_pa', np.full((2, 32), -1.0), 'expected weights in range'),
        ('network.weights_pa', [1.0], 'expected an array of float64'),
        ('network.in_flight.source', None, 'expected in the state, but it is missing'),
        (
            'network.history.k_minus',
            np.zeros(99),
            'network.history: expected fields of one length',
        ),
        ('steering.turn', float('nan'), 'steering.turn: expected a number, got nan'),
        ('learning', 1, 'learning: expected true or false, got 1'),
        ('weights', np.zeros(3), 'weights: expected one of network.neurons'),
    ],
)
def test_a_state_of_something_else_is_refused(name: str, value: object, message: str) -> None:
    """The message names what is wrong; the controller stays as it was."""
    controller = trained()
    state = controller.state()
    if value is None:
        del state[name]
    else:
        state[name] = value
    with pytest.raises(CheckpointError, match=message):
        controller.restore(state)
    assert drive(controller, 20) == drive(trained(), 20)


def test_spikes_of_inputs_that_are_not_there_are_refused() -> None:
    """The kernel would read beyond its arrays."""
    controller = trained()
    state = controller.state()
    assert len(state['network.in_flight.source'])
    state['network.in_flight.source'][0] = 32
    with pytest.raises(CheckpointError, match='expected spikes in flight of its inputs'):
        controller.restore(state)


def test_the_file_of_parameters_holds_every_default() -> None:
    """The YAML file and the dataclasses agree in both directions."""
    values = yaml.safe_load(CONFIG.read_text())['/**']['ros__parameters']
    assert RStdpParameters.from_mapping(values) == RStdpParameters()
    named = set()
    for name, value in values.items():
        named |= {f'{name}.{key}' for key in value} if isinstance(value, dict) else {name}
    assert named == {spec.name for spec in RStdpParameters.specs()}


def test_the_papers_values_are_the_defaults() -> None:
    """Its table of simulation parameters."""
    values = RStdpParameters().to_dict()
    expected = {
        'c_r': 0.01,
        'poisson.max_rate_hz': 300.0,
        'poisson.max_events': 15,
        'steering.n_max': 15,
        'synapse.a_plus': 1.0,
        'synapse.a_minus': 1.0,
        'synapse.tau_plus_ms': 20.0,
        'synapse.tau_c_ms': 1000.0,
        'synapse.tau_n_ms': 200.0,
        'synapse.w_min_pa': 0.0,
        'synapse.w_max_pa': 3000.0,
    }
    assert {name: values[name] for name in expected} == expected


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'initial_weights.low_pa': 202.0}, 'high_pa: expected at least low_pa = 202 pA, got 201'),
        ({'synapse.w_max_pa': 200.5}, 'initial_weights.high_pa: expected at most synapse.w_max'),
        ({'synapse.w_min_pa': 200.5}, 'initial_weights.low_pa: expected at least synapse.w_min'),
        (
            {'neuron.t_ref_ms': 0.8},
            r'synapse.interval_ms: expected at most 0.9 ms, the shortest time between two spikes '
            r'of a neuron \(neuron.t_ref_ms \+ 0.1 ms\), got 1$',
        ),
        ({'delays.to_neuron_ms': 0.5}, 'at most the delay to_neuron_ms = 0.5 ms, got 1'),
    ],
)
def test_contradictions_are_refused(values: dict[str, float], message: str) -> None:
    """One sentence."""
    with pytest.raises(ParameterError, match=message):
        RStdpParameters.from_mapping(values)


def test_neurons_may_fire_once_in_an_interval() -> None:
    """A refractory period of 0.9 ms lets them fire every 1 ms, which is the interval."""
    RStdpParameters.from_mapping({'neuron.t_ref_ms': 0.9})
    RStdpParameters.from_mapping({'neuron.t_ref_ms': 0.1, 'synapse.interval_ms': 0.2})


def test_without_events_it_drives_straight_at_the_smallest_speed() -> None:
    """Until something is seen."""
    assert RStdp(UNTRAINED).step(Observation(PERIOD_NS, no_events(), None)) == (1.0, 1.0)


@pytest.mark.slow
def test_it_learns_to_keep_the_lane() -> None:
    """Scenario 1: after 20,000 steps of training it drives both lanes, off by under 2 cm."""
    parameters = {'robot.model': 'kinematic', 'episode.max_distance_m': 0.2}
    simulator = Simulator(SimulatorParameters.from_mapping(parameters))
    controller = RStdp(UNTRAINED)
    controller.initialise(np.random.default_rng(6))

    def begin(seed: int | None, number: int) -> Observation:
        controller.reset(np.random.default_rng([6, number]))
        return simulator.reset(seed=seed)

    seen, reasons = begin(6, 0), []
    for _ in range(20_000):
        seen = simulator.step(controller.step(seen))
        assert seen.lane is not None
        if seen.lane.terminated:
            reasons.append(seen.lane.reason)
            seen = begin(None, len(reasons))
    assert reasons[0] == 'lane_lost'
    controller.learning = False
    errors = []
    for lane in ('outer', 'inner'):
        seen = simulator.reset(lane)
        while seen.lane is not None and not seen.lane.terminated:
            errors.append(abs(seen.lane.distance_m))
            seen = simulator.step(controller.step(seen))
        assert seen.lane is not None
        assert seen.lane.reason == 'laps_complete'
    assert np.mean(errors) < 0.02
