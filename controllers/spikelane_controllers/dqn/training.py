"""Training of the deep Q-network: counts actions, and keeps what was gained and seen.

The folder of the checkpoint also has `states.zst`, all states met (`visited_states.py`). It is
written just before each checkpoint, so that it never has fewer than the checkpoint needs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any, cast, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.checkpoint import Checkpoint, read_checkpoint
from spikelane_controllers.dqn.controller import Dqn, EndedAction
from spikelane_controllers.dqn.visited_states import NAME, StateStore
from spikelane_controllers.learning.learning_controller import LearningController
from spikelane_controllers.learning.training import Training, TrainingParameters
from spikelane_controllers.saved_state import number, records
from spikelane_sim.contract import LaneState
from spikelane_sim.errors import CheckpointError, SpikelaneError
from spikelane_sim.parameters import MOST_STEPS, parameter

_RECENT_EPISODES = 100  # that Stable-Baselines3 takes means over


@dataclass(frozen=True, kw_only=True)
class DqnTrainingParameters(TrainingParameters):
    """How long a training of the deep Q-network takes and how often it is saved."""

    steps: int = parameter(100_000, 'Action steps of the training.', low=1, high=MOST_STEPS)
    save_every: int = parameter(
        1000,
        'Action steps between two checkpoints; a killed training loses at most these.',
        low=1,
        high=MOST_STEPS,
    )


class Outcome(NamedTuple):
    """What an episode brought."""

    actions: int
    reward: float  # sum over the actions
    exploration_rate: float  # at its end
    loss: float | None  # mean over its updates, None where there were none
    updates: int  # of the whole training, at its end


class _Present(NamedTuple):
    """What the present episode has brought so far."""

    actions: int
    reward: float
    loss: float  # sum over its updates
    updates_before: int


class DqnTraining(Training):
    """A deep Q-network in training; steps are those of actions.

    Attributes:
        controller: What learns.
        outcomes: Outcomes of all episodes, as `terminations`.
    """

    parameters_class: ClassVar[type[TrainingParameters]] = DqnTrainingParameters
    #: PyTorch alone computed updates, before there was a choice.
    former_values: ClassVar[Mapping[str, Any]] = {'q_learning.backend': 'torch'}

    def __init__(
        self,
        name: str,
        controller: LearningController,
        parameters: TrainingParameters,
        config: Mapping[str, Any],
        checkpoint: Path,
    ) -> None:
        """Prepare a training; see `Training`."""
        super().__init__(name, controller, parameters, config, checkpoint)
        self.controller: Dqn = cast(Dqn, controller)
        self.outcomes: list[Outcome] = []
        image = self.controller.parameters.image
        self._store = StateStore(checkpoint.with_name(NAME), (image.rows, image.columns))

    def steps_after(self, observations: int) -> int:
        """Return about how many steps there will be after so many observations more."""
        return self.steps + observations // self.controller.steps_per_action

    @property
    def observations_left(self) -> int:
        """About how many observations there are until the training is done."""
        return super().observations_left * self.controller.steps_per_action

    @property
    def observations_to_take(self) -> int:
        """How many observations there are until the next checkpoint, or until all is driven."""
        actions = 0 if self._is_due else self._steps_to_take
        # The answer to the observation that ends an action is the next action.
        return actions * self.controller.steps_per_action - self.controller.held

    def scalars(self) -> dict[str, float]:
        """Return what can be plotted of the last episodes, under Stable-Baselines3's names."""
        recent, last = self.outcomes[-_RECENT_EPISODES:], self.outcomes[-1]
        scalars = {
            'rollout/ep_len_mean': sum(each.actions for each in recent) / len(recent),
            'rollout/ep_rew_mean': sum(each.reward for each in recent) / len(recent),
            'rollout/exploration_rate': last.exploration_rate,
            'train/learning_rate': self.controller.parameters.q_learning.learning_rate,
            'train/n_updates': last.updates,
        }
        return scalars if last.loss is None else {**scalars, 'train/loss': last.loss}

    def _begin_episode(self) -> None:
        self._actions = 0
        self._reward = 0.0
        self._loss = 0.0  # sum over the updates
        self._updates_before = self._updates = self.controller.learner.updates

    def _counts(self, lane: LaneState) -> bool:
        """Return whether an action has ended, and add it to the records.

        Raises:
            SpikelaneError: The network has diverged.
        """
        del lane
        if self.controller.actions == self.steps:
            return False
        self._add(self.controller.ended_action)
        return True

    def _take_in(self, answered: int, taken_in: Sequence[EndedAction]) -> int:
        """Add the actions that have ended to the records, and return how many there are.

        Raises:
            SpikelaneError: The network has diverged.
        """
        del answered
        for action in taken_in:
            self._add(action)
        return len(taken_in)

    def _add(self, action: EndedAction) -> None:
        """Add an action that has ended to the records."""
        self._actions += 1
        self._reward += action.reward
        if action.updates > self._updates:
            self._updates = action.updates
            self._loss += action.loss
            if not math.isfinite(action.loss):
                raise SpikelaneError(
                    f'the loss is {action.loss} after {action.updates} updates: expected a '
                    f'q_learning.learning_rate that is small enough, got '
                    f'{self.controller.parameters.q_learning.learning_rate:g}'
                )
        self._store.append(action.counts)

    def _begin_records(self) -> None:
        self._begin_episode()
        self._store.begin()

    def _record_episode(self) -> None:
        updates = self._updates - self._updates_before
        self.outcomes.append(
            Outcome(
                self._actions,
                self._reward,
                self.controller.learner.exploration_rate,
                self._loss / updates if updates else None,
                self._updates,
            )
        )
        self._begin_episode()

    def _records(self) -> Checkpoint:
        self._store.flush()
        facts = {
            'outcomes': [list(each) for each in self.outcomes],
            'present': [self._actions, self._reward, self._loss, self._updates_before],
        }
        return Checkpoint({}, facts)

    def _restore_records(self, checkpoint: Checkpoint) -> None:
        facts = checkpoint.facts
        self._store.resume(number(facts, 'steps', int))
        self.outcomes = records(facts, 'outcomes', Outcome)
        self._updates = self.controller.learner.updates
        [present] = records({'present': [facts.get('present')]}, 'present', _Present)
        self._actions, self._reward, self._loss, self._updates_before = present


def visited_episodes(checkpoint: Path, states: int) -> NDArray[np.int64]:
    """Return the number of the episode that each state of a training was met in, (states,).

    Args:
        checkpoint: The training's folder, or its checkpoint.
        states: How many states there are.

    Raises:
        CheckpointError: The checkpoint cannot be read, or its episodes have more states.
    """
    facts = read_checkpoint(checkpoint, 'dqn').facts
    lengths = [each.actions for each in records(facts, 'outcomes', Outcome)]
    if min(lengths, default=0) < 0 or sum(lengths) > states:
        raise CheckpointError(
            f'{checkpoint}: expected at least {sum(lengths)} states, got {states}'
        )
    return np.repeat(np.arange(len(lengths) + 1), [*lengths, states - sum(lengths)])
