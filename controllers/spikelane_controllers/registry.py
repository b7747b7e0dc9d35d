"""The controllers by name: each has a card, which a package registers as an entry point.

The group is `spikelane.controllers`. An entry point names a `ControllerCard`, or the class of a
controller itself, which is then a controller without anything that a card can add. Nothing is
imported before it is asked for, and what cannot be imported is in nobody else's way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import functools
from importlib.metadata import EntryPoint
import re
from typing import Any, cast, ClassVar, Protocol, TYPE_CHECKING

from spikelane_controllers.card import ControllerCard, TrainingCard, TransferCard
from spikelane_sim.contract import Controller
from spikelane_sim.entry_points import package_of, registered
from spikelane_sim.errors import ParameterError
from spikelane_sim.parameters import Parameters

if TYPE_CHECKING:
    from spikelane_controllers.fleet import ControllerFleet
    from spikelane_controllers.learning.results import Results, TrainingResults
    from spikelane_controllers.learning.training import Training
    from spikelane_controllers.learning.transfer import Transfer

#: Groups of the entry points. The second one names the training of a controller that is
#: registered without a card.
CONTROLLER_GROUP = 'spikelane.controllers'
TRAINING_GROUP = 'spikelane.trainings'

#: What names a node, a group of parameters and a folder alike.
_NAME = re.compile('[a-z][a-z0-9_]*')
_OWN = 'spikelane_controllers'


class ControllerClass(Protocol):
    """What the class of a registered controller offers, in addition to being a controller."""

    parameters_class: ClassVar[type[Parameters]]

    def __call__(self, parameters: Any) -> Controller:
        """Make a controller from parameters of parameters_class."""


def controller_names() -> tuple[str, ...]:
    """Return the names of all controllers: the paper's in its order, then others by name.

    Raises:
        ParameterError: Another package's cannot have its name.
    """
    return tuple(_entries(CONTROLLER_GROUP))


def training_names() -> tuple[str, ...]:
    """Return the names of all controllers that learn by driving.

    Raises:
        ParameterError: Another package's cannot have its name.
    """
    return tuple(name for name, found in cards().items() if found.training)


def transfer_names() -> tuple[str, ...]:
    """Return the names of all controllers that take over what another one has learnt.

    Raises:
        ParameterError: Another package's cannot have its name.
    """
    return tuple(name for name, found in cards().items() if found.transfer)


def controller_packages() -> dict[str, str]:
    """Return the ROS package of every controller, which has its node.

    Raises:
        ParameterError: Another package's cannot have its name.
    """
    return {name: package_of(point) for name, point in _entries(CONTROLLER_GROUP).items()}


def cards() -> Mapping[str, ControllerCard]:
    """Return the cards of all controllers whose card can be imported.

    Raises:
        ParameterError: Another package's cannot have its name.
    """
    found = {}
    for name in controller_names():
        try:
            found[name] = card(name)
        except ParameterError:  # told to those who ask for this controller
            continue
    return found


def card(name: str) -> ControllerCard:
    """Return the card of a controller.

    Raises:
        ParameterError: No controller has this name, or its card cannot be imported.
    """
    known = _entries(CONTROLLER_GROUP)
    if name not in known:
        raise ParameterError(f'controller: expected one of {", ".join(known)}, got {name!r}')
    point = known[name]
    found = _load(name, point.value)
    if isinstance(found, ControllerCard):
        return found
    training = _entries(TRAINING_GROUP).get(name)
    return ControllerCard(
        controller=point.value,
        training=TrainingCard(training=training.value) if training else None,
    )


def usual_controller() -> str:
    """Return the controller that commands take where none is asked for."""
    return next(name for name, each in cards().items() if each.is_usual)


def usual_training() -> str:
    """Return the controller that is trained where none is asked for."""
    found = cards().items()
    return next(name for name, each in found if each.training and each.training.is_usual)


def title(name: str) -> str:
    """Return how a controller is called in figures and tables; a name of none is itself."""
    found = cards().get(name)
    return found.title or name if found else name


def position(name: str) -> tuple[int, str]:
    """Return what controllers are sorted by: the paper's in its order, then others by name."""
    found = cards().get(name)
    return (found.paper.order if found and found.paper else len(cards()), name)


