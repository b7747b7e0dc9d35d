"""From a policy to a network that can spike: training it to do as the policy (section 3.5).

The states that were met are labelled with the actions the deep Q-network chooses in them; a
smaller network learns to choose the same, seeing how many events there were where the Q-network
sees whether there were any. Then its weights are normalised.

    1. label all states, set some apart;
    2. divide the counts by the largest of all;
    3. train by cross entropy, a batch of random states in each step;
    4. normalise.

With a temperature, the network learns the softmax of the action values instead of the best action
alone (policy distillation: Rusu et al. 2016). Where two actions are worth nearly the same, a label
says little, and the values say how little.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import dataclasses
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.dqn_snn.controller import SpikingParameters
from spikelane_controllers.dqn_snn.feedforward import activate, FeedForward
from spikelane_controllers.dqn_snn.transferred import InputScale
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.parameters import MOST_STEPS, nested, parameter, Parameters
from spikelane_sim.period import PERIOD_MS

if TYPE_CHECKING:
    import torch

_TABLE = 'table "DQN-SNN parameters"'

#: What is told while it trains: steps done, and of how many.
OnProgress = Callable[[int, int], None]


class TransferError(SpikelaneError):
    """States cannot be learnt from."""

    exit_status = 1


@dataclasses.dataclass(frozen=True, kw_only=True)
class TransferParameters(Parameters):
    """How the network is trained."""

    hidden: int = parameter(200, 'Number of hidden units.', low=1, high=16_384, source=_TABLE)
    steps: int = parameter(
        10_000, 'Number of training steps.', low=1, high=MOST_STEPS, source=_TABLE
    )
    batch_size: int = parameter(
        50, 'States in one training step.', low=1, high=65_536, source=_TABLE
    )
    learning_rate: float = parameter(1e-4, "Adam's step size.", low=0.0, high=10.0, source=_TABLE)
    held_out: float = parameter(
        0.1, 'Share of the states that is kept for measuring the accuracy.', low=0.001, high=0.9
    )
    held_out_by: str = parameter(
        'state',
        'What is kept or trained with as a whole: each state by itself (state), or all states of '
        'an episode (episode), so that none is kept whose neighbours are trained with.',
        choices=('state', 'episode'),
    )
    rounds: int = parameter(
        0,
        'Times that the spiking network drives, as many states as were gathered before are '
        'gathered where it goes, and it learns anew from all states (DAgger: Ross, Gordon and '
        'Bagnell 2011).',
        low=0,
        high=100,
    )
    driving: SpikingParameters = nested(SpikingParameters)  # in these rounds
    maximum: int = parameter(
        0,
        'Events in a cell at which its input is 1; 0: the largest number in any state.',
        low=0,
        high=255,
        source='section 3.5',
    )
    input_gain: float = parameter(
        1.0,
        'Factor by which inputs are multiplied during the training; the first weights are '
        'multiplied by it afterwards. A factor above 1 makes learning quicker where most '
        'inputs are small.',
        low=1e-3,
        high=1e6,
    )
    normalisation: str = parameter(
        'model',
        'What each layer is divided by: its largest possible input (model), or its largest '
        'activation on the states held out (data).',
        choices=('model', 'data'),
        source='section 3.5, algorithm 1',
    )
    temperature: float = parameter(
        0.0,
        "What is learnt: the best action (0), or the softmax of the Q-network's action values "
        'divided by this temperature (policy distillation: Rusu et al. 2016).',
        low=0.0,
        high=1e6,
    )
    balanced: bool = parameter(
        False, 'Draw batches with equally many states of each action, however rare an action is.'
    )
    decays: bool = parameter(
        False, 'Let the step size fall to 0 over the training, along half a cosine.'
    )
    measure_every: int = parameter(
        500, 'Training steps between two measurements of the accuracy.', low=1, high=MOST_STEPS
    )


class Labelled(NamedTuple):
    """States and what to do in them."""

    counts: NDArray[np.uint8]  # events in each cell, (n, n_inputs)
    actions: NDArray[np.int64]  # (n,)
    episodes: NDArray[np.int64]  # numbers of the episodes that they were met in, (n,)
    values: NDArray[np.float32] | None = None  # of all actions, (n, n_actions)


class Measured(NamedTuple):
    """How well the network did after some training steps."""

    step: int
    training: float  # accuracy on states it is trained with (a part of them)
    held_out: float  # accuracy on states it is not


class Learnt(NamedTuple):
    """What came of a training."""

    network: FeedForward
    scale: InputScale
    curve: tuple[Measured, ...]  # the last after all steps
    held_out: Labelled


def learn_policy(
    states: Labelled,
    actions: int,
    frames: int,
    parameters: TransferParameters,
    rng: np.random.Generator,
    show: OnProgress = lambda step, steps: None,
    frame_ms: int = PERIOD_MS,
) -> Learnt:
    """Train a network to choose the actions of labelled states.

    The same arguments give the same weights, bit for bit, on the same machine.

    Args:
        states: All of them.
        actions: How many there are, labelled or not.
        frames: Frames that a state counts.
        parameters: How.
        rng: Where all random numbers come from.
        show: Called after every step.
        frame_ms: Length of a frame [ms].

    Raises:
        TransferError: There are too few states, no events in them, or a single action.
        ParameterError: There is a temperature, but the states have no action values.
    """
    if parameters.temperature and states.values is None:
        raise ParameterError(
            f'transfer.temperature: expected 0 for states without action values, '
            f'got {parameters.temperature:g}'
        )
    train, held_out = _split(states, parameters, rng)
    _check(train, held_out)
    maximum = parameters.maximum or int(states.counts.max())
    curve = []
    with _one_thread():
        training = _Training(train, maximum, actions, parameters, rng)
        sample = _take(train, rng.permutation(len(train.actions))[: len(held_out.actions)])
        for step in range(1, parameters.steps + 1):
            training.step()
            show(step, parameters.steps)
            if step % parameters.measure_every == 0 or step == parameters.steps:
                network = training.network()
                accuracies = (accuracy(network, each, maximum) for each in (sample, held_out))
                curve.append(Measured(step, *accuracies))
    return Learnt(network, InputScale(frames, maximum, frame_ms), tuple(curve), held_out)


def scaled(counts: NDArray[np.uint8], maximum: int) -> NDArray[np.float32]:
    """Return the inputs' values: counts / maximum, at most 1, of the same shape."""
    return np.minimum(counts, maximum).astype(np.float32) / np.float32(maximum)


