"""The functions of `import spikelane`: controllers, laps, trainings and evaluations from Python.

Each run is the one of the command of its name, bit for bit, and happens in this process.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from spikelane.finished import load_run, Run
from spikelane.frames import events_frame, spikes_frame, StepSpikes, trajectory_frame
from spikelane.lock import locked
from spikelane.recording.record import (
    check_recordable,
    facts_of,
    recorded,
    Recording,
    RecordStep,
    temporary_recording,
)
from spikelane.requirements import require
from spikelane.runs.configuration import (
    check_seed,
    configured_controller,
    make_groups,
    Request,
)
from spikelane.runs.evaluate.config import EvaluateConfig
from spikelane.runs.evaluate.run import evaluate as run_evaluation
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.config import LapConfig, limit_drive
from spikelane.runs.lap.metrics import lap_metrics
from spikelane.runs.lap.run import drive_with, DrivenLap, report_lap
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import check_training_recordable, train_and_report
from spikelane_controllers import registry
from spikelane_controllers.registry import training_card
from spikelane_controllers.shown import shown_by
from spikelane_sim.contract import Controller, Observation, WheelVelocities
from spikelane_sim.course import load_course
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import Events
from spikelane_sim.filters import FilterParameters
from spikelane_sim.simulator_parameters import SimulatorParameters

#: What drives: its name, or the controller itself.
Driver = str | Controller
#: Weights: the name of shipped ones, the folder of a training, or a training.
Weights = str | Path | Run
Values = Mapping[str, Any]


def make_controller(
    name: str, parameters: Values | None = None, *, checkpoint: Weights | None = None
) -> Controller:
    """Make a controller.

    Args:
        name: 'braitenberg', 'rstdp', 'dqn', 'dqn_snn', or one that another package registers.
        parameters: Its parameters under dotted names, as {'poisson.max_rate_hz': 300}; what is
            absent has its default.
        checkpoint: Weights, for a controller that learns: the name of shipped ones
            ('scenario_1'), a training's folder, or what `train` returned.

    Returns:
        An object with `reset(rng)` and `step(observation)`, which returns the velocities of the
        left and the right wheel [rad/s].

    Raises:
        SpikelaneError: The name or a parameter is unknown, or a value not allowed.
    """
    given = {} if checkpoint is None else {'checkpoint': _weights(checkpoint)}
    return registry.make_controller(name, {**(parameters or {}), **given})


def drive(
    controller: Driver,
    *,
    scenario: str | int = 1,
    lane: str | None = None,
    seed: int = 0,
    checkpoint: Weights | None = None,
    robot: str | None = None,
    engine: str | None = None,
    parameters: Values | None = None,
    record: Sequence[str] = (),
    out: str | Path | None = None,
) -> Run:
    """Drive a lap, as `spikelane lap --transport inprocess`.

    Args:
        controller: Name of a controller, or any object with `reset` and `step`, such as
            `make_controller` returns.
        scenario: The paper's 1, 2 or 3, the path of a course file, or 'random:SEED'.
        lane: 'outer' or 'inner'; None for the course's first.
        seed: Seed of all randomness.
        checkpoint: Weights, as in `make_controller`; None for those shipped for the scenario.
        robot: 'p3dx' or 'turtlebot4'; None for the first.
        engine: 'pybullet', 'rigid' or 'kinematic', what moves the robot; None for the first.
        parameters: Others than the defaults, as {'simulator.camera.fov_deg': 90}; those of a
            controller that is given by its name under that name.
        record: Quantities that the controller is to record, as ['spikes', 'weights'], or ['all'];
            see `Run.recorded`.
        out: Folder that the lap leaves, new or empty; None to write nothing. With a folder the
            controller must be given by its name.

    Returns:
        The lap with `trajectory`, `events`, `spikes` and `metrics`, and `recorded` tables.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    given = _given(robot, engine, parameters)
    if isinstance(controller, str):
        given |= _checkpoint(controller, checkpoint)
        asked = Request(str(scenario), controller, seed, parameters=given)
        config = LapConfig.make(asked, lane)
        return _drive_configured(config, None if out is None else Path(out), tuple(record))
    if out is not None or checkpoint is not None:
        raise ParameterError('out, checkpoint: expected the name of a controller with them')
    return _drive_made(controller, str(scenario), lane, seed, given, tuple(record))


