"""The training of R-STDP: every step of 50 ms counts, and the weights are watched."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.checkpoint import Checkpoint
from spikelane_controllers.learning.learning_controller import LearningController
from spikelane_controllers.learning.training import Training


class PlasticController(LearningController, Protocol):
    """A controller whose weights are few enough to be watched."""

    @property
    def weights_pa(self) -> NDArray[np.float64]:
        """Weights [pA], (n_neurons, n_inputs)."""


class PlasticTraining(Training):
    """A training of few weights.

    Attributes:
        controller: What learns.
        weight_history: Weights every `save_every` steps, from step 0, each (n_neurons, n_inputs).
    """

    controller: PlasticController
    weight_history: list[NDArray[np.float32]]

    @property
    def weights_pa(self) -> NDArray[np.float64]:
        """Weights now [pA], (n_neurons, n_inputs)."""
        return self.controller.weights_pa

    @property
    def save_every(self) -> int:
        """Steps between the weights of the history."""
        return self._parameters.save_every

    def _begin_records(self) -> None:
        self.weight_history = []
        self._record_step()

    def _record_step(self) -> None:
        self.weight_history.append(self.controller.weights_pa.astype(np.float32))

    def _records(self) -> Checkpoint:
        return Checkpoint({'training.weight_history': np.stack(self.weight_history)}, {})

    def _restore_records(self, checkpoint: Checkpoint) -> None:
        self.weight_history = list(checkpoint.arrays['training.weight_history'])
