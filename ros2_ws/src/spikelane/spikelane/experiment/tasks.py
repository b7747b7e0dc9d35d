"""What a run of an experiment can be: each task is an entry of TASKS, and nowhere else named.

A task makes a configuration of what the experiment's file says, which is how runs are compared,
and does it in a folder, going on with what it finds there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import json
from typing import Any, cast, NamedTuple

from spikelane.fleet.setting import most_together, setting_key
from spikelane.recording.record import check_recordable
from spikelane.runs.configuration import Request, RunConfig
from spikelane.runs.evaluate.config import EvaluateConfig, EvaluationParameters
from spikelane.runs.evaluate.run import evaluate, evaluate_together, Evaluation
from spikelane.runs.folder import RunFolder
from spikelane.runs.output import OnProgress, ShowShare
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import (
    check_training_recordable,
    train_and_report,
    train_together,
    TrainingRun,
)
from spikelane.runs.transfer.config import source_of, TransferConfig
from spikelane.runs.transfer.run import report_transfer, transfer
from spikelane_controllers.learning.gathering import GatheringParameters, MOST_STATES
from spikelane_controllers.learning.transfer import STATES
from spikelane_controllers.registry import (
    card,
    controller_class,
    training_card,
    training_class,
    transfer_card,
    transfer_class,
)
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.filters import FilterParameters
from spikelane_sim.parameters import MOST_STEPS, parameter, Parameters
from spikelane_sim.simulator_parameters import SimulatorParameters

#: Stands in a configuration, while runs are planned, for the checkpoint another will leave.
FROM_RUN = '(of the run before)'


class Point(NamedTuple):
    """One place in an experiment's matrix."""

    controller: str
    scenario: str
    seed: int
    transport: str
    parameters: Mapping[str, Any]  # under dotted names
    course: str  # to evaluate on, '' for the scenario's

    def request(self, parameters: Mapping[str, Any] = {}) -> Request:
        """Return what a run here is asked for with, with other parameters unless it has them."""
        given = {**parameters, **self.parameters}
        return Request(self.scenario, self.controller, self.seed, self.transport, given)


class Need(NamedTuple):
    """A run whose checkpoint another takes: the one at the same place of the matrix."""

    task: str
    controller: str


class Job(NamedTuple):
    """A run in its folder, of which several are done together."""

    config: Any
    folder: RunFolder
    show: ShowShare


#: Called with the folder of a run that has failed, and why, while others go on.
OnFailure = Callable[[RunFolder, SpikelaneError], None]


class Task(NamedTuple):
    """A kind of run."""

    options: type[Parameters]  # what the file may say of it
    is_of_conditions: bool  # whether there is a run for each course and condition
    is_for: Callable[[str], bool]  # whether a controller takes part
    # Given a controller: groups of parameters that concern its run.
    groups: Callable[[str], Mapping[str, type[Parameters]]]
    needs: Callable[[str], Sequence[Need]]  # of a controller: the first that is planned is taken
    must_have_need: bool  # whether it cannot do without
    requires: Callable[[str], str]  # of a controller: what is to be installed, '' for nothing
    # Given options and the checkpoint: a folder, or FROM_RUN; None where there is none.
    configure: Callable[[Point, Any, str | None], RunConfig]
    # Given configuration and options; it leaves metrics.json.
    run: Callable[[Any, Any, RunFolder, ShowShare], Mapping[str, Any]]
    # What configurations have in common that can be robots of one fleet; '' where none can.
    setting: Callable[[Any], str]
    # How many of these are done together.
    most_together: Callable[[Any], int]
    # Does several of one setting, each as `run` does it: it leaves the same files.
    run_together: Callable[[Sequence[Job], OnFailure], None]


@dataclass(frozen=True, kw_only=True)
class TrainOptions(Parameters):
    """How a controller is trained."""

    steps: int = parameter(
        0,
        'Length of the training, as --steps of `spikelane train`; 0: the default of the '
        'controller.',
        low=0,
        high=MOST_STEPS,
    )
    record: tuple[str, ...] = parameter(
        (), 'Quantities that the controller records in the training; none: no recording.'
    )