def train(
    controller: str,
    *,
    scenario: str | int = 1,
    seed: int = 0,
    steps: int | None = None,
    robot: str | None = None,
    engine: str | None = None,
    parameters: Values | None = None,
    record: Sequence[str] = (),
    out: str | Path | None = None,
) -> Run:
    """Let a controller learn by driving, as `spikelane train`.

    Args:
        controller: 'rstdp', 'dqn', or one that another package registers.
        scenario: As in `drive`.
        seed: Seed of all randomness.
        steps: Steps of 50 ms to drive, of the deep Q-network's actions of 0.5 s; None for as many
            as usual.
        robot: As in `drive`.
        engine: As in `drive`.
        parameters: As in `drive`; those of the training are in the group `training`.
        record: As in `drive`.
        out: Folder that the training leaves, new or empty; None for `runs/train-...`, numbered
            where it exists.

    Returns:
        The training with `episodes`, `weights` and `metrics`. It is a `checkpoint` for `drive`.

    Raises:
        SpikelaneError: Anything is unknown or not allowed, or what the training
            needs is missing.
    """
    require([training_card(controller).requires])
    given = _given(robot, engine, parameters)
    asked = Request(str(scenario), controller, seed, parameters=given)
    config = TrainConfig.make(asked, steps)
    check_training_recordable(config, record)
    folder = RunFolder.begin(config, None if out is None else Path(out))
    with locked(folder.path):
        train_and_report(config, folder, _show_nothing, resume=False, record=record)
    return load_run(folder.path)


