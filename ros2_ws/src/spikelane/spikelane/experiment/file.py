"""Experiment files: YAML read into records, every value checked, every refusal with its line.

    name: rstdp                        # of the folder: runs/rstdp
    description: what it is for
    matrix:                            # one block, or a list of them
      - controllers: [rstdp]
        scenarios: [1, 2]              # or course files; without it 1
        seeds: 10                      # so many from 0, or a list; without it [0]
        transport: inprocess           # or ros, or composed
        robots: [kinematic]            # robots, engines, or names with values of simulator.robot
        pixels: {noisy: {model: esim, esim.shot_rate_hz: 5}}        # ... of simulator.pixels
        cameras: {paper: {}, smooth: {antialias: true}}             # ... of simulator.camera
        variants: {slow: {rstdp.c_r: 0.005}}                        # any parameters
        sweep: {rstdp.c_r: [0.003, 0.01, 0.03]}                     # values, or a range (`sweeps`)
        courses: [1, 2, random:100]    # evaluated on, each in a run of its own; 100 in one
        conditions: {late: {simulator.link.latency_ms: 100}}        # of evaluations alone
        tasks: {train: {steps: 30000}, transfer: {states: 9000}, evaluate: {laps: 3}}

A block stands for every combination of what is in its lists. Parameters of a controller concern
that controller alone, and those of a task that task, as `transfer.learning_rate`. YAML's anchors
and aliases spare repetition.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
import re
from typing import Any, NamedTuple

from spikelane.experiment.sweeps import read_sweep
from spikelane.experiment.tasks import controller_groups, TASKS
from spikelane.runs.configuration import TRANSPORTS
from spikelane_controllers.registry import controller_names
from spikelane_sim.course import available_courses, load_course, scenario_course
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.parameters import Parameters, ParameterSpec
from spikelane_sim.random_course import expand_courses, is_random
from spikelane_sim.yaml_file import read_yaml, YamlValue

_NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9._-]*')
MOST_SEEDS = 100_000

#: Lists of a block that stand for parameters: where these are, and which one a bare name sets.
_AXES: Mapping[str, tuple[str, str]] = {
    'robots': ('simulator.robot.', 'model'),
    'pixels': ('simulator.pixels.', 'model'),
    'cameras': ('simulator.camera.', ''),
    'variants': ('', ''),
    'conditions': ('', ''),
}

_REQUIRED = 'controllers tasks'
_OPTIONAL = f'scenarios seeds transport courses sweep {" ".join(_AXES)}'

#: Names on an axis, each with the parameters it stands for.
Axis = Mapping[str, Mapping[str, Any]]


class ExperimentError(SpikelaneError):
    """An experiment cannot be begun as it is described."""


class Block(NamedTuple):
    """Every combination of what is in these."""

    place: str  # in the file
    controllers: tuple[str, ...]
    scenarios: tuple[str, ...]
    seeds: tuple[int, ...]
    transport: str
    axes: Mapping[str, Axis]  # robots, pixels, cameras, variants, sweeps: those that are given
    courses: tuple[str, ...]
    conditions: Axis
    tasks: Mapping[str, Parameters]  # with their options


class ExperimentRecord(NamedTuple):
    """An experiment as its file describes it."""

    name: str
    description: str
    blocks: tuple[Block, ...]


def read_experiment(path: Path) -> ExperimentRecord:
    """Read an experiment file.

    Raises:
        ExperimentError: It cannot be read, is not YAML, or a value is missing, unknown, of the
            wrong type or out of range; the message says where, what was expected and what came.
    """
    fields = read_yaml(path, 'an experiment', ExperimentError).fields('name matrix', 'description')
    matrix = fields['matrix']
    blocks = matrix.items() if matrix.is_list else [matrix]
    if not blocks:
        matrix.fail('at least one block')
    return ExperimentRecord(
        name=_name(fields['name']),
        description=fields['description'].text() if 'description' in fields else '',
        blocks=tuple(_read_block(block) for block in blocks),
    )


def with_seeds(record: ExperimentRecord, seeds: int) -> ExperimentRecord:
    """Return an experiment with other seeds in all its blocks, so many from 0."""
    blocks = (block._replace(seeds=tuple(range(seeds))) for block in record.blocks)
    return record._replace(blocks=tuple(blocks))


def with_robot(record: ExperimentRecord, given: Mapping[str, str]) -> ExperimentRecord:
    """Return an experiment of another name, with another robot or engine in all its blocks.

    Args:
        record: The experiment.
        given: `simulator.robot.model`, `simulator.robot.engine` or both.
    """
    name = '-'.join(Path(value).stem for value in given.values())
    robots: Mapping[str, Axis] = {'robots': {name: given}}
    blocks = (block._replace(axes={**robots, **block.axes, **robots}) for block in record.blocks)
    return record._replace(name=f'{record.name}_{name}', blocks=tuple(blocks))


def _read_block(value: YamlValue) -> Block:
    fields = value.fields(_REQUIRED, _OPTIONAL)
    controllers = tuple(each.choice(*controller_names()) for each in _some(fields['controllers']))
    tasks = dict(_read_tasks(fields['tasks']))
    axes = {
        # Conditions are of evaluations alone, whatever else is done.
        name: _read_axis(
            fields[name],
            prefix,
            bare,
            _known_parameters(controllers, () if name == 'conditions' else tasks),
        )
        for name, (prefix, bare) in _AXES.items()
        if name in fields
    }
    if 'sweep' in fields:
        known = _known_parameters(controllers, tasks)
        axes |= read_sweep(fields['sweep'], known, _checked_name)
    transport = fields.get('transport')
    return Block(
        place=value.place,
        controllers=controllers,
        scenarios=tuple(map(_course, _some(fields['scenarios'])))
        if 'scenarios' in fields
        else ('1',),
        seeds=_read_seeds(fields['seeds']) if 'seeds' in fields else (0,),
        transport=transport.choice(*TRANSPORTS) if transport else 'inprocess',
        courses=tuple(map(_courses, _some(fields['courses']))) if 'courses' in fields else (),
        conditions=axes.pop('conditions', {}),
        axes=axes,
        tasks=tasks,
    )


def _read_tasks(value: YamlValue) -> Iterator[tuple[str, Parameters]]:
    names: dict[str, YamlValue | None]
    if value.is_mapping:
        names = dict(value.entries())
    else:
        names = dict.fromkeys(each.choice(*TASKS) for each in _some(value))
    if not names:
        value.fail('at least one task')
    # In the order of TASKS, so that what is needed comes before what needs it.
    for name, task in TASKS.items():
        if name in names:
            yield name, _read_options(names[name], task.options)
    for name, options in names.items():
        if name not in TASKS and options is not None:
            options.refuse(f'unknown task {name!r}, expected {", ".join(TASKS)}')


def _read_options(value: YamlValue | None, cls: type[Parameters]) -> Parameters:
    if value is None:
        return cls()
    specs = {spec.name: spec for spec in cls.specs()}
    given = dict(_read_parameters(value, '', specs))
    try:
        return cls.from_mapping(given)
    except ParameterError as error:  # a combination
        value.refuse(error)


def _read_axis(
    value: YamlValue, prefix: str, bare: str, specs: Mapping[str, ParameterSpec]
) -> Axis:
    """Return the names on an axis and what each stands for, under full dotted names."""
    if value.is_mapping or not bare:
        entries = dict(value.entries()) or value.fail('at least one name')
        return {
            _checked_name(name, each): dict(_read_parameters(each, prefix, specs))
            for name, each in entries.items()
        }
    spec = specs[prefix + bare]
    names = [each.choice(*spec.choices) for each in _some(value)]
    return {name: {prefix + bare: name} for name in names}


def _read_parameters(
    value: YamlValue, prefix: str, specs: Mapping[str, ParameterSpec]
) -> Iterator[tuple[str, Any]]:
    for name, each in value.entries():
        full = prefix + name
        if each.is_mapping:
            yield from _read_parameters(each, f'{full}.', specs)
        elif full not in specs:
            allowed = ', '.join(_near(full, specs))
            each.refuse(f'unknown parameter {full!r}, expected {allowed}')
        else:
            yield full, each.parameter(specs[full])


def _near(name: str, specs: Mapping[str, ParameterSpec]) -> list[str]:
    """Return the parameters that share as much of the name's beginning as any do."""
    parts = name.split('.')
    for n in range(len(parts) - 1, 0, -1):
        start = '.'.join(parts[:n]) + '.'
        if found := [each for each in specs if each.startswith(start)]:
            return found
    return sorted({re.sub(r'\..*', '.<name>', each) for each in specs})


