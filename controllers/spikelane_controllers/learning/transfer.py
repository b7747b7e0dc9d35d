"""The contract of a transfer: a controller takes over what another one has learnt by driving."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Protocol

from spikelane_sim.filters import FilterParameters
from spikelane_sim.parameters import Parameters
from spikelane_sim.simulator_parameters import SimulatorParameters

#: Shows what is being done, how much of it is done, and of how much.
OnStageProgress = Callable[[str, int, int], None]

#: What is being done while states are gathered by driving; the first part of every transfer.
STATES = 'states'


class TransferRequest(NamedTuple):
    """Everything that determines a transfer.

    Attributes:
        source: Name of the controller that has learnt.
        checkpoint: Its weights: the name of shipped ones, or the path of a training's folder or
            of a checkpoint.
        seed: Seed of all randomness.
        simulator: Where states are gathered.
        parameters: The transfer's own parameters, by the name of their group.
        from_training: Whether the states met in the training are used too.
        filter: What events go through where states are gathered.
    """

    source: str
    checkpoint: str
    seed: int
    simulator: SimulatorParameters
    parameters: Mapping[str, Parameters]
    from_training: bool
    filter: FilterParameters = FilterParameters()


class Transfer(Protocol):
    """A transfer: `run` comes before `save` and `metrics`.

    Attributes:
        parameters_classes: The transfer's own groups of parameters, by name. One is `gathering`,
            a `gathering.GatheringParameters`, one is `transfer`, which has `steps`.
        defaults: Parameters of the simulator whose defaults are different while states are
            gathered.
    """

    parameters_classes: ClassVar[Mapping[str, type[Parameters]]]
    defaults: ClassVar[Mapping[str, Any]]

    def __init__(self, request: TransferRequest) -> None:
        """Prepare the transfer.

        Raises:
            ParameterError: Parameters do not go together.
        """

    @staticmethod
    def has_states(checkpoint: Path) -> bool:
        """Return whether the states visited in a training are there, next to its checkpoint."""

    def check(self) -> None:
        """Make sure that it can be begun.

        Raises:
            SpikelaneError: What it needs is not installed, or the source cannot be read.
        """

    def run(self, show: OnStageProgress) -> None:
        """Do all of it.

        Raises:
            SpikelaneError: The source or its states cannot be read, or not learnt from.
        """

    def save(self, path: Path, config: Mapping[str, Any]) -> None:
        """Write the checkpoint that the controller drives with.

        Args:
            path: File to write, ending in .safetensors.
            config: What determined the transfer, to be kept in it.

        Raises:
            FileError: It cannot be written.
        """

    def metrics(self) -> dict[str, Any]:
        """Return what was measured."""