def accuracy(network: FeedForward, states: Labelled, maximum: int) -> float:
    """Return the share of states in which the network chooses the action they are labelled with.

    An action is chosen where its output is the largest.
    """
    chosen = activate(network, scaled(states.counts, maximum)).output.argmax(axis=1)
    return float(np.mean(chosen == states.actions))


def class_shares(actions: NDArray[np.int64], classes: int) -> list[float]:
    """Return the share of each action among the labels (n,)."""
    shares: list[float] = (np.bincount(actions, minlength=classes) / len(actions)).tolist()
    return shares


class _Training:
    """The network in training: weights, Adam, and the states it is given."""

    def __init__(
        self,
        states: Labelled,
        maximum: int,
        outputs: int,
        parameters: TransferParameters,
        rng: np.random.Generator,
    ) -> None:
        import torch

        from spikelane_controllers.learning.adam import Adam

        self._torch = torch
        self._states, self._maximum = states, maximum
        self._parameters, self._rng = parameters, rng
        inputs, hidden = states.counts.shape[1], parameters.hidden
        self._weights = tuple(
            torch.tensor(each, requires_grad=True)
            for each in (
                _uniform((hidden, inputs), inputs, rng),
                _uniform((hidden,), inputs, rng),
                _uniform((outputs, hidden), hidden, rng),
            )
        )
        self._adam = Adam(self._weights)
        self._done = 0
        self._of_action = [np.flatnonzero(states.actions == each) for each in range(outputs)]

    def step(self) -> None:
        """Take one training step."""
        torch = self._torch
        rate = self._parameters.learning_rate
        if self._parameters.decays:
            rate *= (1 + math.cos(math.pi * self._done / self._parameters.steps)) / 2
        batch = _take(self._states, self._drawn())
        gain = np.float32(self._parameters.input_gain)
        inputs = torch.from_numpy(scaled(batch.counts, self._maximum) * gain)
        loss = torch.nn.functional.cross_entropy(self._outputs(inputs), self._aims(batch))
        self._adam.step(torch.autograd.grad(loss, self._weights), rate)
        self._done += 1

    def network(self) -> FeedForward:
        """Return a copy of the weights, for inputs without a gain."""
        weights, bias, output = (each.detach().numpy().copy() for each in self._weights)
        return FeedForward(weights * np.float32(self._parameters.input_gain), bias, output)

    def _outputs(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return the outputs before rectification, which would hide those below 0."""
        weights, bias, output_weights = self._weights
        linear = self._torch.nn.functional.linear
        return linear(linear(inputs, weights, bias).relu(), output_weights)

    def _aims(self, batch: Labelled) -> torch.Tensor:
        """Return what is to be learnt: actions (n,), or their probabilities (n, n_actions)."""
        temperature = self._parameters.temperature
        if not temperature or batch.values is None:
            return self._torch.from_numpy(batch.actions)
        values = self._torch.from_numpy(batch.values / np.float32(temperature))
        return self._torch.softmax(values, dim=1)

    def _drawn(self) -> NDArray[np.int64]:
        """Return the indices of a batch."""
        size = self._parameters.batch_size
        if not self._parameters.balanced:
            return self._rng.integers(len(self._states.actions), size=size)
        there = [indices for indices in self._of_action if len(indices)]
        chosen = self._rng.integers(len(there), size=size)
        places = self._rng.random(size)
        return np.array(
            [there[c][int(p * len(there[c]))] for c, p in zip(chosen, places, strict=True)]
        )


def _uniform(shape: tuple[int, ...], inputs: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Draw initial weights as PyTorch's linear layers do: within 1 / sqrt(inputs)."""
    bound = 1 / math.sqrt(inputs)
    return rng.uniform(-bound, bound, shape).astype(np.float32)


def _split(
    states: Labelled, parameters: TransferParameters, rng: np.random.Generator
) -> tuple[Labelled, Labelled]:
    """Return states for training and for measuring."""
    number = len(states.actions)
    is_whole = parameters.held_out_by == 'episode'
    wholes = states.episodes if is_whole else np.arange(number)
    values, sizes = np.unique(wholes, return_counts=True)
    order = rng.permutation(len(values))
    before = np.cumsum(sizes[order]) - sizes[order]
    held_out = np.isin(wholes, values[order[before < round(parameters.held_out * number)]])
    return _take(states, ~held_out), _take(states, held_out)


def _take(states: Labelled, chosen: NDArray[np.int64] | NDArray[np.bool_]) -> Labelled:
    """Return the states of these indices, or where it is true."""
    values = None if states.values is None else states.values[chosen]
    return Labelled(states.counts[chosen], states.actions[chosen], states.episodes[chosen], values)


def _check(train: Labelled, held_out: Labelled) -> None:
    if not len(train.actions) or not len(held_out.actions):
        raise TransferError('states: expected some to train with and some to measure with')
    if not train.counts.any():
        raise TransferError('states: expected events in them, got none')
    if len(np.unique(train.actions)) < 2:
        raise TransferError(
            f'states: expected several actions as labels, got {train.actions[0]} alone'
        )


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Let PyTorch compute in one thread: the order of sums, and so the bits, depend on it."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
