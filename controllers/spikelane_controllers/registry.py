"""The controllers by name, each imported when asked for, so that nobody waits for torch.

Other packages add theirs by entry points: `spikelane.controllers` names the class of a controller,
`spikelane.trainings`, under the same name, the class of its training.
"""

from __future__ import annotations

from collections.abc import Mapping
import functools
import importlib
from importlib.metadata import entry_points, EntryPoint
import re
from typing import Any, cast, ClassVar, NamedTuple, Protocol, TYPE_CHECKING

from spikelane_sim.contract import Controller
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import Parameters

if TYPE_CHECKING:
    from spikelane_controllers.training import Training

#: Name of a controller of this package: module and class that implement it.
CONTROLLERS: Mapping[str, tuple[str, str]] = {
    'braitenberg': ('spikelane_controllers.braitenberg', 'Braitenberg'),
    'rstdp': ('spikelane_controllers.rstdp', 'RStdp'),
    'dqn': ('spikelane_controllers.dqn', 'Dqn'),
    'dqn_snn': ('spikelane_controllers.dqn_snn', 'DqnSnn'),
}

#: Name of one that learns by driving: module and class of its training.
TRAININGS: Mapping[str, tuple[str, str]] = {
    'rstdp': ('spikelane_controllers.rstdp_training', 'PlasticTraining'),
    'dqn': ('spikelane_controllers.dqn_training', 'DqnTraining'),
}

#: Groups of the entry points by which other packages add to these.
CONTROLLER_GROUP = 'spikelane.controllers'
TRAINING_GROUP = 'spikelane.trainings'
_OWN = {CONTROLLER_GROUP: CONTROLLERS, TRAINING_GROUP: TRAININGS}

_PACKAGE = 'spikelane_controllers'
#: What names a node, a group of parameters and a folder alike.
_NAME = re.compile('[a-z][a-z0-9_]*')


class ControllerClass(Protocol):
    """What the class of a registered controller offers beside being one."""

    parameters_class: ClassVar[type[Parameters]]

    def __call__(self, parameters: Any) -> Controller:
        """Make a controller from parameters of parameters_class."""


class _Entry(NamedTuple):
    """Where something registered is."""

    place: str  # module:attribute
    package: str


def controller_names() -> tuple[str, ...]:
    """Return the names of all controllers: this package's, then those of others.

    Raises:
        ParameterError: Another package's cannot have its name.
    """
    return tuple(_entries(CONTROLLER_GROUP))


def training_names() -> tuple[str, ...]:
    """Return the names of all controllers that learn by driving.

    Raises:
        ParameterError: Another package's cannot have its name.
    """
    return tuple(_entries(TRAINING_GROUP))


def controller_packages() -> dict[str, str]:
    """Return the ROS package of every controller, which has its node.

    Raises:
        ParameterError: Another package's cannot have its name.
    """
    return {name: entry.package for name, entry in _entries(CONTROLLER_GROUP).items()}


def controller_class(name: str) -> ControllerClass:
    """Return the class of a controller.

    Raises:
        ParameterError: No controller has this name, or another package's cannot be imported or
            is no such class.
    """
    found = _load(CONTROLLER_GROUP, name)
    if not hasattr(found, 'parameters_class'):
        raise ParameterError(
            f'controller {name}: expected a class with parameters_class, got {found!r:.200}'
        )
    return cast(ControllerClass, found)


def training_class(name: str) -> type[Training]:
    """Return the class of a controller's training.

    Raises:
        ParameterError: No controller that learns has this name, or another package's training
            cannot be imported.
    """
    return cast('type[Training]', _load(TRAINING_GROUP, name))


def make_controller(name: str, parameters: Mapping[str, Any] | None = None) -> Controller:
    """Make a controller.

    Args:
        name: One of `controller_names`.
        parameters: Its parameters under dotted names or nested; what is absent is default.

    Raises:
        ParameterError: The name or a parameter is unknown, or a value not allowed.
    """
    cls = controller_class(name)
    return cls(cls.parameters_class.from_mapping(parameters or {}))


def _load(group: str, name: str) -> object:
    if name in _OWN[group]:  # found without looking through all packages
        module, attribute = _OWN[group][name]
        return getattr(importlib.import_module(module), attribute)
    known = _entries(group)
    if name not in known:
        raise ParameterError(f'controller: expected one of {", ".join(known)}, got {name!r}')
    entry = known[name]
    try:
        return EntryPoint(name, entry.place, group).load()
    # Another package's module can raise anything; one that calls sys.exit must not end us.
    except (Exception, SystemExit) as error:
        raise ParameterError(
            f'controller {name}: expected {entry.place}, which package {entry.package} registers '
            f'in {group}, got {error!r:.200}'
        ) from error


@functools.cache
def _entries(group: str) -> dict[str, _Entry]:
    """Return what is registered, this package's first, then that of others by name."""
    found = {name: _Entry(':'.join(place), _PACKAGE) for name, place in _OWN[group].items()}
    for point in sorted(entry_points(group=group), key=lambda point: point.name):
        package = point.dist.metadata['Name'].replace('-', '_') if point.dist else ''
        if not _NAME.fullmatch(point.name) or point.name in found:
            raise ParameterError(
                f'{group}: expected a name of a-z, 0-9 and _ that no other package has, '
                f'got {point.name!r} of package {package}'
            )
        found[point.name] = _Entry(point.value, package)
    return found
