"""What determines a training."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from typing import Any, cast

from spikelane.runs.configuration import Configuration, configure, configured_controller, Request
from spikelane.runs.folder import RunFolder
from spikelane_controllers.learning.learning_controller import (
    check_can_learn,
    check_learning_parameters,
    LearningController,
)
from spikelane_controllers.learning.training import TrainingParameters
from spikelane_controllers.registry import (
    controller_class,
    training_card,
    training_class,
)
from spikelane_sim.course import course_label
from spikelane_sim.errors import CheckpointChoiceError, ParameterError

_STEPS = 'training.steps'


def training_defaults(controller: str) -> Mapping[str, Any]:
    """Return the parameters whose defaults are different in a training.

    Raises:
        ParameterError: No controller that learns by driving has this name.
    """
    given = training_card(controller).defaults.items()
    return {
        **{
            name if name.startswith('simulator.') else f'{controller}.{name}': value
            for name, value in given
        },
        f'{controller}.learning': True,
        f'{controller}.checkpoint': '',
    }


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainConfig(Configuration):
    """Everything that determines a training.

    Attributes:
        training: How long it takes and how often it is saved.
    """

    training: TrainingParameters

    @property
    def usual_name(self) -> str:
        """As in RunConfig."""
        return f'train-{self.controller}-{course_label(self.scenario)}-seed{self.seed}'

    def check(self) -> None:
        """Make sure that there is what learns.

        Raises:
            SpikelaneError: The controller cannot be made or trained, or its node not be started.
        """
        super().check()
        learning_controller(self)

    def check_resumable(self, folder: RunFolder) -> None:
        """Make sure that a folder has a checkpoint; whose it is, the training finds out itself.

        Raises:
            CheckpointChoiceError: It has none.
        """
        if not folder.checkpoint.exists():
            raise CheckpointChoiceError(f'{folder.checkpoint}: expected a checkpoint, got none')

    @classmethod
    def make(cls, asked: Request, steps: int | None = None) -> TrainConfig:
        """Make the configuration of a training.

        Args:
            asked: Its controller is one that learns; parameters of the training's length and
                checkpoints are in the group `training`.
            steps: Value of `training.steps`; None for as many as usual, or as in the parameters.

        Raises:
            SpikelaneError: Anything is unknown or not allowed.
        """
        training = training_class(asked.controller).parameters_class
        known = controller_class(asked.controller).parameters_class.specs()
        check_learning_parameters(asked.controller, {spec.name: spec for spec in known})
        if steps is not None:
            if _STEPS in asked.parameters:
                raise ParameterError(
                    f'{_STEPS}: expected either --steps or the parameter, got both'
                )
            asked = asked._replace(parameters={**asked.parameters, _STEPS: steps})
        return cls(**configure(asked, training_defaults(asked.controller), training=training))


def learning_controller(config: TrainConfig) -> LearningController:
    """Make the controller of a training.

    Raises:
        SpikelaneError: It cannot be made, or not learn.
    """
    controller = configured_controller(config)
    check_can_learn(config.controller, controller)
    return cast(LearningController, controller)
