"""Deep Q-learning: the whole recipe (paper section 3.4), of actions and transitions alone.

1. Act: at random with the exploration rate, otherwise as the network values the actions.
2. Keep the transition (state, action, reward, next state) among the last `buffer_size`.
3. Every `update_every` actions, after `random_steps`: draw `batch_size` transitions and move the
   network towards reward + discount * value of the next state; then move the target network a
   little towards the network.

The next state's value is that of double DQN: the network picks the action, the target network
values it. The loss is the squared error, the optimiser Adam.

So small a network takes PyTorch more time to manage than to compute: therefore all weights lie in
one flat tensor, Adam and the soft update being one operation each, and the gradient is written
out. One thread computes, which is quickest here and gives the same bits each time.
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
import torch

from spikelane_controllers.dqn.experience_buffer import Batch, Replay
from spikelane_controllers.dqn.parameters import QLearningParameters
from spikelane_controllers.dqn.q_network import (
    greedy_action,
    network_views,
    QNetwork,
)
from spikelane_controllers.saved_state import array, gather, number, SavedState, spread
from spikelane_sim.errors import ParameterError


class QLearning:
    """A Q-network that learns.

    Attributes:
        steps: Transitions learnt from, one for each action.
        updates: Times the network was changed.
        loss: Loss of the last update, NaN before the first.
        network: What was learnt; not to be written to.
    """

    def __init__(self, parameters: QLearningParameters, network: QNetwork) -> None:
        """Begin with a network, which is copied.

        Raises:
            ParameterError: The device is not there.
        """
        if parameters.device == 'cuda' and not torch.cuda.is_available():
            raise ParameterError('q_learning.device: expected cpu, as there is no CUDA, got cuda')
        torch.set_num_threads(1)
        self._parameters = parameters
        self._shapes = [values.shape for values in network]
        self._n_actions = len(network.biases_3)
        self._replay = Replay(parameters.buffer_size, len(network.weights_1))
        self._weights = torch.zeros(sum(map(np.size, network)), device=parameters.device)
        self._weights.grad = torch.zeros_like(self._weights)
        self._target = torch.zeros_like(self._weights)
        self._layers = self._to_layers(self._weights)
        self._gradients = self._to_layers(self._weights.grad)
        self._target_layers = self._to_layers(self._target)
        self._adam = torch.optim.Adam([self._weights], parameters.learning_rate, fused=True)
        # Filled in place: where a tensor begins in memory may change the last bits.
        self._batch = _Batch.empty(parameters.batch_size, len(network.weights_1))
        self._set(network, network, np.zeros(len(self._weights)), np.zeros(len(self._weights)), 0)
        self.steps = 0
        self.loss = math.nan

    @property
    def exploration_rate(self) -> float:
        """Probability that the next action is random."""
        return self._parameters.exploration_rate(self.steps)

    def act(self, state: NDArray[np.uint8], rng: np.random.Generator) -> int:
        """Choose an action in a binary state (n_inputs,)."""
        if rng.random() < self.exploration_rate:
            return int(rng.integers(self._n_actions))
        return greedy_action(self.network, state)

    def learn(
        self,
        state: NDArray[np.uint8],
        action: int,
        reward: float,
        next_state: NDArray[np.uint8],
        rng: np.random.Generator,
        *,
        is_final: bool,
    ) -> None:
        """Take in a transition between binary states (n_inputs,), and update when it is time.

        Args:
            state: In which the action was chosen.
            action: The action.
            reward: What it brought.
            next_state: Where it led.
            rng: Draws the transitions for an update.
            is_final: Whether the task has failed there; not for an episode that is merely long.
        """
        self._replay.add(state, action, reward, next_state, is_final=is_final)
        self.steps += 1
        is_time = self.steps % self._parameters.update_every == 0
        if is_time and self.steps > self._parameters.random_steps:
            self._update(rng)

    def state(self) -> SavedState:
        """Return all that the next steps depend on, as arrays and numbers."""
        adam = self._adam.state[self._weights]
        return {
            **spread('network', self.network),
            **spread('target', self._to_network(self._target)),
            'adam.mean': adam['exp_avg'].cpu().numpy().copy(),
            'adam.square': adam['exp_avg_sq'].cpu().numpy().copy(),
            **self._replay.state(),
            'steps': self.steps,
            'updates': self.updates,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Become what `state` returned.

        Raises:
            CheckpointError: Something is missing, of another shape or kind, or not finite.
        """
        network = gather('network', self.network, state)
        target = gather('target', self.network, state)
        mean, square = (
            array(state, name, np.dtype(np.float32), (len(self._weights),))
            for name in ('adam.mean', 'adam.square')
        )
        steps, updates = number(state, 'steps', int), number(state, 'updates', int)
        self._replay.restore(state, steps)
        self._set(network, target, mean, square, updates)
        self.steps, self.loss = steps, math.nan

    def _update(self, rng: np.random.Generator) -> None:
        size = self._parameters.batch_size
        batch = self._batch.filled(self._replay.sample(size, rng)).to(self._parameters.device)
        # Means of gradients that have vanished become so small that they cost ten times the time.
        torch.set_flush_denormal(True)
        with torch.no_grad():
            outputs = _forward(self._layers, batch.states)  # of states, then of next states
            best = outputs[-1][size:].argmax(dim=1, keepdim=True)
            worth = _forward(self._target_layers, batch.states[size:])[-1].gather(1, best)
            aims = batch.rewards + self._parameters.discount * worth * batch.goes_on
            errors = outputs[-1][:size].gather(1, batch.actions) - aims
            self._set_gradients([batch.states, *outputs], batch.actions, errors)
            self._adam.step()
            self._target.lerp_(self._weights, self._parameters.soft_update)
        torch.set_flush_denormal(False)
        self.loss = errors.square().mean().item()
        self.updates += 1
        self._show()

    def _set_gradients(
        self, values: list[torch.Tensor], actions: torch.Tensor, errors: torch.Tensor
    ) -> None:
        """Set the gradients of the mean squared error.

        Args:
            values: Inputs and outputs of all layers, in the first rows of the batch's states.
            actions: Whose values are in error, (n, 1).
            errors: By how much, (n, 1).
        """
        size = len(errors)
        # Slopes of the error over a layer's outputs before rectification; last layer first.
        slopes = torch.zeros_like(values[-1][:size]).scatter_(1, actions, errors * (2 / size))
        for inputs, weights, by_weights, by_biases in zip(
            values[-2::-1],
            self._layers[-2::-2],
            self._gradients[-2::-2],
            self._gradients[::-2],
            strict=True,
        ):
            torch.mm(inputs[:size].t(), slopes, out=by_weights)
            torch.sum(slopes, 0, out=by_biases)
            if inputs is not values[0]:
                slopes = torch.mm(slopes, weights.t()).mul_(inputs[:size] > 0)

    def _set(
        self,
        network: QNetwork,
        target: QNetwork,
        mean: NDArray[np.floating],
        square: NDArray[np.floating],
        updates: int,
    ) -> None:
        """Take over copies of the networks and of Adam's state."""
        with torch.no_grad():
            for tensor, values in ((self._weights, network), (self._target, target)):
                tensor.copy_(torch.tensor(np.concatenate([part.ravel() for part in values])))
        self._adam.state[self._weights] = {
            'step': torch.tensor(float(updates), device=self._parameters.device),
            'exp_avg': torch.zeros_like(self._weights).copy_(torch.tensor(mean)),
            'exp_avg_sq': torch.zeros_like(self._weights).copy_(torch.tensor(square)),
        }
        self.updates = updates
        self._show()

    def _show(self) -> None:
        """Let `network` be what the weights are; on the CPU it always is, in the same memory."""
        if self._parameters.device != 'cpu' or not self.updates:
            self.network = self._to_network(self._weights)

    def _to_network(self, flat: torch.Tensor) -> QNetwork:
        return network_views(flat.cpu().numpy(), self._shapes)

    def _to_layers(self, flat: torch.Tensor) -> list[torch.Tensor]:
        parts = torch.split(flat, [math.prod(shape) for shape in self._shapes])
        return [part.view(shape) for part, shape in zip(parts, self._shapes, strict=True)]


