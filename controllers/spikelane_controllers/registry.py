"""The controllers by name, each imported when asked for, so that nobody waits for torch."""

from __future__ import annotations

from collections.abc import Mapping
import importlib
from typing import Any, cast, ClassVar, Protocol, TYPE_CHECKING

from spikelane_sim.contract import Controller
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import Parameters

if TYPE_CHECKING:
    from spikelane_controllers.training import Training

#: Name of a controller: module and class that implement it.
CONTROLLERS: Mapping[str, tuple[str, str]] = {
    'braitenberg': ('spikelane_controllers.braitenberg', 'Braitenberg'),
    'rstdp': ('spikelane_controllers.rstdp', 'RStdp'),
    'dqn': ('spikelane_controllers.dqn', 'Dqn'),
    'dqn_snn': ('spikelane_controllers.dqn_snn', 'DqnSnn'),
}

#: Name of a controller that learns by driving: module and class of its training.
TRAININGS: Mapping[str, tuple[str, str]] = {
    'rstdp': ('spikelane_controllers.training', 'PlasticTraining'),
    'dqn': ('spikelane_controllers.dqn_training', 'DqnTraining'),
}


class ControllerClass(Protocol):
    """What the class of a registered controller offers beside being one."""

    parameters_class: ClassVar[type[Parameters]]

    def __call__(self, parameters: Any) -> Controller:
        """Make a controller from parameters of parameters_class."""


def controller_class(name: str) -> ControllerClass:
    """Return the class of a controller.

    Raises:
        ParameterError: No controller has this name.
    """
    if name not in CONTROLLERS:
        raise ParameterError(f'controller: expected one of {", ".join(CONTROLLERS)}, got {name!r}')
    module, attribute = CONTROLLERS[name]
    return cast(ControllerClass, getattr(importlib.import_module(module), attribute))


def training_class(name: str) -> type[Training]:
    """Return the class of a controller's training.

    Raises:
        ParameterError: No controller that learns has this name.
    """
    if name not in TRAININGS:
        raise ParameterError(f'controller: expected one of {", ".join(TRAININGS)}, got {name!r}')
    module, attribute = TRAININGS[name]
    return cast('type[Training]', getattr(importlib.import_module(module), attribute))


def make_controller(name: str, parameters: Mapping[str, Any] | None = None) -> Controller:
    """Make a controller.

    Args:
        name: One of CONTROLLERS.
        parameters: Its parameters under dotted names or nested; what is absent is default.

    Raises:
        ParameterError: The name or a parameter is unknown, or a value not allowed.
    """
    cls = controller_class(name)
    return cls(cls.parameters_class.from_mapping(parameters or {}))
