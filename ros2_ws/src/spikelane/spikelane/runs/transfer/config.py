"""What determines a transfer."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from pathlib import Path

from spikelane.runs.configuration import check_seed, make_groups, Request, RunConfig
from spikelane_controllers.learning.transfer import Transfer, TransferRequest
from spikelane_controllers.registry import (
    transfer_card,
    transfer_class,
)
from spikelane_controllers.weights import find_checkpoint, shipped_weights
from spikelane_sim.course import course_label, scenario_course
from spikelane_sim.errors import ParameterError
from spikelane_sim.filters import FilterParameters
from spikelane_sim.parameters import Parameters
from spikelane_sim.simulator_parameters import SimulatorParameters


@dataclasses.dataclass(frozen=True, kw_only=True)
class TransferConfig(RunConfig):
    """Everything that determines a transfer.

    Attributes:
        controller: What takes over: a name in the registry.
        scenario: Where states are gathered; see `Configuration`.
        checkpoint: What was learnt: the name of shipped weights of the source, the path of a
            training's folder or of a checkpoint.
        seed: Seed of all randomness.
        simulator: Where states are gathered.
        parameters: The transfer's own groups of parameters, by name.
        from_training: Whether the states met in the source's training are used too.
        filter: What events go through where states are gathered.
    """

    controller: str
    scenario: str
    checkpoint: str
    seed: int
    simulator: SimulatorParameters
    parameters: Mapping[str, Parameters]
    from_training: bool
    filter: FilterParameters

    @property
    def usual_name(self) -> str:
        """As in RunConfig."""
        return f'transfer-{course_label(self.scenario)}-seed{self.seed}'

    def check(self) -> None:
        """Make sure that there is what learns, and from whom.

        Raises:
            SpikelaneError: What it needs is not installed, or the source cannot be read.
        """
        self.make_transfer().check()

    def make_transfer(self) -> Transfer:
        """Make the transfer that this determines.

        Raises:
            ParameterError: Parameters do not go together.
        """
        request = TransferRequest(
            source_of(self.controller),
            self.checkpoint,
            self.seed,
            self.simulator,
            self.parameters,
            self.from_training,
            self.filter,
        )
        return transfer_class(self.controller)(request)

    @classmethod
    def make(
        cls, asked: Request, checkpoint: str | None = None, from_training: bool | None = None
    ) -> TransferConfig:
        """Make the configuration of a transfer.

        Args:
            asked: What is asked for; parameters are also in the transfer's own groups.
            checkpoint: As in TransferConfig; None for the weights shipped for the scenario.
            from_training: As in TransferConfig; None for where there are any.

        Raises:
            SpikelaneError: Anything is unknown or not allowed, or there is no such checkpoint.
        """
        source = source_of(asked.controller)
        if checkpoint is None:
            checkpoint = scenario_course(asked.scenario)
        elif checkpoint not in shipped_weights(source):
            checkpoint = str(Path(checkpoint).absolute())
        found = find_checkpoint(source, checkpoint)
        is_there = transfer_class(asked.controller).has_states(found)
        if from_training and not is_there:
            raise ParameterError(
                '--from-training: expected the states of the training next to the checkpoint, '
                f'got none: {checkpoint}'
            )
        return cls.plan(asked, checkpoint, is_there if from_training is None else from_training)

    @classmethod
    def plan(cls, asked: Request, checkpoint: str, from_training: bool) -> TransferConfig:
        """Make the configuration of a transfer as it will be, be its checkpoint there or not.

        Args:
            asked: As in `make`.
            checkpoint: Taken as it is.
            from_training: As in TransferConfig.

        Raises:
            SpikelaneError: Anything is unknown or not allowed.
        """
        own = transfer_class(asked.controller)
        groups = make_groups(
            {**own.defaults, **asked.parameters},
            {
                'simulator': SimulatorParameters,
                'filter': FilterParameters,
                **own.parameters_classes,
            },
            asked.scenario,
        )
        check_seed(asked.seed)
        config = cls(
            given=asked.parameters,
            controller=asked.controller,
            scenario=asked.scenario,
            checkpoint=checkpoint,
            seed=asked.seed,
            simulator=groups.pop('simulator'),
            filter=groups.pop('filter'),
            parameters=groups,
            from_training=from_training,
        )
        config.make_transfer()  # checks what goes together
        return config


def source_of(controller: str) -> str:
    """Return the name of the controller that another one takes over from.

    Raises:
        ParameterError: There is no such controller, or it takes nothing over.
    """
    return transfer_card(controller).source
