"""Learning a policy from labelled states, and gathering the states."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from spikelane_controllers.dqn_snn.convergence import rate_errors
from spikelane_controllers.dqn_snn.feedforward import activate, FeedForward
from spikelane_controllers.dqn_snn.integrate_and_fire import IntegrateAndFireParameters
from spikelane_controllers.dqn_snn.normalisation import normalise
from spikelane_controllers.dqn_snn.transfer import (
    accuracy,
    class_shares,
    Labelled,
    learn_policy,
    TransferError,
    TransferParameters,
)
from spikelane_controllers.learning.gathering import (
    gather_states,
    Gathered,
    GatheringParameters,
)
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.filters import FilterParameters
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters
from spikelane_sim.task import action_wheels, ActionParameters

KINEMATIC = {'robot.model': 'kinematic', 'episode.max_laps': 0, 'episode.max_steps': 200}


def states(number: int = 600, seed: int = 0, rare: float = 0.2) -> Labelled:
    """Make states of 12 cells, labelled by which third has most events; the last third is rare."""
    rng = np.random.default_rng(seed)
    third = np.where(rng.random(number) < rare, 2, rng.integers(0, 2, number))
    counts = rng.integers(0, 3, (number, 12)).astype(np.uint8)
    counts[np.arange(12)[None] // 4 == third[:, None]] += 6
    return Labelled(counts, third.astype(np.int64), np.arange(number) // 20)


QUICK = TransferParameters(hidden=16, steps=300, learning_rate=0.01, measure_every=100)


def test_it_learns_what_can_be_learnt() -> None:
    """And measures it on states it was not trained with."""
    learnt = learn_policy(states(), 3, 10, QUICK, np.random.default_rng(1))
    assert [each.step for each in learnt.curve] == [100, 200, 300]
    assert learnt.curve[-1].held_out == 1.0
    assert len(learnt.held_out.actions) == 60
    assert learnt.scale == (10, 8, 50)
    shapes = [each.shape for each in learnt.network]
    assert shapes == [(16, 12), (16,), (3, 16)]
    more = learn_policy(states(), 4, 10, QUICK, np.random.default_rng(1))
    assert more.network.output_weights.shape == (4, 16)  # also where an action is never labelled
    assert accuracy(learnt.network, states(seed=5), 8) > 0.99
    wrong = states(seed=5)._replace(actions=(states(seed=5).actions + 1) % 3)
    assert accuracy(learnt.network, wrong, 8) < 0.01


def test_the_same_seed_gives_the_same_weights() -> None:
    """To the last bit, whatever PyTorch's own generator is at; another seed gives others."""
    import torch

    one = learn_policy(states(), 3, 10, QUICK, np.random.default_rng(1))
    torch.manual_seed(99)
    same, other = (
        learn_policy(states(), 3, 10, QUICK, np.random.default_rng(seed)) for seed in (1, 2)
    )
    assert [each.tobytes() for each in one.network] == [each.tobytes() for each in same.network]
    assert one.curve == same.curve
    assert one.network.hidden_bias.tobytes() != other.network.hidden_bias.tobytes()


def test_a_rare_action_is_learnt_sooner_from_balanced_batches() -> None:
    """With one state in fifty of it."""
    few = TransferParameters(hidden=16, steps=40, learning_rate=0.003)
    rare = states(rare=0.02, number=1000)
    test = states(rare=1.0, number=200, seed=8)
    plain, balanced = (
        accuracy(
            learn_policy(
                rare,
                3,
                10,
                dataclasses.replace(few, balanced=is_balanced),
                np.random.default_rng(0),
            ).network,
            test,
            8,
        )
        for is_balanced in (False, True)
    )
    assert balanced > 0.9
    assert balanced > plain + 0.2