def _known_parameters(
    controllers: Iterable[str], tasks: Iterable[str]
) -> dict[str, ParameterSpec]:
    """Return the parameters of controllers, and those that only tasks have."""
    groups: dict[str, type[Parameters]] = {}
    for controller in controllers:
        groups |= controller_groups(controller)
        for task in tasks:
            if TASKS[task].is_for(controller):
                groups |= TASKS[task].groups(controller)
    return {
        spec.name: spec
        for group, cls in groups.items()
        for spec in cls.accepted_specs(f'{group}.')
        if spec.name != 'simulator.course'  # that is for `scenarios` to say
    }


def _read_seeds(value: YamlValue) -> tuple[int, ...]:
    if not value.is_list:
        return tuple(range(value.whole_number(1, MOST_SEEDS)))
    seeds = [each.whole_number(0, 2**62) for each in _some(value)]
    return tuple(dict.fromkeys(seeds))


def _course(value: YamlValue) -> str:
    known = ', '.join(each.removeprefix('scenario_') for each in available_courses())
    text = value.scalar(f'{known}, random:SEED or the path of a course file')
    try:
        load_course(scenario_course(text))
    except SpikelaneError as error:
        value.refuse(f'{value.name}: {error}')
    return text


def _courses(value: YamlValue) -> str:
    """Return a course, or the name of several random ones."""
    text = value.scalar('a course')
    if not is_random(text):
        return _course(value)
    try:
        expand_courses(text)
    except SpikelaneError as error:
        value.refuse(f'{value.name}: {error}')
    return text


def _some(value: YamlValue) -> list[YamlValue]:
    items = value.items()
    return items or value.fail('a list of at least one')


def _name(value: YamlValue) -> str:
    return _checked_name(value.scalar('a name'), value)


def _checked_name(name: str, value: YamlValue) -> str:
    """Return a name that can be part of a folder's."""
    if not _NAME.fullmatch(name):
        value.refuse(
            f'{value.name}: expected a name of letters, digits, ".", "_" and "-", got {name!r}'
        )
    return name
