"""What determines a run: the base of the configurations of all kinds, and how they are made."""

from __future__ import annotations

from collections.abc import Collection, Mapping
import dataclasses
import math
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from spikelane.runs.folder import RunFolder
from spikelane.runs.transport import check_transport
from spikelane_controllers.controller_host import check_period, image_size
from spikelane_controllers.registry import controller_class, make_controller
from spikelane_sim.contract import Controller
from spikelane_sim.course import scenario_course
from spikelane_sim.errors import ParameterError
from spikelane_sim.filters import FilterParameters, FilterStage
from spikelane_sim.parameters import grouped, Parameters
from spikelane_sim.period import PERIOD_MS, TimedParameters
from spikelane_sim.simulator_parameters import SimulatorParameters

#: Parameters of the simulator that count steps.
STEP_LIMITS = ('simulator.episode.max_steps', 'simulator.episode.no_progress_steps')

TRANSPORTS = ('ros', 'composed', 'inprocess')


class Request(NamedTuple):
    """What any run is asked for with.

    The configuration of each kind has a class method `make`, which takes this and what only that
    kind has.

    Attributes:
        scenario: '1' to '3' of the paper, or the name or path of another course.
        controller: Name in the controllers' registry.
        seed: Seed of all randomness.
        transport: One of TRANSPORTS; for kinds of runs that have it.
        parameters: Others than the defaults of the kind of run, under dotted names, as
            `simulator.camera.fov_deg`, `braitenberg.poisson.max_rate_hz` and `filter.chain`.
    """

    scenario: str
    controller: str
    seed: int = 0
    transport: str = 'inprocess'
    parameters: Mapping[str, Any] = {}


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunConfig:
    """The base of the configurations of all kinds of runs.

    Attributes:
        given: The parameters that the user gave, under dotted names; all others have the defaults
            of the kind of run. They are written down, but do not determine anything themselves.
    """

    given: Mapping[str, Any] = dataclasses.field(default_factory=dict, compare=False, repr=False)

    @property
    def usual_name(self) -> str:
        """Name of the run's folder in RUNS, where no other is asked for."""
        raise NotImplementedError

    def check(self) -> None:
        """Make sure that the run can be begun.

        Raises:
            SpikelaneError: It cannot.
        """
        raise NotImplementedError

    def check_resumable(self, folder: RunFolder) -> None:
        """Make sure that a folder has this run, so that it can be resumed.

        Raises:
            SpikelaneError: It has none, or another one.
        """
        folder.check_config(self.to_dict())

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
        scenario: As in Request.
        controller: As in Request.
        seed: As in Request.
        transport: As in Request.
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

    def facts(self) -> dict[str, Any]:
        """Return what the metrics of a run say of its configuration."""
        return {
            'scenario': self.scenario,
            'controller': self.controller,
            'seed': self.seed,
            'transport': self.transport,
            **simulator_facts(self.simulator),
        }


