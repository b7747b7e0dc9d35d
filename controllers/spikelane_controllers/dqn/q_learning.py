"""Deep Q-learning: the whole recipe (paper section 3.4), of actions and transitions alone.

1. Act: at random with the exploration rate, otherwise as the network values the actions.
2. Keep the transition (state, action, reward, next state) among the last `buffer_size`.
3. Every `update_every` actions, after `random_steps`: draw `batch_size` transitions and move the
   network towards reward + discount * value of the next state; then move the target network a
   little towards the network.

The next state's value is that of double DQN: the network picks the action, the target network
values it. The loss is the squared error, the optimiser Adam.

`QLearning` computes the update with Numba (`update_kernel.py`), which is the default.
`TorchQLearning` in `torch_q_learning.py` computes it with PyTorch: it is the reference, and can
use CUDA. Both have the same states and draw the same transitions. They add in different orders, so
that their weights differ by rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.dqn.experience_buffer import Replay
from spikelane_controllers.dqn.parameters import QLearningParameters
from spikelane_controllers.dqn.q_network import (
    flat_weights,
    greedy_action,
    network_views,
    QNetwork,
)
from spikelane_controllers.dqn.update_kernel import (
    find_moving,
    Learnt,
    make_learnt,
    Rates,
    shape_of,
    update,
)
from spikelane_controllers.saved_state import array, gather, number, SavedState, spread

Flat = NDArray[np.float32]


def rates_of(parameters: QLearningParameters) -> Rates:
    """Return what an update needs of the parameters."""
    return Rates(
        np.float32(parameters.discount),
        parameters.learning_rate,
        np.float32(parameters.soft_update),
    )


class QLearning:
    """A Q-network that learns, with Numba.

    Attributes:
        steps: Transitions learnt from, one for each action.
        updates: Times the network was changed.
        loss: Loss of the last update, NaN before the first.
        network: What was learnt; not to be written to.
        replay: Its experience.
        learnt: What the compiled update changes; None where another one learns.
    """

    def __init__(self, parameters: QLearningParameters, network: QNetwork) -> None:
        """Begin with a network, which is copied."""
        self._parameters = parameters
        self._shapes = [values.shape for values in network]
        self._n_actions = len(network.biases_3)
        self.replay = Replay(parameters.buffer_size, len(network.weights_1))
        self.steps = 0
        self.updates = 0
        self.loss = math.nan
        self.learnt: Learnt | None = None
        self._begin(network)

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
        self.replay.add(state, action, reward, next_state, is_final=is_final)
        self.steps += 1
        is_time = self.steps % self._parameters.update_every == 0
        if is_time and self.steps > self._parameters.random_steps:
            self.update(rng)

    def update(self, rng: np.random.Generator) -> None:
        """Change the network by transitions that are drawn from what is kept."""
        self.loss = self._update(rng)
        self.updates += 1

    @property
    def weights(self) -> Flat:
        """All weights and biases in one array, which is not to be written to."""
        return self._arrays()[0]

    def state(self) -> SavedState:
        """Return all that the next steps depend on, as arrays and numbers."""
        weights, target, mean, square = (each.copy() for each in self._arrays())
        return {
            **spread('network', network_views(weights, self._shapes)),
            **spread('target', network_views(target, self._shapes)),
            'adam.mean': mean,
            'adam.square': square,
            **self.replay.state(),
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
            array(state, name, np.dtype(np.float32), (self._n_weights,))
            for name in ('adam.mean', 'adam.square')
        )
        steps, updates = number(state, 'steps', int), number(state, 'updates', int)
        self.replay.restore(state, steps)
        self.steps, self.updates, self.loss = steps, updates, math.nan
        self._set(flat_weights(network), flat_weights(target), mean, square)

    def go_on(self, steps: int, updates: int, loss: float) -> None:
        """Note what a kernel has added to `replay` and changed of `learnt`.

        Args:
            steps: As the attribute.
            updates: As the attribute.
            loss: As the attribute.
        """
        self.steps = self.replay.added = steps
        self.updates, self.loss = updates, loss

    @property
    def _n_weights(self) -> int:
        return sum(map(math.prod, self._shapes))

    def _begin(self, network: QNetwork) -> None:
        """Make what learns, and begin with a network."""
        self._shape = shape_of(network)
        self.learnt = learnt = make_learnt(self._n_weights, self._shape.n_inputs)
        self._rates = rates_of(self._parameters)
        self.network = network_views(learnt.weights, self._shapes)
        none = np.zeros(self._n_weights, np.float32)
        self._set(flat_weights(network), flat_weights(network), none, none)

    def _update(self, rng: np.random.Generator) -> float:
        """Change the network by transitions that are drawn; return the loss before."""
        drawn = self.replay.draw(self._parameters.batch_size, rng)
        kept = self.replay.transitions
        assert self.learnt is not None
        return float(update(self.learnt, self._shape, self._rates, kept, drawn, self.updates))

    def _arrays(self) -> tuple[Flat, Flat, Flat, Flat]:
        """Return weights, those of the target network, and Adam's mean and square."""
        learnt = self.learnt
        assert learnt is not None
        return learnt.weights, learnt.target, learnt.mean, learnt.square

    def _set(self, weights: Flat, target: Flat, mean: Flat, square: Flat) -> None:
        """Take over copies of what `_arrays` returns."""
        for own, given in zip(self._arrays(), (weights, target, mean, square), strict=True):
            own[:] = given
        if self.learnt is not None:
            find_moving(self.learnt, self._shape)