@dataclass(frozen=True, kw_only=True)
class TransferOptions(Parameters):
    """How a policy is transferred."""

    states: int = parameter(
        GatheringParameters.states,
        'Number of states to gather by driving with the trained policy.',
        low=1,
        high=MOST_STATES,
    )
    steps: int = parameter(
        0, 'Training steps of the network; 0: the default of the transfer.', low=0, high=MOST_STEPS
    )
    from_training: bool = parameter(True, 'Use the states met in the preceding training as well.')


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions(Parameters):
    """How a controller is evaluated."""

    laps: int = parameter(1, 'Laps that each drive takes in a row.', low=1, high=1_000_000)
    seeds: int = parameter(
        EvaluationParameters.seeds, 'Number of seeds that are driven.', low=1, high=1_000_000
    )
    seed_offset: int = parameter(
        0, "First seed of the laps, relative to the run's seed.", low=0, high=2**40
    )
    lanes: tuple[str, ...] = parameter((), 'Lanes to drive; none: every lane of the course.')
    record: tuple[str, ...] = parameter(
        (), 'Quantities that the controller records in each lap; none: no recording.'
    )


def _configure_training(
    point: Point, options: TrainOptions, checkpoint: str | None
) -> TrainConfig:
    del checkpoint
    config = TrainConfig.make(point.request(), options.steps or None)
    check_training_recordable(config, options.record)
    return config


def _train(
    config: TrainConfig, options: TrainOptions, folder: RunFolder, show: ShowShare
) -> Mapping[str, Any]:
    if options.record:
        # A recording has every step, so that a training that was interrupted restarts.
        folder.checkpoint.unlink(missing_ok=True)
    return train_and_report(
        config,
        folder,
        _shown_as_share(config, show),
        resume=folder.checkpoint.exists(),
        record=options.record,
    )


def _train_together(jobs: Sequence[Job], fail: OnFailure) -> None:
    train_together(
        [
            TrainingRun(job.config, job.folder, _shown_as_share(job.config, job.show))
            for job in jobs
        ],
        fail,
    )


def _shown_as_share(config: TrainConfig, show: ShowShare) -> OnProgress:
    def show_steps(steps: int, progress_m: float) -> None:
        del progress_m
        show(steps, min(1.0, steps / config.training.steps))

    return show_steps


def _configure_transfer(
    point: Point, options: TransferOptions, checkpoint: str | None
) -> TransferConfig:
    steps = {'transfer.steps': options.steps} if options.steps else {}
    asked = point.request({'gathering.states': options.states, **steps})
    assert checkpoint is not None  # it must have its need
    # While runs are planned there is nothing to be found at that place.
    make = TransferConfig.plan if checkpoint == FROM_RUN else TransferConfig.make
    return make(asked, checkpoint, options.from_training)


def _transfer(
    config: TransferConfig, options: TransferOptions, folder: RunFolder, show: ShowShare
) -> Mapping[str, Any]:
    del options  # the configuration has them
    gathered = cast(GatheringParameters, config.parameters['gathering'])
    decision = gathered.decision
    per_state = config.simulator.steps_of(decision.steps_per_action, decision.step_ms)
    # Every transfer has a group `transfer` with `steps`.
    training = int(config.parameters['transfer'].to_dict()['steps'])
    whole = gathered.states * per_state + training
    steps = {}  # of the simulator, and of the network's training

    def show_stage(what: str, done: int, of: int) -> None:
        is_driving = what == STATES
        steps[what] = done * per_state if is_driving else done
        repeats = of / (gathered.states if is_driving else training)
        show(sum(steps.values()), sum(steps.values()) / (whole * repeats))

    return report_transfer(config, transfer(config, show_stage), folder)