def test_a_smaller_maximum_cuts_counts_off() -> None:
    """Counts above it are all 1."""
    network = FeedForward(*(np.eye(3, dtype=np.float32), np.zeros(3, np.float32), np.eye(3, 3)))
    state = Labelled(np.array([[2, 9, 4]], np.uint8), np.array([1]), np.array([0]))
    assert accuracy(network, state, 8) == 1.0
    assert accuracy(network, state._replace(actions=np.array([0])), 2) == 1.0  # first of equals
    limited = dataclasses.replace(QUICK, maximum=5)
    assert learn_policy(states(), 3, 10, limited, np.random.default_rng(1)).scale == (10, 5, 50)


def test_a_gain_is_taken_over_by_the_first_weights() -> None:
    """The network is for inputs without it, and as good."""
    gained = dataclasses.replace(QUICK, input_gain=4.0, steps=200)
    learnt = learn_policy(states(), 3, 10, gained, np.random.default_rng(1))
    assert accuracy(learnt.network, states(seed=5), 8) > 0.99
    largest = np.abs(learnt.network.hidden_weights).max()
    assert largest > 4 / np.sqrt(12) * 0.9  # initial weights are within 1 / sqrt(12)


def test_with_a_temperature_it_learns_how_much_better_an_action_is() -> None:
    """The softmax of the values divided by it, whatever the label; else the label alone."""
    counts = np.repeat(np.eye(2, 12, dtype=np.uint8), 300, axis=0)
    values = np.repeat(np.array([[3.0, 1.0, 1.0], [0.0, 4.0, 0.0]], np.float32), 300, axis=0)
    given = Labelled(counts, values.argmax(axis=1), np.arange(600), values)
    soft = dataclasses.replace(QUICK, temperature=2.0)
    learnt = learn_policy(given, 3, 10, soft, np.random.default_rng(1))
    outputs = activate(learnt.network, np.eye(2, 12, dtype=np.float32)).output
    shares = np.exp(outputs) / np.exp(outputs).sum(axis=1, keepdims=True)
    # exp(1.5), exp(0.5), exp(0.5), and 1, exp(2), 1, divided by their sums
    np.testing.assert_allclose(shares[0], [0.5761, 0.2119, 0.2119], atol=0.01)
    np.testing.assert_allclose(shares[1], [0.1065, 0.7870, 0.1065], atol=0.01)
    hard = learn_policy(given, 3, 10, QUICK, np.random.default_rng(1))
    outputs = activate(hard.network, np.eye(2, 12, dtype=np.float32)).output
    assert (np.exp(outputs).max(axis=1) / np.exp(outputs).sum(axis=1)).min() > 0.99
    with pytest.raises(ParameterError, match='expected 0 for states without action values, got 2'):
        learn_policy(states(), 3, 10, soft, np.random.default_rng(1))


def test_class_shares() -> None:
    """Every action has a share, whether it occurred or not."""
    assert class_shares(np.array([0, 0, 0, 2]), 4) == [0.75, 0.0, 0.25, 0.0]


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        (states(number=3), 'some to train with and some to me'),
        (states()._replace(counts=states().counts * 0), 'expected events in them, got none'),
        (
            states()._replace(actions=states().actions * 0),
            'several actions as labels, got 0 alone',
        ),
    ],
)
def test_states_that_teach_nothing_are_refused(given: Labelled, message: str) -> None:
    """One sentence."""
    with pytest.raises(TransferError, match=message):
        learn_policy(given, 3, 10, QUICK, np.random.default_rng(0))


class Leaning:
    """Turns to where more events are, chosen in each step."""

    def __init__(self) -> None:
        self.events: list[int] = []

    def reset(self, rng: np.random.Generator) -> None:
        """Nothing is remembered."""

    def step(self, observation: Observation) -> WheelVelocities:
        """Answer one observation."""
        self.events.append(len(observation.events))
        is_right = 2 * np.count_nonzero(observation.events['x'] >= 64) > len(observation.events)
        return action_wheels(2 if is_right else 0, ActionParameters())


