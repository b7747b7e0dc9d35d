"""The runs of an experiment: which there are, what each needs, and which folder is whose.

Two runs are the same if their configurations are, whatever they are called and wherever they
stand: that of a run which takes another's checkpoint includes the other's configuration in place
of the path, and what is in course files and in weights from elsewhere is part of it. Versions
and the number of a folder are not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import dataclasses
import itertools
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

from spikelane.experiment.file import Block, ExperimentError, ExperimentRecord
from spikelane.experiment.tasks import FROM_RUN, Need, plain, Point, TASKS
from spikelane.runs.folder import RunFolder
from spikelane.runs.input_files import input_digests
from spikelane_sim.course import course_label
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.parameters import Parameters
from spikelane_sim.parsing import ParseError, read_json_file
from spikelane_sim.simulator_parameters import current_config

#: In a run's folder: what it is, for who does it and to find it again.
RUN_FILE = 'run.json'


@dataclasses.dataclass(frozen=True)
class PlannedRun:
    """One run.

    Attributes:
        name: Its own name in the experiment; that of its folder, too, where nobody has it.
        task: One of TASKS.
        point: Where in the matrix.
        options: Options of the task.
        labels: Names on the axes, `{'cameras': 'smooth'}`.
        before: Name of the run whose checkpoint it takes, None for none.
        identity: What it is compared by, as a JSON-compatible dict.
        setting: What it has in common with runs that can be done in one fleet with it; '' where
            it is done alone.
        most_together: How many of these can be done together.
    """

    name: str
    task: str
    point: Point
    options: Parameters
    labels: Mapping[str, str]
    before: str | None
    identity: Mapping[str, Any]
    setting: str = ''
    most_together: int = 1

    @property
    def key(self) -> str:
        """Its identity as a text."""
        return json.dumps(self.identity, sort_keys=True)


#: In one experiment; a list of so many takes minutes to make.
MOST_RUNS = 100_000


class Plan(NamedTuple):
    """The runs of an experiment, each after those it needs."""

    name: str
    runs: tuple[PlannedRun, ...]


class _Place(NamedTuple):
    """Where a run stands, but for task and controller."""

    block: int | None  # None: in whichever
    scenario: str
    seed: int
    labels: tuple[tuple[str, str], ...]  # in whichever block, what they stand for


def make_plan(record: ExperimentRecord) -> Plan:
    """Find the runs of an experiment; the same configuration is there once.

    Raises:
        ExperimentError: A combination is not allowed, or a run lacks what it needs; the message
            says in which block.
    """
    planner = _Planner()
    for number, block in enumerate(record.blocks):
        planner.add_block(number, block)
    return Plan(record.name, tuple(planner.runs))


class _Planner:
    """Gathers runs."""

    def __init__(self) -> None:
        self.runs: list[PlannedRun] = []
        self._by_key: dict[str, PlannedRun] = {}
        self._by_place: dict[tuple[_Place, Need], list[PlannedRun]] = {}
        self._names: set[str] = set()
        self._n_runs = 0

    def add_block(self, number: int, block: Block) -> None:
        self._n_runs += _most_runs(block)
        if self._n_runs > MOST_RUNS:
            raise ExperimentError(
                f'{block.place}: expected at most {MOST_RUNS} runs in an experiment, '
                f'got {self._n_runs} so far'
            )
        # Task by task, since one controller can need what another has learnt.
        for task in block.tasks:
            places = itertools.product(
                block.controllers, block.scenarios, _combinations(block), block.seeds
            )
            for controller, scenario, labels, seed in places:
                if TASKS[task].is_for(controller):
                    place = _Place(number, scenario, seed, labels)
                    self._add_runs(block, task, controller, place)

    def _add_runs(self, block: Block, task: str, controller: str, place: _Place) -> None:
        """Add the run of a task; where it is of conditions, that of each course and condition."""
        before = self._before(block, task, controller, place)
        courses: tuple[str, ...] = ('',)
        conditions: tuple[str, ...] = ('',)
        if TASKS[task].is_of_conditions:
            courses, conditions = block.courses or courses, tuple(block.conditions) or conditions
        for course, condition in itertools.product(courses, conditions):
            labels = dict(place.labels)
            if course:
                labels['courses'] = course_label(course)
            if condition:
                labels['conditions'] = condition
            point = Point(
                controller,
                place.scenario,
                place.seed,
                block.transport,
                _parameters(block, labels, task, controller),
                course,
            )
            run = self._run(block, task, point, labels, before)
            for where in (place, _anywhere(block, place)):
                known = self._by_place.setdefault((where, Need(task, controller)), [])
                if run not in known:
                    known.append(run)

    def _before(
        self, block: Block, task: str, controller: str, place: _Place
    ) -> PlannedRun | None:
        """Return the run whose checkpoint another takes: of its block, else of any before it."""
        labels = dict(place.labels)
        if f'{controller}.checkpoint' in _parameters(block, labels, task, controller):
            return None
        needs = TASKS[task].needs(controller)
        for where, need in itertools.product((place, _anywhere(block, place)), needs):
            found = self._by_place.get((where, need), [])
            if len(found) > 1:
                names = ' and '.join(run.name for run in found)
                raise ExperimentError(
                    f'{block.place}: {task} of {controller}: expected one run before it, '
                    f'got {names}: give their difference a name in `variants`'
                )
            if found:
                return found[0]
        if TASKS[task].must_have_need:
            wanted = ' or '.join(f'{need.task} of {need.controller}' for need in needs)
            raise ExperimentError(
                f'{block.place}: {task} of {controller}: expected {wanted} in the experiment too'
            )
        return None

    def _run(
        self,
        block: Block,
        task: str,
        point: Point,
        labels: Mapping[str, str],
        before: PlannedRun | None,
    ) -> PlannedRun:
        options = block.tasks[task]
        try:
            config = TASKS[task].configure(point, options, FROM_RUN if before else None)
        except SpikelaneError as error:
            raise ExperimentError(f'{block.place}: {task} {point.controller}: {error}') from None
        configuration = plain(config.to_dict())
        identity: dict[str, Any] = {
            'task': task,
            'configuration': configuration,
            'before': None if before is None else before.identity,
        }
        if inputs := input_digests(configuration):
            identity['inputs'] = inputs
        if recorded := getattr(options, 'record', ()):
            identity['record'] = list(recorded)
        name = self._free_name(_name(task, point, labels))
        setting = '' if recorded else TASKS[task].setting(config)  # no kernel records
        run = PlannedRun(
            name,
            task,
            point,
            options,
            labels,
            before.name if before else None,
            identity,
            f'{task} {setting}' if setting else '',
            TASKS[task].most_together(config) if setting else 1,
        )
        known = self._by_key.setdefault(run.key, run)
        if known is run:
            self.runs.append(run)
            self._names.add(name)
        return known

    def _free_name(self, name: str) -> str:
        numbered = (f'{name}-{number}' for number in itertools.count(2))
        return next(each for each in itertools.chain([name], numbered) if each not in self._names)


def _most_runs(block: Block) -> int:
    """Return how many runs a block has at most."""
    lists = (block.controllers, block.scenarios, block.seeds, *block.axes.values())
    conditions = max(len(block.courses), 1) * max(len(block.conditions), 1)
    each = sum(conditions if TASKS[task].is_of_conditions else 1 for task in block.tasks)
    return math.prod(map(len, lists)) * each


def _combinations(block: Block) -> Iterator[tuple[tuple[str, str], ...]]:
    """Yield every combination of names on a block's axes."""
    axes = ([(axis, name) for name in names] for axis, names in block.axes.items())
    return itertools.product(*axes)