def _configure_evaluation(
    point: Point, options: EvaluateOptions, checkpoint: str | None
) -> EvaluateConfig:
    taken = {} if checkpoint is None else {f'{point.controller}.checkpoint': checkpoint}
    laps = point._replace(
        seed=point.seed + options.seed_offset, parameters={**point.parameters, **taken}
    )
    courses = (point.course,) if point.course else ()
    driven = {'seeds': options.seeds, 'lanes': options.lanes, 'courses': courses}
    limit = {'simulator.episode.max_laps': options.laps}
    config = EvaluateConfig.make(laps.request(limit), driven)
    if options.record:
        # While runs are planned there are no weights yet to make the controller with.
        known = point if checkpoint == FROM_RUN else laps
        check_recordable(EvaluateConfig.make(known.request(limit), driven), options.record)
    return config


def _evaluate(
    config: EvaluateConfig, options: EvaluateOptions, folder: RunFolder, show: ShowShare
) -> Mapping[str, Any]:
    return evaluate(config, folder, show, options.record)


def _evaluate_together(jobs: Sequence[Job], fail: OnFailure) -> None:
    evaluate_together([Evaluation(*job) for job in jobs], fail)


def _none_together(jobs: Sequence[Job], fail: OnFailure) -> None:
    raise AssertionError('runs without a setting are done alone')


def _groups_of_transfer(controller: str) -> Mapping[str, type[Parameters]]:
    return {
        'simulator': SimulatorParameters,
        'filter': FilterParameters,
        **transfer_class(controller).parameters_classes,
    }


def _groups_of_training(controller: str) -> Mapping[str, type[Parameters]]:
    return {
        **controller_groups(controller),
        'training': training_class(controller).parameters_class,
    }


def _learns(controller: str) -> bool:
    names = {spec.name for spec in controller_class(controller).parameters_class.specs()}
    return 'learning' in names


def controller_groups(controller: str) -> Mapping[str, type[Parameters]]:
    """Return the groups of parameters that there are where a controller drives."""
    own = controller_class(controller).parameters_class
    return {'simulator': SimulatorParameters, 'filter': FilterParameters, controller: own}


TASKS: Mapping[str, Task] = {
    'train': Task(
        options=TrainOptions,
        is_of_conditions=False,
        is_for=_learns,
        groups=_groups_of_training,
        needs=lambda controller: (),
        must_have_need=False,
        requires=lambda controller: training_card(controller).requires,
        configure=_configure_training,
        run=_train,
        setting=setting_key,
        most_together=most_together,
        run_together=_train_together,
    ),
    'transfer': Task(
        options=TransferOptions,
        is_of_conditions=False,
        is_for=lambda controller: card(controller).transfer is not None,
        groups=_groups_of_transfer,
        needs=lambda controller: (Need('train', source_of(controller)),),
        must_have_need=True,
        requires=lambda controller: transfer_card(controller).requires,
        configure=_configure_transfer,
        run=_transfer,
        setting=lambda config: '',
        most_together=lambda config: 1,
        run_together=_none_together,
    ),
    'evaluate': Task(
        options=EvaluateOptions,
        is_of_conditions=True,
        is_for=lambda controller: True,
        groups=controller_groups,
        # Where neither is in the experiment, it drives with the weights shipped.
        needs=lambda controller: (Need('train', controller), Need('transfer', controller)),
        must_have_need=False,
        requires=lambda controller: '',
        configure=_configure_evaluation,
        run=_evaluate,
        setting=setting_key,
        most_together=most_together,
        run_together=_evaluate_together,
    ),
}


def plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values as they are after being written as JSON and read again."""
    return dict(json.loads(json.dumps(values)))


def task_named(name: str) -> Task:
    """Return a task.

    Raises:
        ParameterError: There is no such task.
    """
    if name not in TASKS:
        raise ParameterError(f'task: expected one of {", ".join(TASKS)}, got {name!r}')
    return TASKS[name]
