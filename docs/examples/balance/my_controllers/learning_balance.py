"""The same controller, which learns what it lacks to stay in the middle of its lane."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from my_controllers.balance import Balance, BalanceParameters
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.learning.training import controller_state
from spikelane_controllers.saved_state import array, number, SavedState
from spikelane_sim.contract import Observation
from spikelane_sim.parameters import parameter


@dataclasses.dataclass(frozen=True, kw_only=True)
class LearningBalanceParameters(BalanceParameters):
    """Those of the other, and the two that a controller must have to be trained."""

    learning: bool = parameter(False, 'Change the offset while driving.')
    checkpoint: str = parameter(
        '', 'Folder of a training, or a checkpoint; empty: begin with nothing learnt.'
    )
    rate: float = parameter(
        0.001, 'Change of the offset in each step, per metre of distance.', unit='rad/(s m)'
    )


class LearningBalance(Balance):
    """Adds an offset to the turn; see `learning_controller.LearningController`."""

    parameters_class: ClassVar[type[LearningBalanceParameters]] = LearningBalanceParameters
    parameters: LearningBalanceParameters

    def __init__(self, parameters: LearningBalanceParameters | None = None) -> None:
        super().__init__(parameters or LearningBalanceParameters())
        self.learning = self.parameters.learning
        self.initialise(np.random.default_rng(0))

    def initialise(self, rng: np.random.Generator) -> None:
        """Forget all but the checkpoint; what is drawn at random comes from rng."""
        del rng
        self._offset = 0.0
        if name := self.parameters.checkpoint:
            learnt = controller_state(read_checkpoint(Path(name), 'learning_balance'))
            self._offset = number(learnt, 'offset', float)

    def state(self) -> SavedState:
        """Return all that the next steps depend on: arrays, and finite numbers."""
        return {'offset': self._offset, 'sides': self._sides.copy(), 'learning': self.learning}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Become what `state` returned, bit for bit."""
        self._offset = number(state, 'offset', float)
        self._sides = array(state, 'sides', np.dtype(np.float64), (2,))
        self.learning = number(state, 'learning', bool)

    def _turn(self, observation: Observation) -> float:
        if self.learning and observation.lane is not None:  # right of the middle is positive
            self._offset -= self.parameters.rate * observation.lane.distance_m
        return super()._turn(observation) + self._offset