def _anywhere(block: Block, place: _Place) -> _Place:
    """Return the place without its block: names count for what they stand for."""
    meanings = tuple(
        (axis, json.dumps(block.axes[axis][name], sort_keys=True)) for axis, name in place.labels
    )
    return place._replace(block=None, labels=meanings)


def _parameters(
    block: Block, labels: Mapping[str, str], task: str, controller: str
) -> dict[str, Any]:
    """Return what the names on the axes stand for, as far as it concerns a run; later axes win."""
    found: dict[str, Any] = {}
    for axis, name in labels.items():
        if axis != 'courses':
            found |= block.conditions[name] if axis == 'conditions' else block.axes[axis][name]
    own = tuple(f'{group}.' for group in TASKS[task].groups(controller))
    return {name: value for name, value in found.items() if name.startswith(own)}


def _name(task: str, point: Point, labels: Mapping[str, str]) -> str:
    parts = [task, point.controller, course_label(point.scenario), *labels.values()]
    return '-'.join([*parts, f'seed{point.seed}'])


# ------------------------------------------------------------------------------- on the disk


class Found(NamedTuple):
    """A run that is in an experiment's folder."""

    folder: RunFolder
    is_finished: bool


def find_runs(root: Path, runs: Sequence[PlannedRun]) -> dict[str, Found]:
    """Find runs, by their configurations, in an experiment's folder.

    Returns:
        Those found by name; of several folders a finished one.
    """
    names = {run.key: run.name for run in runs}
    found: dict[str, Found] = {}
    for file in sorted(root.glob(f'*/{RUN_FILE}')):
        name = names.get(_key_in(file))
        folder = RunFolder(file.parent)
        if name is not None and not (name in found and found[name].is_finished):
            found[name] = Found(folder, folder.metrics.exists())
    return found


def make_run_folder(root: Path, run: PlannedRun, before: RunFolder | None) -> RunFolder:
    """Make a run's folder, with all that is needed to do it.

    Raises:
        SpikelaneError: It cannot be made or written.
    """
    folder = RunFolder.create(root / run.name)
    write_run(folder, run, before)
    return folder


def write_run(folder: RunFolder, run: PlannedRun, before: RunFolder | None) -> None:
    """Write what a run is, for who does it.

    Raises:
        FileError: It cannot be written.
    """
    folder.write_json(
        RUN_FILE,
        {
            'name': run.name,
            'point': run.point._asdict(),
            'options': run.options.to_dict(),
            # The folders of an experiment lie side by side and may be moved together.
            'checkpoint': None if before is None else f'../{before.path.name}',
            'identity': run.identity,
        },
    )


def _key_in(file: Path) -> str:
    try:
        return json.dumps(_current(read_json_file(file)['identity']), sort_keys=True)
    except (ParseError, AttributeError, KeyError, TypeError):
        return ''


def _current(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return an identity under today's names of parameters."""
    before = identity['before']
    return {
        **identity,
        'configuration': current_config(identity['configuration']),
        'before': None if before is None else _current(before),
    }