def configure(
    asked: Request, defaults: Mapping[str, Any], **others: type[Parameters]
) -> dict[str, Any]:
    """Return the fields of a `Configuration`, checked.

    Args:
        asked: What determines the run.
        defaults: Parameters whose defaults are others in this kind of run, under dotted names.
        others: Classes of further groups of parameters, which are fields of their own.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    controller = asked.controller
    classes: dict[str, type[Parameters]] = {
        'simulator': SimulatorParameters,
        controller: controller_class(controller).parameters_class,
        'filter': FilterParameters,
        **others,
    }
    usual = {**defaults, **_of_period(asked, classes[controller], defaults)}
    groups = make_groups({**usual, **asked.parameters}, classes, asked.scenario)
    check_seed(asked.seed)
    fields = {
        'given': asked.parameters,
        'scenario': asked.scenario,
        'controller': controller,
        'seed': asked.seed,
        'transport': asked.transport,
        'controller_parameters': groups.pop(controller),
        **groups,
    }
    _check_image(fields)
    check_period(fields['controller_parameters'], fields['simulator'].period_ms)
    return fields


def step_limits(defaults: Mapping[str, Any], period_ms: int) -> dict[str, int]:
    """Return the limits of steps among defaults, which are for 50 ms, with another period."""
    return {
        name: math.ceil(defaults[name] * PERIOD_MS / period_ms)
        for name in STEP_LIMITS
        if name in defaults
    }


def _of_period(
    asked: Request, controller: type[Parameters], defaults: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the defaults that follow from the control period, where one is given.

    The controller has the simulator's, and the usual limits of steps last as long as with 50 ms.
    """
    period_ms = asked.parameters.get('simulator.period_ms')
    if not isinstance(period_ms, int) or period_ms < 1:
        return {}  # the usual one, or one that is refused
    found: dict[str, Any] = step_limits(defaults, period_ms)
    if issubclass(controller, TimedParameters):
        found[f'{asked.controller}.period_ms'] = period_ms
    return found


def _check_image(fields: Mapping[str, Any]) -> None:
    """Refuse a camera whose image has not the size that the controller is made for."""
    camera, filters = fields['simulator'].camera, fields['filter']
    wanted = image_size(fields['controller_parameters'])
    size = camera.width, camera.height
    if filters.move_events:
        size = FilterStage(filters, *size).size
    if size != wanted:
        raise ParameterError(
            f'simulator.camera.width, simulator.camera.height: expected {wanted[0]} x '
            f'{wanted[1]} px, which {fields["controller"]} is made for, '
            f'got {size[0]} x {size[1]} px; filter.ground_view can map other images to it'
        )


def simulator_facts(simulator: SimulatorParameters) -> dict[str, Any]:
    """Return what the metrics of a run say of its simulator."""
    return {
        'robot': simulator.robot.model,
        'engine': simulator.robot.engine,
        'pixels': simulator.pixels.model,
        'antialias': simulator.camera.antialias,
    }


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


def make_groups(
    parameters: Mapping[str, Any],
    classes: Mapping[str, type[Parameters]],
    scenario: str | None = None,
) -> dict[str, Any]:
    """Make groups of parameters.

    Args:
        parameters: By name, `group.name`.
        classes: The class of each group.
        scenario: Whose course the group `simulator` has, where there is one.

    Returns:
        An instance of its class for each group.

    Raises:
        SpikelaneError: There is no such group or scenario, the course is another, or a parameter
            is unknown or not allowed.
    """
    groups = group_values(parameters, classes)
    if scenario is not None:
        simulator, course = groups.setdefault('simulator', {}), scenario_course(scenario)
        if simulator.setdefault('course', course) != course:
            raise ParameterError(
                f'simulator.course: expected that of --scenario, got {simulator["course"]!r}'
            )
    made = {name: cls.from_mapping(groups.get(name, {}), name) for name, cls in classes.items()}
    if isinstance(filters := made.get('filter'), FilterParameters):
        made['filter'] = _with_whole_paths(filters)
    return made


def _with_whole_paths(filters: FilterParameters) -> FilterParameters:
    """Return the parameters of filters with absolute paths: nodes need not run in this folder."""
    files = {
        name: str(Path(value).absolute())
        for name, value in filters.to_dict().items()
        if name.endswith('file') and value
    }
    return FilterParameters.from_mapping(filters.to_dict() | files) if files else filters


def group_values(
    parameters: Mapping[str, Any], groups: Collection[str]
) -> dict[str, dict[str, Any]]:
    """Return parameters by their group, one of some.

    Raises:
        ParameterError: There is no such group.
    """
    for name in parameters:
        if name.partition('.')[0] not in groups:
            expected = ' or '.join(f'{group}.<name>' for group in groups)
            raise ParameterError(f'unknown parameter {name!r}; expected {expected}')
    return grouped(parameters)


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
