"""The deep Q-network controller: events of ten steps to one of three actions (section 3).

At an episode's first observation and then every `task.steps_per_action` times 50 ms the counts of
the last events, taken as binary, are the state; an action is chosen and its wheel velocities
are held. While it learns it also explores: see `q_learning.py` for the recipe.
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.dqn.learnt_network import (
    Q_NETWORK,
    read_network,
    TARGET_NETWORK,
)
from spikelane_controllers.dqn.parameters import DqnParameters
from spikelane_controllers.dqn.pytorch import require_pytorch
from spikelane_controllers.dqn.q_learning import QLearning
from spikelane_controllers.dqn.q_network import (
    decision_operations,
    greedy_action,
    initial_network,
    QNetwork,
)
from spikelane_controllers.operations import Operations
from spikelane_controllers.saved_state import (
    array,
    check_names,
    gather,
    gather_generator,
    number,
    SavedState,
    spread,
    spread_generator,
)
from spikelane_controllers.shown import Shown
from spikelane_sim.contract import LaneState, Observation, TERMINATED_LANE_LOST, WheelVelocities
from spikelane_sim.encoding import Counts, StateImage
from spikelane_sim.errors import CheckpointError
from spikelane_sim.task import action_wheels, ACTIONS, lane_centre_reward


class EndedAction(NamedTuple):
    """What an action brought, for the records of a training."""

    reward: float
    updates: int  # in all
    loss: float  # of the last update
    counts: NDArray[np.integer[Any]]  # events in the state that it led to, (rows, columns)


class Dqn:
    """Controller that acts by a Q-network; see `contract.Controller`.

    It is made with the weights of its checkpoint; where it has none, they are drawn from seed 0,
    and `initialise` draws others. `restore` continues from a state.

    Attributes:
        learning: Whether it explores and learns.
        action: Held at present, an index of `task.ACTIONS`.
        reward: Reward of the last action that ended, NaN where none has or the distance is not
            known.
        actions: Actions that have ended since the weights were initialised.
        operations: Operations of the last step: none while an action is held.
        counts: Events that the last state was made of, (rows, columns).
        inputs: That state, (n_inputs,).
        held: Steps since the action was chosen, -1 before an episode's first.
        image: Events of the last steps.
        steps_per_action: How many steps of the control period an action holds.
        rng: Draws actions and transitions.
    """

    parameters_class: ClassVar[type[DqnParameters]] = DqnParameters

    def __init__(self, parameters: DqnParameters | None = None) -> None:
        """Make a controller.

        Raises:
            SpikelaneError: Its weights cannot be read, are not of such a network, or the device
                is not there.
        """
        self.parameters = parameters or DqnParameters()
        self.learning = self.parameters.learning
        image, task = self.parameters.image, self.parameters.task
        self.image = StateImage(image, self.parameters.steps_of(image.frames, image.frame_ms))
        self.steps_per_action = self.parameters.steps_of(task.steps_per_action, task.step_ms)
        self._trained = self._trained_network()
        self.initialise(np.random.default_rng(0))
        self.reset(np.random.default_rng(0))

    @property
    def network(self) -> QNetwork:
        """The network that acts; not to be written to."""
        return self._network if self._learner is None else self._learner.network

    @property
    def is_learning(self) -> bool:
        """Whether there is a learner."""
        return self._learner is not None

    @property
    def ended_action(self) -> EndedAction:
        """The last action that ended while it was learning."""
        learner = self.learner
        return EndedAction(self.reward, learner.updates, learner.loss, self.counts)

    @property
    def learner(self) -> QLearning:
        """What learns; only while `learning`."""
        assert self._learner is not None
        return self._learner

    def initialise(self, rng: np.random.Generator) -> None:
        """Forget all: the checkpoint's weights or drawn from rng, no transitions."""
        n_inputs = self.parameters.image.rows * self.parameters.image.columns
        self._network = self._trained or initial_network(
            rng, n_inputs, len(ACTIONS), self.parameters.network
        )
        self._learner = self._make_learner() if self.learning else None
        self.actions = 0

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode: a state of zeros; what was learnt lives on."""
        self.rng = rng
        self.image.clear()
        self.counts: Counts = self.image.counts
        self.inputs: NDArray[np.uint8] = self.image.binary.ravel()
        self.operations = Operations()
        self.held = -1
        self.action = ACTIONS.index('straight')
        self.reward = math.nan

    @property
    def shown(self) -> Shown:
        """What is shown of the last step."""
        return Shown(
            action=self.action,
            reward=self.reward,
            operations=self.operations,
        )

    def step(self, observation: Observation) -> WheelVelocities:
        """Answer one observation; the action that ends with it is learnt from."""
        lane = observation.lane
        is_over = lane is not None and lane.terminated
        self.held += 1
        self.operations = Operations()
        if self.held:  # an episode's first observation is before anything was done
            self.image.add(observation.events)
            if self.held == self.steps_per_action or is_over:
                self._end_action(lane)
        if not self.held and not is_over:
            self.action = self._choose()
            self.operations = decision_operations(self.network, self.inputs)
        return action_wheels(self.action, self.parameters.task)

    def state(self) -> SavedState:
        """Return all that the next steps depend on, as arrays and finite numbers.

        `restore` takes it, also in another controller with the same parameters, and the steps
        that follow are the same, bit for bit.
        """
        learner = self._learner
        own = spread('network', self._network) if learner is None else learner.state()
        return {
            **own,
            **spread_generator('rng', self.rng),
            'image.frames': self.image.frames,
            'held': self.held,
            'action': self.action,
            'actions': self.actions,
            'state': np.packbits(self.inputs),
            'learning': self.learning,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state.

        Raises:
            CheckpointError: It is not one of this controller with these parameters.
        """
        like = self.state()
        check_names(state, like)
        frames = array(state, 'image.frames', np.dtype(np.int64), like['image.frames'].shape)
        packed = array(state, 'state', np.dtype(np.uint8), like['state'].shape)
        rng = gather_generator('rng', state)
        held, actions = number(state, 'held', int), number(state, 'actions', int)
        action = number(state, 'action', int)
        if not 0 <= action < len(ACTIONS):
            raise CheckpointError(f'action: expected 0 to {len(ACTIONS) - 1}, got {action}')
        if number(state, 'learning', bool) != self.learning:
            raise CheckpointError(f'learning: expected {self.learning}, got {not self.learning}')
        if self._learner is None:
            self._network = gather('network', self._network, state)
        else:
            self._learner.restore(state)
        self.rng, self.held, self.action, self.actions = rng, held, action, actions
        self.image.frames = frames
        self.inputs = np.unpackbits(packed, count=self.inputs.size)
        self.counts = self.image.counts
        self.reward = math.nan

    def _choose(self) -> int:
        if self._learner is None:
            return greedy_action(self._network, self.inputs)
        return self._learner.act(self.inputs, self.rng)

    def _end_action(self, lane: LaneState | None) -> None:
        """Observe what the action led to, and learn from it."""
        before = self.inputs
        self.held = 0
        self.actions += 1
        self.counts = self.image.counts
        self.inputs = (self.counts > 0).astype(np.uint8).ravel()
        self.reward = math.nan
        if lane is None:
            return
        self.reward = lane_centre_reward(lane.distance_m, self.parameters.task.reward_sigma_m)
        if self._learner is not None:
            is_lost = lane.reason == TERMINATED_LANE_LOST
            self._learner.learn(
                before, self.action, self.reward, self.inputs, self.rng, is_final=is_lost
            )

    def _make_learner(self) -> QLearning:
        parameters = self.parameters.q_learning
        if not parameters.needs_pytorch:
            return QLearning(parameters, self._network)
        require_pytorch()
        # Here and not above: nothing else must wait for torch.
        from spikelane_controllers.dqn.torch_q_learning import TorchQLearning

        return TorchQLearning(parameters, self._network)

    def _trained_network(self) -> QNetwork | None:
        name = self.parameters.checkpoint
        if not name:
            return None
        image = self.parameters.image
        like = initial_network(
            np.random.default_rng(0),
            image.rows * image.columns,
            len(ACTIONS),
            self.parameters.network,
        )
        parts = TARGET_NETWORK if self.parameters.averaged else Q_NETWORK
        return read_network('dqn', name, like, parts)