def gather(
    seed: int, share: float, filters: FilterParameters | None = None
) -> tuple[Gathered, list[int]]:
    """Gather 60 states; return them and how many events were seen in each step."""
    parameters = GatheringParameters(states=60, random_actions=share)
    controller = Leaning()
    with Simulator(SimulatorParameters.from_mapping(KINEMATIC)) as simulator:
        gathered = gather_states(simulator, controller, parameters, seed, filters=filters)
        return gathered, controller.events


def test_states_are_gathered_where_the_controller_drives() -> None:
    """It answers every observation; a state counts those of ten steps, and knows its episode."""
    (counts, episodes), events = gather(3, 0.0)
    assert counts.shape == (60, 512)
    assert counts.dtype == np.uint8
    assert episodes.tolist() == [1] * 20 + [2] * 20 + [3] * 20  # of 20 actions of 10 steps
    assert len(events) == 600
    empty = np.flatnonzero(counts.sum(axis=1) == 0)
    assert {0, 20, 40} <= set(empty.tolist())
    assert counts.sum() > 1000
    # Not more than was seen: what is outside the cropped image is left out.
    assert 0 < counts[1].sum() <= sum(events[1:11])


def test_states_are_those_of_a_seed() -> None:
    """The same bytes with the same seed; random actions lead to other states."""
    assert (gather(3, 0.5)[0].counts == gather(3, 0.5)[0].counts).all()
    assert (gather(3, 0.5)[0].counts != gather(4, 0.5)[0].counts).any()
    assert (gather(3, 0.5)[0].counts != gather(3, 0.0)[0].counts).any()


def test_what_a_filter_removes_is_neither_answered_nor_counted() -> None:
    """No pixel of a line has 80 neighbours that fire with it; each has two."""
    values = {'chain': 'correlation', 'correlation.reach_px': 4, 'correlation.window_s': 0.0}
    none = FilterParameters.from_mapping({**values, 'correlation.supporters': 80})
    (counts, _), events = gather(3, 0.0, none)
    assert not counts.any()
    assert len(events) > 500  # observations are still answered; some episodes end early
    assert not any(events)
    some = FilterParameters.from_mapping({**values, 'correlation.supporters': 2})
    (counts, _), events = gather(3, 0.0, some)
    assert counts.sum() > 1000
    # The robot drives otherwise without a filter, where also lone pixels count.
    assert (counts != gather(3, 0.0)[0].counts).any()


def test_whole_episodes_are_held_out() -> None:
    """Of thirty with twenty states each, three; by default states of nearly all episodes."""
    whole = dataclasses.replace(QUICK, held_out_by='episode', steps=1)
    held_out = learn_policy(states(), 3, 10, whole, np.random.default_rng(1)).held_out
    numbers, sizes = np.unique(held_out.episodes, return_counts=True)
    assert (len(numbers), sizes.tolist()) == (3, [20, 20, 20])
    single = dataclasses.replace(whole, held_out_by='state')
    held_out = learn_policy(states(), 3, 10, single, np.random.default_rng(1)).held_out
    assert len(held_out.episodes) == 60
    assert len(np.unique(held_out.episodes)) > 20


def test_rates_come_closer_to_activations_with_time() -> None:
    """Down to what is lost at a reset to 0; reset by subtraction loses less."""
    rng = np.random.default_rng(2)
    shapes = ((40, 60), (40,), (3, 40))
    network = normalise(FeedForward(*(rng.normal(size=s) for s in shapes))).network
    values = (rng.random((8, 60)) * 0.5).astype(np.float32)
    durations = (10.0, 100.0, 1000.0, 10_000.0)
    curves = {
        reset: rate_errors(
            network,
            values,
            durations,
            IntegrateAndFireParameters(reset=reset, clamped=False),
            np.random.default_rng(3),
        )
        for reset in ('zero', 'subtract')
    }
    for errors in curves.values():
        hidden = [each.hidden for each in errors]
        assert hidden == sorted(hidden, reverse=True)
        assert hidden[0] > 5 * hidden[-1]
    assert curves['subtract'][-1].hidden < 0.5 * curves['zero'][-1].hidden
    assert curves['subtract'][-1].agreement == 1.0
    assert (activate(network, values).output > 0).any()
