"""What the figures of trainings are drawn of: a training that runs, or what one has left."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from numpy.typing import NDArray

from spikelane_controllers.dqn_training import Outcome
from spikelane_controllers.training import Termination


class Past(Protocol):
    """The past of any training."""

    @property
    def steps(self) -> int:
        """Driven, as the controller's training counts them."""

    @property
    def terminations(self) -> Sequence[Termination]:
        """Terminations of all episodes."""


class DqnPast(Past, Protocol):
    """The past of a deep Q-network."""

    @property
    def outcomes(self) -> Sequence[Outcome]:
        """Outcomes of all episodes."""


class PlasticPast(Past, Protocol):
    """The past of R-STDP."""

    @property
    def weights_pa(self) -> NDArray[Any]:
        """Weights at the end [pA], (n_neurons, n_inputs)."""

    @property
    def weight_history(self) -> Sequence[NDArray[Any]]:
        """Weights every `save_every` steps, from step 0 [pA], each (n_neurons, n_inputs)."""

    @property
    def save_every(self) -> int:
        """Steps between these."""
