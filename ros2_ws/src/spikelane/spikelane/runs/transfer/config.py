"""What determines a transfer."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from pathlib import Path
from typing import Any

from spikelane.runs.configuration import check_seed, parameter_groups, RunConfig
from spikelane_controllers.learning.transfer import Transfer, TransferRequest
from spikelane_controllers.registry import (
    transfer_card,
    transfer_class,
)
from spikelane_controllers.weights import find_checkpoint, shipped_weights
from spikelane_sim.course import course_label, scenario_course
from spikelane_sim.errors import ParameterError
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
    """

    controller: str
    scenario: str
    checkpoint: str
    seed: int
    simulator: SimulatorParameters
    parameters: Mapping[str, Parameters]
    from_training: bool

    @property
    def usual_name(self) -> str:
        """As in `run_folder.Run`."""
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
        )
        return transfer_class(self.controller)(request)


def source_of(controller: str) -> str:
    """Return the name of the controller that another one takes over from.

    Raises:
        ParameterError: There is no such controller, or it takes nothing over.
    """
    return transfer_card(controller).source


def make_config(
    controller: str,
    scenario: str,
    checkpoint: str | None,
    seed: int,
    parameters: Mapping[str, Any],
    from_training: bool | None,
) -> TransferConfig:
    """Make the configuration of a transfer.

    Args:
        controller: As in TransferConfig.
        scenario: '1' to '3' of the paper, or the name or path of another course.
        checkpoint: As in TransferConfig; None for the weights shipped for the scenario.
        seed: Seed of all randomness.
        parameters: Others than the defaults, as `simulator.camera.fov_deg`, `gathering.states`
            and `transfer.steps`.
        from_training: As in TransferConfig; None for where there are any.

    Raises:
        SpikelaneError: Anything is unknown or not allowed, or there is no such checkpoint.
    """
    source = source_of(controller)
    if checkpoint is None:
        checkpoint = scenario_course(scenario)
    elif checkpoint not in shipped_weights(source):
        checkpoint = str(Path(checkpoint).absolute())
    is_there = transfer_class(controller).has_states(find_checkpoint(source, checkpoint))
    if from_training and not is_there:
        raise ParameterError(
            '--from-training: expected the states of the training beside the checkpoint, '
            f'got none: {checkpoint}'
        )
    is_wanted = is_there if from_training is None else from_training
    return configure_transfer(controller, scenario, checkpoint, seed, parameters, is_wanted)


def configure_transfer(
    controller: str,
    scenario: str,
    checkpoint: str,
    seed: int,
    parameters: Mapping[str, Any],
    from_training: bool,
) -> TransferConfig:
    """Make the configuration of a transfer as it will be, whether its checkpoint is there or not.

    Args:
        controller: As in `make_config`.
        scenario: As in `make_config`.
        checkpoint: Taken as it is.
        seed: As in `make_config`.
        parameters: As in `make_config`.
        from_training: As in TransferConfig.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    cls = transfer_class(controller)
    groups = parameter_groups(
        {**cls.defaults, **parameters},
        {
            'simulator': {'course': scenario_course(scenario)},
            **{name: {} for name in cls.parameters_classes},
        },
    )
    check_seed(seed)
    config = TransferConfig(
        given=parameters,
        controller=controller,
        scenario=scenario,
        checkpoint=checkpoint,
        seed=seed,
        simulator=SimulatorParameters.from_mapping(groups['simulator'], 'simulator'),
        parameters={
            name: group.from_mapping(groups[name], name)
            for name, group in cls.parameters_classes.items()
        },
        from_training=from_training,
    )
    config.make_transfer()  # checks what goes together
    return config