def evaluate(
    controller: str,
    *,
    scenario: str | int = 1,
    seeds: int = 1,
    seed: int = 0,
    lanes: Sequence[str] = (),
    courses: Sequence[str] = (),
    checkpoint: Weights | None = None,
    robot: str | None = None,
    engine: str | None = None,
    parameters: Values | None = None,
    record: Sequence[str] = (),
    out: str | Path | None = None,
) -> Run:
    """Measure a controller over laps and seeds, as `spikelane evaluate`.

    Args:
        controller: Its name.
        scenario: As in `drive`.
        seeds: How many seeds each lane is driven with.
        seed: The first of them.
        lanes: Names of the lanes; none for every lane of a course.
        courses: Courses; none for the scenario's. 'random:100': a hundred random ones.
        checkpoint: As in `drive`.
        robot: As in `drive`.
        engine: As in `drive`.
        parameters: As in `drive`.
        record: As in `drive`; each lap's folder in `laps` has its `recording.nc`.
        out: Folder that the evaluation leaves, new or empty; None for `runs/evaluate-...`,
            numbered where it exists.

    Returns:
        The evaluation with `laps` and `metrics`, whose `summary` has means and intervals.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    given = _given(robot, engine, parameters) | _checkpoint(controller, checkpoint)
    what = {'seeds': seeds, 'lanes': tuple(lanes), 'courses': tuple(courses)}
    asked = Request(str(scenario), controller, seed, parameters=given)
    config = EvaluateConfig.make(asked, what)
    check_recordable(config, record)
    folder = RunFolder.begin(config, None if out is None else Path(out))
    with locked(folder.path):
        run_evaluation(config, folder, _show_nothing, record)
    return load_run(folder.path)


def _drive_configured(config: LapConfig, out: Path | None, record: tuple[str, ...]) -> Run:
    """Drive a lap with a controller that is known by its name."""
    check_recordable(config, record)
    folder = None if out is None else RunFolder.begin(config, out)
    controller = configured_controller(config)
    recording, keep = None, None
    if record and folder is not None:
        recording = Recording(folder.recording, record)
    elif record:
        recording, keep = temporary_recording(record)
    with recorded(controller, recording, facts_of(config)) as record_step:
        watch = _Watch(controller, record_step)
        driven = drive_with(
            controller, config.simulator, config.filter, config.lane, config.seed, watch
        )
    if folder is None:
        metrics = lap_metrics(driven.trajectory, config.simulator.period_s)
    else:
        metrics = report_lap(config, driven, folder)
    path = None if folder is None else folder.path
    file = None if recording is None else recording.path
    return Run(path, config.to_dict(), metrics, watch.tables(driven), file, keep)


def _drive_made(
    controller: Controller,
    scenario: str,
    lane: str | None,
    seed: int,
    given: Values,
    record: tuple[str, ...],
) -> Run:
    """Drive a lap with any object that is a controller."""
    check_seed(seed)
    classes = {'simulator': SimulatorParameters, 'filter': FilterParameters}
    groups = make_groups(given, classes, scenario)
    parameters, filters = groups['simulator'], groups['filter']
    course = load_course(parameters.course)
    lane = course.lane(lane).name if lane else next(iter(course.lanes))
    length_m = max(each.length_m for each in course.lanes.values())
    parameters = limit_drive(parameters, given, length_m)
    recording, keep = temporary_recording(record) if record else (None, None)
    name = type(controller).__name__
    facts = {
        'controller': name,
        'scenario': scenario,
        'seed': seed,
        'period_ms': parameters.period_ms,
    }
    with recorded(controller, recording, facts) as record_step:
        watch = _Watch(controller, record_step)
        driven = drive_with(controller, parameters, filters, lane, seed, watch)
    file = None if recording is None else recording.path
    config = {
        'scenario': scenario,
        'controller': name,
        'lane': lane,
        'seed': seed,
        'simulator': parameters.to_dict(),
        'filter': filters.chosen(),
    }
    metrics = lap_metrics(driven.trajectory, parameters.period_s)
    return Run(None, config, metrics, watch.tables(driven), file, keep)


class _Watch:
    """Keeps the events and spikes of a drive, and has its steps recorded."""

    def __init__(self, controller: Controller, record_step: RecordStep) -> None:
        self._controller = controller
        self._record_step = record_step
        self._events: dict[int, Events] = {}
        self._spikes: dict[int, StepSpikes] = {}

    def __call__(self, observation: Observation, wheels: WheelVelocities) -> None:
        self._record_step(observation)
        shown = shown_by(self._controller)
        self._events[observation.stamp_ns] = observation.events
        self._spikes[observation.stamp_ns] = StepSpikes(shown.neurons, shown.spikes)

    def tables(self, driven: DrivenLap) -> dict[str, pd.DataFrame]:
        """Return the tables of a lap, by the name of `Run`'s property."""
        return {
            'trajectory': trajectory_frame(driven.trajectory),
            'events': events_frame(self._events),
            'spikes': spikes_frame(self._spikes),
        }


def _given(robot: str | None, engine: str | None, parameters: Values | None) -> dict[str, Any]:
    """Return the parameters that were given under dotted names."""
    own = {'simulator.robot.model': robot, 'simulator.robot.engine': engine}
    chosen = {name: value for name, value in own.items() if value is not None}
    return {**(parameters or {}), **chosen}


def _checkpoint(controller: str, checkpoint: Weights | None) -> dict[str, str]:
    """Return the parameter that given weights are."""
    return {} if checkpoint is None else {f'{controller}.checkpoint': _weights(checkpoint)}


def _weights(checkpoint: Weights) -> str:
    """Return the name of shipped weights, or the path of others.

    Raises:
        ParameterError: They are of a run that left no folder.
    """
    if not isinstance(checkpoint, Run):
        return str(checkpoint)
    if checkpoint.folder is None:
        raise ParameterError(f'checkpoint: expected a training, got {checkpoint!r}')
    return str(checkpoint.folder.absolute())


def _show_nothing(steps: int, progress: float) -> None:
    """Show no progress."""
