"""Deep Q-learning: buffer, exploration, and updates against a calculation of their own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from spikelane_controllers.dqn.experience_buffer import Replay
from spikelane_controllers.dqn.parameters import QLearningParameters
from spikelane_controllers.dqn.q_learning import QLearning
from spikelane_controllers.dqn.q_network import (
    action_values,
    initial_network,
    QNetwork,
    QNetworkParameters,
)
from spikelane_controllers.dqn.torch_q_learning import TorchQLearning
from spikelane_sim.errors import CheckpointError

INPUTS, ACTIONS = 20, 3
SIZES = QNetworkParameters(hidden_1=8, hidden_2=6, initial_bound=0.5)


def network_of(seed: int = 0) -> QNetwork:
    """Return a small network."""
    return initial_network(np.random.default_rng(seed), INPUTS, ACTIONS, SIZES)


@pytest.fixture(params=[QLearning, TorchQLearning], name='kind')
def each_kind(request: pytest.FixtureRequest) -> type[QLearning]:
    """Return the class of a learner, with Numba and with PyTorch in turn."""
    kind: type[QLearning] = request.param
    return kind


def learner_of(kind: type[QLearning] = QLearning, **parameters: Any) -> QLearning:
    """Return a learner that updates after each transition from the first on."""
    values = {'random_steps': 0, 'update_every': 1, 'batch_size': 4, 'buffer_size': 10}
    return kind(QLearningParameters(**(values | parameters)), network_of())


def transitions(count: int, seed: int = 5) -> list[tuple[Any, ...]]:
    """Return transitions between random binary states."""
    rng = np.random.default_rng(seed)
    states = rng.integers(0, 2, (2 * count, INPUTS)).astype(np.uint8)
    return [
        (states[2 * n], int(rng.integers(3)), float(rng.random()), states[2 * n + 1], n % 3 == 0)
        for n in range(count)
    ]


def teach(learner: QLearning, steps: list[tuple[Any, ...]], rng: np.random.Generator) -> None:
    """Let it learn from transitions."""
    for state, action, reward, next_state, is_final in steps:
        learner.learn(state, action, reward, next_state, rng, is_final=is_final)


@pytest.mark.parametrize(
    ('steps', 'rate'),
    [(0, 1.0), (999, 1.0), (1000, 1.0), (25_500, 0.55), (50_000, 0.1), (90_000, 0.1)],
)
def test_exploration_falls_as_in_the_papers_table(steps: int, rate: float) -> None:
    """From 1 to 0.1 over 49,000 steps after 1,000."""
    assert QLearningParameters().exploration_rate(steps) == pytest.approx(rate, abs=1e-12)


def test_the_buffer_keeps_the_last_transitions() -> None:
    """And gives them back, bit by bit."""
    given = transitions(12)
    replay = Replay(5, INPUTS)
    for state, action, reward, next_state, is_final in given:
        replay.add(state, action, reward, next_state, is_final=is_final)
    assert len(replay) == 5
    kept = {(*s, a, np.float32(r), *n, bool(f)) for s, a, r, n, f in given[7:]}
    batch = replay.sample(200, np.random.default_rng(0))
    got = {(*s, a, r, *n, bool(f)) for s, a, r, n, f in zip(*batch, strict=True)}
    assert got == kept
    assert batch.states.shape == (200, INPUTS)


def test_an_update_is_that_of_double_q_learning(kind: type[QLearning]) -> None:
    """Against Adam and a target written out, over several updates of a single transition."""
    learner = learner_of(kind, buffer_size=1, soft_update=0.25, learning_rate=0.01, discount=0.9)
    (state, action, reward, next_state, _) = transitions(1)[0]
    layers = [torch.tensor(each, dtype=torch.float64, requires_grad=True) for each in network_of()]
    target = [each.detach().clone() for each in layers]
    adam = torch.optim.Adam(layers, lr=0.01)

    def values(parts: list[torch.Tensor], given: np.ndarray) -> torch.Tensor:
        x = torch.tensor(given, dtype=torch.float64)
        x = torch.relu(x @ parts[0] + parts[1])
        x = torch.relu(x @ parts[2] + parts[3])
        return x @ parts[4] + parts[5]

    rng = np.random.default_rng(0)
    for _ in range(5):
        learner.learn(state, action, reward, next_state, rng, is_final=False)
        with torch.no_grad():
            best = int(values(layers, next_state).argmax())
            aim = reward + 0.9 * values(target, next_state)[best]
        loss = (values(layers, state)[action] - aim) ** 2
        adam.zero_grad()
        loss.backward()
        adam.step()
        with torch.no_grad():
            for old, new in zip(target, layers, strict=True):
                old += 0.25 * (new - old)
        assert learner.loss == pytest.approx(loss.item(), rel=1e-4)
    for got, expected in zip(learner.network, layers, strict=True):
        np.testing.assert_allclose(got, expected.detach().numpy(), rtol=1e-4, atol=1e-6)
    got_target = learner.state()
    for name, expected in zip(QNetwork._fields, target, strict=True):
        np.testing.assert_allclose(got_target[f'target.{name}'], expected, rtol=1e-4, atol=1e-6)


def test_nothing_is_gained_after_a_final_transition(kind: type[QLearning]) -> None:
    """Its value becomes the reward alone."""
    state, action, _, next_state, _ = transitions(1)[0]
    learner = learner_of(kind, buffer_size=1, soft_update=1.0, learning_rate=0.01)
    for _ in range(300):
        learner.learn(state, action, 2.0, next_state, np.random.default_rng(0), is_final=True)
    assert learner.loss < 1e-3


def test_updates_come_at_their_steps(kind: type[QLearning]) -> None:
    """Every fourth after the random ones."""
    learner = learner_of(kind, random_steps=8, update_every=4)
    updates = []
    for each in transitions(20):
        teach(learner, [each], np.random.default_rng(0))
        updates.append(learner.updates)
    assert updates == [0] * 11 + [1] * 4 + [2] * 4 + [3]
    assert learner.steps == 20


def test_actions_are_random_at_first_and_greedy_without_exploration() -> None:
    """All three by chance; then always the same."""
    state = transitions(1)[0][0]
    rng = np.random.default_rng(0)
    assert {learner_of(random_steps=5).act(state, rng) for _ in range(30)} == {0, 1, 2}
    greedy = learner_of(exploration_start=0.0, exploration_end=0.0)
    assert len({greedy.act(state, rng) for _ in range(30)}) == 1


def test_a_restored_learner_goes_on_bit_for_bit(kind: type[QLearning]) -> None:
    """With networks, Adam and buffer as they were."""
    steps = transitions(40)
    whole, other = learner_of(kind), learner_of(kind)
    rng = np.random.default_rng(7)
    teach(whole, steps[:23], rng)
    teach(other, transitions(3, seed=9), np.random.default_rng(1))
    other.restore(whole.state())
    rng_other = np.random.default_rng()
    rng_other.bit_generator.state = rng.bit_generator.state
    teach(whole, steps[23:], rng)
    teach(other, steps[23:], rng_other)
    assert (whole.steps, whole.updates, whole.loss) == (other.steps, other.updates, other.loss)
    for name, value in whole.state().items():
        assert np.array_equal(value, other.state()[name]), name
    assert np.abs(whole.network.weights_1 - network_of().weights_1).max() > 1e-4


def test_a_state_that_was_taken_stays_as_it_is(kind: type[QLearning]) -> None:
    """Whatever is learnt afterwards, also when the buffer of ten begins anew."""
    learner, rng = learner_of(kind), np.random.default_rng(7)
    steps = transitions(40)
    teach(learner, steps[:23], rng)
    taken = learner.state()
    then = {name: np.array(value) for name, value in taken.items()}
    teach(learner, steps[23:], rng)
    for name, value in taken.items():
        assert np.array_equal(value, then[name]), name


@pytest.mark.parametrize(
    ('name', 'value', 'message'),
    [
        (
            'network.weights_1',
            np.zeros((20, 9), np.float32),
            r'weights_1: expected shape \(20, 8\)',
        ),
        ('adam.mean', np.full(241, np.nan, np.float32), 'adam.mean: expected'),
        ('replay.states', np.zeros((10, 3)), 'replay.states: expected an array of uint8'),
        ('steps', 1.5, 'steps: expected a whole number, got 1.5'),
    ],
)
def test_the_state_of_another_learner_is_refused(name: str, value: Any, message: str) -> None:
    """The line says what differs."""
    learner = learner_of()
    with pytest.raises(CheckpointError, match=message):
        learner.restore({**learner.state(), name: value})


def flat(network: QNetwork) -> np.ndarray:
    """Return all weights and biases, (n,)."""
    return np.concatenate([part.ravel() for part in network])


def of_the_papers_size(
    kind: type[QLearning], network: QNetwork
) -> tuple[QLearning, np.random.Generator]:
    """Return a learner that updates after each transition, and what it draws with."""
    parameters = QLearningParameters(random_steps=40, update_every=1, buffer_size=1000)
    return kind(parameters, network), np.random.default_rng(1)


def test_numba_stays_with_pytorch_over_2500_updates() -> None:
    """Losses and weights drift apart by rounding alone: each single update is nearly the same."""
    network = initial_network(np.random.default_rng(0), 512, 3, QNetworkParameters())
    (ours, ours_rng), (theirs, theirs_rng), (again, _) = (
        of_the_papers_size(kind, network) for kind in (QLearning, TorchQLearning, QLearning)
    )
    rng = np.random.default_rng(3)
    rates = np.clip(rng.normal(0.0, 0.1, 512), 0.0, 1.0)  # some inputs are never 1
    states = (rng.random((2541, 512)) < rates).astype(np.uint8)
    losses = []
    for n in range(2540):
        given = states[n], n % 3, float(states[n, :50].mean()) * 10, states[n + 1]
        is_checked = n % 125 == 124
        if is_checked:
            again.restore(theirs.state())
            again_rng = np.random.default_rng()
            again_rng.bit_generator.state = theirs_rng.bit_generator.state
            again.learn(*given, again_rng, is_final=n % 50 == 0)
        ours.learn(*given, ours_rng, is_final=n % 50 == 0)
        theirs.learn(*given, theirs_rng, is_final=n % 50 == 0)
        losses.append((ours.loss, theirs.loss))
        if is_checked:
            assert again.loss == pytest.approx(theirs.loss, rel=1e-4)
            # Adam moves a weight by up to 1e-4, whose sign may hang on rounding where the
            # gradient vanishes.
            apart = np.abs(flat(again.network) - flat(theirs.network))
            assert np.sqrt((apart**2).mean()) < 1e-7
            assert apart.max() < 2e-4
    assert ours.updates == theirs.updates == 2500
    early, late = np.array(losses[40:140]), np.array(losses[-500:])
    np.testing.assert_allclose(early[:, 0], early[:, 1], rtol=1e-3)
    assert late[:, 0].mean() == pytest.approx(late[:, 1].mean(), rel=0.1)
    apart, moved = (
        np.sqrt(((flat(ours.network) - flat(other)) ** 2).mean())
        for other in (theirs.network, network)
    )
    assert apart < 0.2 * moved


@pytest.mark.parametrize(
    ('first', 'second'), [(QLearning, TorchQLearning), (TorchQLearning, QLearning)]
)
def test_a_state_goes_from_one_backend_to_the_other(
    first: type[QLearning], second: type[QLearning]
) -> None:
    """Bit for bit, and both go on from it nearly alike."""
    steps = transitions(30)
    one, other = learner_of(first), learner_of(second)
    rng, rng_other = np.random.default_rng(7), np.random.default_rng(7)
    teach(one, steps[:20], rng)
    other.restore(one.state())
    for name, value in one.state().items():
        assert np.array_equal(value, other.state()[name]), name
    rng_other.bit_generator.state = rng.bit_generator.state
    teach(one, steps[20:], rng)
    teach(other, steps[20:], rng_other)
    np.testing.assert_allclose(flat(other.network), flat(one.network), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(
    ('given', 'needs_pytorch'),
    [({}, False), ({'backend': 'torch'}, True), ({'device': 'cuda'}, True)],
)
def test_pytorch_is_needed_where_it_is_asked_for_or_on_a_gpu(
    given: dict[str, str], needs_pytorch: bool
) -> None:
    """Numba computes on the CPU, which is the default."""
    assert QLearningParameters(**given).needs_pytorch is needs_pytorch


def test_weights_that_are_no_numbers_do_not_become_numbers(kind: type[QLearning]) -> None:
    """A network that has diverged shows it in its loss and its values."""
    learner, rng = learner_of(kind, learning_rate=10.0), np.random.default_rng(0)
    [(state, action, _, next_state, _)] = transitions(1)
    for _ in range(3):
        learner.learn(state, action, 1e38, next_state, rng, is_final=True)
    assert not np.isfinite(learner.loss)
    assert not np.isfinite(action_values(learner.network, state[None])).all()
