"""The contract of a controller that can be trained, and saved at any step.

`check_controller` tests a class against all of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from spikelane_controllers.saved_state import SavedState
from spikelane_sim.contract import Controller
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import Parameters, ParameterSpec

#: Parameters that its class must declare, and what they must be.
REQUIRED_PARAMETERS = {'learning': bool, 'checkpoint': str}

_ATTRIBUTES = ('parameters', 'learning')
_METHODS = ('initialise', 'state', 'restore')


class LearningController(Controller, Protocol):
    """A controller that can be trained.

    Attributes:
        parameters: What it was made from, of its `parameters_class`; written into checkpoints.
        learning: Whether anything changes; may be set between steps.
    """

    parameters: Any
    learning: bool

    def initialise(self, rng: np.random.Generator) -> None:
        """Forget all; draw initial weights, where no checkpoint gives them."""

    def state(self) -> SavedState:
        """Return all that the next steps depend on: arrays and finite numbers under names."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Become what `state` returned, bit for bit.

        Raises:
            SpikelaneError: It is the state of another controller.
        """


def check_can_learn(name: str, controller: object) -> None:
    """Check that a controller has what its training needs.

    Args:
        name: In the controllers' registry.
        controller: The controller.

    Raises:
        ParameterError: It lacks something; the message says what.
    """
    lacking = [f'attribute {each!r}' for each in _ATTRIBUTES if not hasattr(controller, each)]
    lacking += [
        f'method {each!r}' for each in _METHODS if not callable(getattr(controller, each, None))
    ]
    if lacking:
        raise ParameterError(
            f'controller {name}: expected a controller that can be trained, '
            f'got one without {", ".join(lacking)}'
        )
    parameters = getattr(controller, 'parameters', None)
    if not isinstance(parameters, Parameters):
        raise ParameterError(
            f'controller {name}: expected an attribute parameters of its parameters_class, '
            f'got {parameters!r:.80}'
        )
    check_learning_parameters(name, {spec.name: spec for spec in type(parameters).specs()})


def check_learning_parameters(name: str, specs: Mapping[str, ParameterSpec]) -> None:
    """Check that a controller has the parameters that its training sets.

    Args:
        name: In the controllers' registry.
        specs: Specifications of its parameters, by name.

    Raises:
        ParameterError: It lacks one; the message says which.
    """
    kinds = {each: spec.kind for each, spec in specs.items()}
    for each, kind in REQUIRED_PARAMETERS.items():
        if kinds.get(each) is not kind:
            raise ParameterError(
                f'controller {name}: expected a parameter {each!r} of type {kind.__name__}, '
                f'got {"none" if each not in kinds else kinds[each].__name__}'
            )