class _Batch(NamedTuple):
    """Transitions as tensors, n of them."""

    states: torch.Tensor  # before, then after them, (2 n, n_inputs)
    actions: torch.Tensor  # (n, 1)
    rewards: torch.Tensor  # (n, 1)
    goes_on: torch.Tensor  # 0 where nothing is to be gained after them, else 1, (n, 1)

    @classmethod
    def empty(cls, size: int, n_inputs: int) -> _Batch:
        """Return a batch to be filled."""
        return cls(
            torch.empty(2 * size, n_inputs),
            torch.empty(size, 1, dtype=torch.int64),
            torch.empty(size, 1),
            torch.empty(size, 1),
        )

    def filled(self, batch: Batch) -> _Batch:
        """Return itself, filled."""
        states, size = self.states.numpy(), len(batch.actions)
        states[:size], states[size:] = batch.states, batch.next_states
        self.actions.numpy()[:, 0] = batch.actions
        self.rewards.numpy()[:, 0] = batch.rewards
        self.goes_on.numpy()[:, 0] = ~batch.is_final
        return self

    def to(self, device: str) -> _Batch:
        """Return it on a device."""
        return self if device == 'cpu' else _Batch(*(each.to(device) for each in self))


def _forward(layers: list[torch.Tensor], states: torch.Tensor) -> list[torch.Tensor]:
    """Return the outputs of all layers, those of the last one the actions' values."""
    weights_1, biases_1, weights_2, biases_2, weights_3, biases_3 = layers
    first = torch.addmm(biases_1, states, weights_1).relu_()
    second = torch.addmm(biases_2, first, weights_2).relu_()
    return [first, second, torch.addmm(biases_3, second, weights_3)]