def controller_class(name: str) -> ControllerClass:
    """Return the class of a controller.

    Raises:
        ParameterError: No controller has this name, or it cannot be imported or is no such class.
    """
    found = _load(name, card(name).controller)
    if not hasattr(found, 'parameters_class'):
        raise ParameterError(
            f'controller {name}: expected a class with parameters_class, got {found!r:.200}'
        )
    return cast(ControllerClass, found)


def training_card(name: str) -> TrainingCard:
    """Return how a controller is trained.

    Raises:
        ParameterError: No controller that learns by driving has this name.
    """
    found = card(name).training
    if found is None:
        expected = ', '.join(training_names())
        raise ParameterError(f'controller: expected one of {expected}, got {name!r}')
    return found


def training_class(name: str) -> type[Training]:
    """Return the class of a controller's training.

    Raises:
        ParameterError: No controller that learns by driving has this name, or its training cannot
            be imported.
    """
    return cast('type[Training]', _load(name, training_card(name).training))


def training_results(name: str) -> type[TrainingResults]:
    """Return the class of what a controller's training has to show.

    Raises:
        ParameterError: As `training_class`.
    """
    return cast('type[TrainingResults]', _load(name, training_card(name).results))


def transfer_card(name: str) -> TransferCard:
    """Return how a controller takes over what another one has learnt.

    Raises:
        ParameterError: No controller that takes anything over has this name.
    """
    found = card(name).transfer
    if found is None:
        expected = ', '.join(transfer_names())
        raise ParameterError(f'controller: expected one of {expected}, got {name!r}')
    return found


def transfer_class(name: str) -> type[Transfer]:
    """Return the class that transfers what another controller has learnt to this one.

    Raises:
        ParameterError: No controller that takes anything over has this name, or its transfer
            cannot be imported.
    """
    return cast('type[Transfer]', _load(name, transfer_card(name).transfer))


def transfer_results(name: str) -> Callable[..., Results]:
    """Return the class of what a transfer has to show.

    Raises:
        ParameterError: As `transfer_class`.
    """
    return cast('Callable[..., Results]', _load(name, transfer_card(name).results))


def fleet_class(name: str) -> type[ControllerFleet]:
    """Return the class of a controller's fleet.

    Raises:
        ParameterError: No controller has this name, or its fleet does not exist or cannot be
            imported.
    """
    place = card(name).fleet
    if not place:
        able = [each for each, its_card in cards().items() if its_card.fleet]
        raise ParameterError(
            f'controller: expected one that drives a fleet ({", ".join(able)}), got {name}'
        )
    return cast('type[ControllerFleet]', _load(name, place))


def hook(name: str, place: str) -> Callable[..., Any]:
    """Return a function that a card names, as `figures` or `nir_graph`.

    Raises:
        ParameterError: It cannot be imported.
    """
    return cast('Callable[..., Any]', _load(name, place))


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


def _load(name: str, place: str) -> object:
    """Import what a controller's entry point or card names.

    Raises:
        ParameterError: It cannot be imported, for whatever reason.
    """
    try:
        return EntryPoint(name, place, CONTROLLER_GROUP).load()
    # Another package's module can raise anything; one that calls sys.exit must not end us.
    except (Exception, SystemExit) as error:
        points = (_entries(group).get(name) for group in (TRAINING_GROUP, CONTROLLER_GROUP))
        named = next((each for each in points if each and each.value == place), None)
        package = package_of(named or _entries(CONTROLLER_GROUP)[name])
        raise ParameterError(
            f'controller {name}: expected {place}, which package {package} registers, '
            f'got {error!r:.200}'
        ) from error


@functools.cache
def _entries(group: str) -> dict[str, EntryPoint]:
    """Return what is registered, by name: this package's in the order of cards, then others."""
    found: dict[str, EntryPoint] = {}
    for point in registered(group, _OWN if group == CONTROLLER_GROUP else ''):
        if not _NAME.fullmatch(point.name) or point.name in found:
            raise ParameterError(
                f'{group}: expected a name of a-z, 0-9 and _ that no other package has, '
                f'got {point.name!r} of package {package_of(point)}'
            )
        found[point.name] = point
    return found
