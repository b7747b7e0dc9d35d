"""Deep Q-learning: the whole recipe (paper section 3.4), of actions and transitions alone.

1. Act: at random with the exploration rate, otherwise as the network values the actions.
2. Keep the transition (state, action, reward, next state) among the last `buffer_size`.
3. Every `update_every` actions, after `random_steps`: draw `batch_size` transitions and move the
   network towards reward + discount * value of the next state; then move the target network a
   little towards the network.

The next state's value is that of double DQN: the network picks the action, the target network
values it. The loss is the squared error, the optimiser Adam.

All weights lie in one flat tensor, so that Adam and the soft update are one operation each. One
thread computes, which is quickest for so small a network and gives the same bits each time.
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
import torch

from spikelane_controllers.dqn_parameters import QLearningParameters
from spikelane_controllers.q_network import (
    greedy_action,
    network_views,
    QNetwork,
)
from spikelane_controllers.replay import Replay
from spikelane_controllers.state import array, gather, number, spread, State
from spikelane_sim.errors import ParameterError


class QLearning:
    """A Q-network that learns.

    Attributes:
        steps: Transitions learnt from, one for each action.
        updates: Times the network was changed.
        loss: Of the last update, NaN before the first.
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
        self._target = torch.zeros_like(self._weights)
        self._weights.grad = torch.zeros_like(self._weights)
        self._layers = self._views(self._weights)
        for layer, gradient in zip(self._layers, self._views(self._weights.grad), strict=True):
            layer.requires_grad_().grad = gradient
        self._target_layers = self._views(self._target)
        self._adam = torch.optim.Adam([self._weights], parameters.learning_rate, fused=True)
        # Filled in place: where a tensor begins in memory may change the last bits.
        shape = (parameters.batch_size, len(network.weights_1))
        self._states, self._next_states = torch.empty(shape), torch.empty(shape)
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
            rng: Of the transitions drawn for an update.
            is_final: Whether the task has failed there; not for an episode that is merely long.
        """
        self._replay.add(state, action, reward, next_state, is_final=is_final)
        self.steps += 1
        is_time = self.steps % self._parameters.update_every == 0
        if is_time and self.steps > self._parameters.random_steps:
            self._update(rng)

    def state(self) -> State:
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
        batch = self._replay.sample(self._parameters.batch_size, rng)
        self._states.numpy()[:] = batch.states
        self._next_states.numpy()[:] = batch.next_states
        device = self._parameters.device
        states, next_states = self._states.to(device), self._next_states.to(device)
        actions = torch.tensor(batch.actions, device=device)[:, None]
        rewards = torch.tensor(batch.rewards, device=device)[:, None]
        goes_on = torch.tensor(~batch.is_final, device=device)[:, None]

        with torch.no_grad():
            best = _values(self._layers, next_states).argmax(dim=1, keepdim=True)
            worth = _values(self._target_layers, next_states).gather(1, best)
            aims = rewards + self._parameters.discount * worth * goes_on
        values = _values(self._layers, states).gather(1, actions)
        loss = torch.nn.functional.mse_loss(values, aims)
        self._adam.zero_grad(set_to_none=False)
        # Means of gradients that have vanished become so small that they cost ten times the time.
        torch.set_flush_denormal(True)
        loss.backward()  # type: ignore[no-untyped-call]
        self._adam.step()
        with torch.no_grad():
            self._target.lerp_(self._weights, self._parameters.soft_update)
        torch.set_flush_denormal(False)
        self.loss = loss.item()
        self.updates += 1
        self._show()

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
        """Let `network` be what the weights are; on the CPU they are the same memory."""
        self.network = self._to_network(self._weights)

    def _to_network(self, flat: torch.Tensor) -> QNetwork:
        return network_views(flat.detach().cpu().numpy(), self._shapes)

    def _views(self, flat: torch.Tensor) -> list[torch.Tensor]:
        parts = torch.split(flat, [math.prod(shape) for shape in self._shapes])
        return [part.view(shape) for part, shape in zip(parts, self._shapes, strict=True)]


def _values(layers: list[torch.Tensor], states: torch.Tensor) -> torch.Tensor:
    """Return the values of all actions, (n, n_actions), in states (n, n_inputs)."""
    weights_1, biases_1, weights_2, biases_2, weights_3, biases_3 = layers
    first = torch.addmm(biases_1, states, weights_1).relu()
    second = torch.addmm(biases_2, first, weights_2).relu()
    return torch.addmm(biases_3, second, weights_3)
