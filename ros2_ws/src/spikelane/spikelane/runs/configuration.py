"""What determines a run: scenario, controller, seed, transport and all parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from pathlib import Path
from typing import Any, Protocol, TypedDict

from spikelane.runs.transport import check_transport
from spikelane_controllers.controller_host import image_size
from spikelane_controllers.registry import controller_class, make_controller
from spikelane_sim.camera import CameraParameters
from spikelane_sim.contract import Controller
from spikelane_sim.course import scenario_course
from spikelane_sim.errors import ParameterError
from spikelane_sim.filters import FilterParameters
from spikelane_sim.parameters import Parameters
from spikelane_sim.simulator_parameters import SimulatorParameters

TRANSPORTS = ('ros', 'inprocess')


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunConfig:
    """The base of the configurations of all kinds of runs.

    Attributes:
        given: The parameters that the user gave, under dotted names; all others have the defaults
            of the kind of run. They are written down, but do not determine anything themselves.
    """

    given: Mapping[str, Any] = dataclasses.field(default_factory=dict, compare=False, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Return a dict of everything that determines the run, ready for YAML.

        The controller's parameters are under its name, and groups of parameters under theirs.
        """
        values: dict[str, Any] = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name != 'given':
                values |= value if isinstance(value, Mapping) else {field.name: value}
        if isinstance(filters := values.get('filter'), FilterParameters) and not filters.names:
            del values['filter']  # a run without filters is what it was before there were any
        if 'controller_parameters' in values:
            values[values['controller']] = values.pop('controller_parameters')
        return {
            name: value.to_dict() if isinstance(value, Parameters) else value
            for name, value in values.items()
        }


@dataclasses.dataclass(frozen=True, kw_only=True)
class Configuration(RunConfig):
    """What determines a run in which a controller drives.

    Attributes:
        scenario: '1' to '3' of the paper, or the name or path of another course.
        controller: Name in the controllers' registry.
        seed: Seed of the simulator's and the controller's randomness.
        transport: One of TRANSPORTS.
        simulator: Its parameters.
        controller_parameters: Parameters of the controller's own class.
        filter: What events go through before the controller is given them.
    """

    scenario: str
    controller: str
    seed: int
    transport: str
    simulator: SimulatorParameters
    controller_parameters: Parameters
    filter: FilterParameters

    def check(self) -> None:
        """Make sure that there is what drives.

        Raises:
            SpikelaneError: The controller cannot be made, or its node not be started.
        """
        configured_controller(self)
        check_transport(self.transport, self.controller)


class ConfigurationParts(TypedDict):
    """The fields of a `Configuration`, checked."""

    scenario: str
    controller: str
    seed: int
    transport: str
    simulator: SimulatorParameters
    controller_parameters: Parameters
    filter: FilterParameters


def configure(
    scenario: str,
    controller: str,
    seed: int,
    transport: str,
    parameters: Mapping[str, Any],
    others: Sequence[str] = (),
) -> ConfigurationParts:
    """Check what determines a run.

    Args:
        scenario: As in Configuration.
        controller: As in Configuration.
        seed: As in Configuration.
        transport: As in Configuration.
        parameters: Others than the defaults, as `simulator.camera.fov_deg`,
            `braitenberg.poisson.max_rate_hz` and `filter.chain`.
        others: Names of further groups that parameters may be in; they are left to the caller.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    cls = controller_class(controller).parameters_class
    groups = parameter_groups(
        parameters,
        {
            'simulator': {'course': scenario_course(scenario)},
            controller: {},
            'filter': {},
            **{name: {} for name in others},
        },
    )
    check_seed(seed)
    simulator = SimulatorParameters.from_mapping(groups['simulator'], 'simulator')
    controller_parameters = cls.from_mapping(groups[controller], controller)
    _check_image(simulator.camera, controller, controller_parameters)
    return {
        'scenario': scenario,
        'controller': controller,
        'seed': seed,
        'transport': transport,
        'simulator': simulator,
        'controller_parameters': controller_parameters,
        'filter': configured_filters(groups['filter']),
    }


def configured_filters(given: Mapping[str, Any]) -> FilterParameters:
    """Make the parameters of filters, by name; nodes need not run in this folder.

    Raises:
        ParameterError: Anything is unknown or not allowed.
    """
    filters = FilterParameters.from_mapping(given, 'filter')
    masks = {
        name: str(Path(value).absolute())
        for name, value in filters.to_dict().items()
        if name.endswith('.file') and value
    }
    return FilterParameters.from_mapping(filters.to_dict() | masks) if masks else filters


def _check_image(camera: CameraParameters, controller: str, parameters: Parameters) -> None:
    """Refuse a camera whose image has not the size that the controller is made for."""
    wanted = image_size(parameters)
    if (camera.width, camera.height) != wanted:
        raise ParameterError(
            f'simulator.camera.width, simulator.camera.height: expected {wanted[0]} x '
            f'{wanted[1]} px, which {controller} is made for, '
            f'got {camera.width} x {camera.height} px'
        )


class Controlled(Protocol):
    """Anything that one controller takes part in."""

    @property
    def controller(self) -> str:
        """Name in the controllers' registry."""

    @property
    def controller_parameters(self) -> Parameters:
        """Parameters of the controller's own class."""


def configured_controller(config: Controlled) -> Controller:
    """Make the controller of a run.

    Raises:
        SpikelaneError: Its weights cannot be read, or what it needs is not there.
    """
    return make_controller(config.controller, config.controller_parameters.to_dict())


def parameter_groups(
    parameters: Mapping[str, Any], groups: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Sort parameters by what they are of.

    Args:
        parameters: By name, `group.name`.
        groups: What each group has already; a simulator's course is fixed by the scenario.

    Returns:
        All parameters of each group, under their names without the group's.

    Raises:
        ParameterError: There is no such group, or the course is another.
    """
    sorted_ = {group: dict(values) for group, values in groups.items()}
    for name, value in parameters.items():
        group, _, rest = name.partition('.')
        if group not in sorted_:
            expected = ' or '.join(f'{group}.<name>' for group in sorted_)
            raise ParameterError(f'unknown parameter {name!r}; expected {expected}')
        if name == 'simulator.course' and value != sorted_[group]['course']:
            raise ParameterError(f'simulator.course: expected that of --scenario, got {value!r}')
        sorted_[group][rest] = value
    return sorted_


def check_number(name: str, value: int | None, low: int, high: int) -> None:
    """Check a whole number of the command line; None is one that was not given.

    Raises:
        ParameterError: It is out of range.
    """
    if value is not None and not low <= value <= high:
        raise ParameterError(
            f'{name}: expected a whole number from {low} to {high}, got {value!s:.40}'
        )


def check_seed(seed: int) -> None:
    """Check that all generators take a seed.

    Raises:
        ParameterError: They do not.
    """
    if not 0 <= seed < 2**63:
        raise ParameterError(f'seed: expected a whole number from 0 to 2^63 - 1, got {seed!s:.40}')
