"""Deep Q-learning with PyTorch: the reference for the compiled update, and the way to CUDA.

So small a network takes PyTorch more time to manage than to compute: therefore all weights lie in
one flat tensor, Adam and the soft update being one operation each, and the gradient is written
out. One thread computes, which is quickest here and gives the same bits each time.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch

from spikelane_controllers.dqn.experience_buffer import Batch
from spikelane_controllers.dqn.q_learning import Flat, QLearning
from spikelane_controllers.dqn.q_network import network_views, QNetwork
from spikelane_controllers.learning.adam import Adam
from spikelane_sim.errors import ParameterError


class TorchQLearning(QLearning):
    """A Q-network that learns with PyTorch; see `QLearning`."""

    def _begin(self, network: QNetwork) -> None:
        """Make tensors, and begin with a network.

        Raises:
            ParameterError: The device is not there.
        """
        parameters = self._parameters
        if parameters.device == 'cuda' and not torch.cuda.is_available():
            raise ParameterError('q_learning.device: expected cpu, as there is no CUDA, got cuda')
        torch.set_num_threads(1)
        self._weights = torch.zeros(self._n_weights, device=parameters.device)
        self._gradient = torch.zeros_like(self._weights)
        self._target = torch.zeros_like(self._weights)
        self._layers = self._to_layers(self._weights)
        self._gradients = self._to_layers(self._gradient)
        self._target_layers = self._to_layers(self._target)
        self._adam = Adam([self._weights])
        # Filled in place: where a tensor begins in memory may change the last bits.
        self._batch = _Batch.empty(parameters.batch_size, len(network.weights_1))
        weights = np.concatenate([part.ravel() for part in network])
        self._set(weights, weights, np.zeros_like(weights), np.zeros_like(weights))

    def _update(self, rng: np.random.Generator) -> float:
        size = self._parameters.batch_size
        batch = self._batch.filled(self.replay.sample(size, rng)).to(self._parameters.device)
        # Means of gradients that have vanished become so small that they cost ten times the time.
        torch.set_flush_denormal(True)
        with torch.no_grad():
            outputs = _forward(self._layers, batch.states)  # of states, then of next states
            best = outputs[-1][size:].argmax(dim=1, keepdim=True)
            worth = _forward(self._target_layers, batch.states[size:])[-1].gather(1, best)
            aims = batch.rewards + self._parameters.discount * worth * batch.goes_on
            errors = outputs[-1][:size].gather(1, batch.actions) - aims
            self._set_gradients([batch.states, *outputs], batch.actions, errors)
            self._adam.step([self._gradient], self._parameters.learning_rate)
            self._target.lerp_(self._weights, self._parameters.soft_update)
        torch.set_flush_denormal(False)
        self._show()
        return errors.square().mean().item()

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

    def _arrays(self) -> tuple[Flat, Flat, Flat, Flat]:
        (mean,), (square,) = self._adam.means, self._adam.squares
        tensors = self._weights, self._target, mean, square
        weights, target, *moments = (each.cpu().numpy() for each in tensors)
        return weights, target, moments[0], moments[1]

    def _set(self, weights: Flat, target: Flat, mean: Flat, square: Flat) -> None:
        with torch.no_grad():
            self._weights.copy_(torch.tensor(weights))
            self._target.copy_(torch.tensor(target))
            self._adam.means[0].copy_(torch.tensor(mean))
            self._adam.squares[0].copy_(torch.tensor(square))
        self._adam.set_steps(self.updates)
        self._show()

    def _show(self) -> None:
        """Let `network` be what the weights are; on the CPU it always is, in the same memory."""
        if self._parameters.device != 'cpu' or not self.updates:
            self.network = network_views(self._arrays()[0], self._shapes)

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
