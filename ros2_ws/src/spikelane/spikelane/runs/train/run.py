"""Training a controller, in this process or over ROS, and what it leaves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import contextlib
import csv
import io
from pathlib import Path
import time
from typing import Any, NamedTuple

from spikelane.fleet import setting as fleet_setting
from spikelane.fleet.setting import has_kernel
from spikelane.fleet.training import train_fleet
from spikelane.interruption import check
from spikelane.recording.record import check_recordable, facts_of, recorded, Recording
from spikelane.runs.folder import RunFolder
from spikelane.runs.input_files import input_digests
from spikelane.runs.output import OnProgress
from spikelane.runs.train.config import learning_controller, TrainConfig
from spikelane.runs.transport import over_ros
from spikelane_controllers.learning.results import (
    FinishedRun,
    NothingToDrawError,
    TrainingResults,
)
from spikelane_controllers.learning.scalar_log import LOG_FOLDER, ScalarLog
from spikelane_controllers.learning.training import INPUTS, Termination, Training
from spikelane_controllers.registry import (
    controller_class,
    title,
    training_class,
    training_results,
)
from spikelane_sim.contract import controller_rng, sensors_of
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.files import write_text_atomically
from spikelane_sim.filters import FilterStage
from spikelane_sim.simulator import Simulator


def make_training(config: TrainConfig, folder: RunFolder, *, resume: bool) -> Training:
    """Make the controller in training, new or as its last checkpoint left it.

    Raises:
        SpikelaneError: There is no checkpoint to resume from, or of another training.
    """
    training = training_class(config.controller)(
        config.controller,
        learning_controller(config),
        config.training,
        _identity(config),
        folder.checkpoint,
    )
    if resume:
        training.resume()
    else:
        training.begin(config.seed)
    return training


def check_training_recordable(
    config: TrainConfig, record: Sequence[str], *, resume: bool = False
) -> None:
    """Check that the controller offers what is to be recorded, and that it can be.

    Raises:
        SpikelaneError: It cannot.
    """
    check_recordable(config, record)
    if record and config.transport != 'inprocess':
        raise ParameterError(
            'record: expected a training in this process (--transport inprocess), which learns '
            f'the same bit for bit, got {config.transport}'
        )
    if record and resume:
        raise ParameterError(
            'record: expected a training that begins, as its recording has every step, '
            'got one that is resumed'
        )


def train_and_report(
    config: TrainConfig,
    folder: RunFolder,
    show: OnProgress,
    *,
    resume: bool,
    viewer: Mapping[str, Any] | None = None,
    record: Sequence[str] = (),
) -> dict[str, Any]:
    """Train as `train` does, and report as `report_training` does."""
    start_s = time.monotonic()
    train(config, folder, show, resume=resume, viewer=viewer, record=record)
    return report_training(config, folder, None if resume else time.monotonic() - start_s)


class TrainingRun(NamedTuple):
    """A training in its folder.

    Attributes:
        config: What to train.
        folder: Where it goes; a checkpoint in it is gone on with.
        show: Called as it comes on.
    """

    config: TrainConfig
    folder: RunFolder
    show: OnProgress


class _Begun(NamedTuple):
    run: TrainingRun
    training: Training
    is_resumed: bool


def train_together(
    runs: Sequence[TrainingRun], fail: Callable[[RunFolder, SpikelaneError], None]
) -> None:
    """Train in a fleet, and report, as `train_and_report` does of each alone.

    Args:
        runs: Trainings of one setting (`fleet.setting`).
        fail: Called with the folder of a training that fails, while the others go on.

    Raises:
        SpikelaneError: They are not of one setting, or the kernel has failed.
        Interrupted: A signal has come; each can be resumed from its last checkpoint.
    """
    start_s = time.monotonic()
    begun: list[_Begun] = []
    for run in runs:
        is_resumed = run.folder.checkpoint.exists()
        try:
            training = _make_logged_training(run.config, run.folder, resume=is_resumed)
        except SpikelaneError as error:
            fail(run.folder, error)
        else:
            begun.append(_Begun(run, training, is_resumed))
    if not begun:
        return
    if sum(each.training.observations_left for each in begun) < fleet_setting.LEAST_STEPS:
        _train_one_by_one(begun, fail)
        return
    lost: set[int] = set()

    def lose(robot: int, error: SpikelaneError) -> None:
        lost.add(robot)
        fail(begun[robot].run.folder, error)

    train_fleet(
        [each.run.config for each in begun],
        [each.training for each in begun],
        lambda robot, progress_m: begun[robot].run.show(begun[robot].training.steps, progress_m),
        fail=lose,
    )
    took_s = time.monotonic() - start_s
    for robot, (run, _, is_resumed) in enumerate(begun):
        check()
        if robot not in lost:
            try:
                report_training(run.config, run.folder, None if is_resumed else took_s)
            except SpikelaneError as error:
                fail(run.folder, error)


def _train_one_by_one(
    begun: Sequence[_Begun], fail: Callable[[RunFolder, SpikelaneError], None]
) -> None:
    """Train so few steps that a kernel is not worth being compiled."""
    for run, training, is_resumed in begun:
        start_s = time.monotonic()
        try:
            _train_alone(run.config, run.folder, training, run.show)
            took_s = time.monotonic() - start_s
            report_training(run.config, run.folder, None if is_resumed else took_s)
        except SpikelaneError as error:
            fail(run.folder, error)


def _make_logged_training(config: TrainConfig, folder: RunFolder, *, resume: bool) -> Training:
    """Make a training as `make_training` does, with its log for TensorBoard."""
    training = make_training(config, folder, resume=resume)
    ScalarLog(folder.path / LOG_FOLDER, training, time.monotonic)
    return training


def train(
    config: TrainConfig,
    folder: RunFolder,
    show: OnProgress,
    *,
    resume: bool,
    viewer: Mapping[str, Any] | None = None,
    record: Sequence[str] = (),
) -> Training:
    """Train in this process or over ROS, as the configuration says.

    Args:
        config: What to train.
        folder: Where checkpoints go, and over ROS logs and node parameters.
        show: Called after every step, in a kernel every 100 steps, over ROS about once a second.
        resume: Whether to go on from the folder's checkpoint.
        viewer: Parameters of a viewer that is to watch, over ROS; None: there is none.
        record: Quantities that the controller is to record, in this process.

    Raises:
        SpikelaneError: As in `make_training`, or a file cannot be written.
        Interrupted: A signal has come; the training can be resumed from its last checkpoint.
    """
    if config.transport != 'inprocess':
        trained: Training = over_ros('train.nodes.training', 'train_over_ros')(
            config, folder, show, resume=resume, viewer=viewer
        )
        return trained
    training = _make_logged_training(config, folder, resume=resume)
    is_long = training.observations_left >= fleet_setting.LEAST_STEPS
    if is_long and not record and has_kernel(config):
        # The same bits, sooner; a recording needs every step.
        train_fleet([config], [training], lambda _, progress_m: show(training.steps, progress_m))
    else:
        _train_alone(config, folder, training, show, record)
    return training


def _train_alone(
    config: TrainConfig,
    folder: RunFolder,
    training: Training,
    show: OnProgress,
    record: Sequence[str] = (),
) -> None:
    """Train in this process observation by observation."""
    sensors = sensors_of(controller_class(config.controller))
    asked = Recording(folder.recording, tuple(record)) if record else None
    with (
        recorded(training.controller, asked, facts_of(config)) as record_step,
        Simulator(config.simulator, sensors=sensors) as simulator,
    ):
        camera = config.simulator.camera
        stage = FilterStage(config.filter, camera.width, camera.height)
        lane, episode = training.start
        observation = simulator.reset(lane, config.seed, episode=episode)
        while not training.is_done:
            state = observation.lane
            assert state is not None  # a simulator always knows it
            if state.step == 0:
                training.reset(controller_rng(config.seed, state.episode))
            wheels = training.step(stage.observe(observation))
            record_step(observation)
            show(training.steps, state.progress_m)
            check()
            observation = simulator.reset() if state.terminated else simulator.step(wheels)


def report_training(
    config: TrainConfig, folder: RunFolder, wall_time_s: float | None
) -> dict[str, Any]:
    """Write the episodes, metrics and figures of a training that has just ended.

    Returns:
        The metrics and where everything is, ready for JSON.
    """
    run = FinishedRun(config.controller, folder.path, config.to_dict(), {})
    results = training_results(config.controller)(run)
    _write_episodes(results.terminations, results.episode_columns(), folder.episodes)
    name = f'{title(config.controller)}, scenario {config.scenario}, seed {config.seed}'
    result = {
        **config.facts(),
        **results.metrics(),
        'wall_time_s': wall_time_s,
        'folder': str(folder.path),
        'checkpoint': str(folder.checkpoint),
        'figures': [str(file) for file in _draw(results, folder.figures, name)],
    }
    if folder.recording.exists():
        # Whoever records nothing need not wait for HDF5.
        from spikelane.recording.figure import draw_recording

        result['recording'] = str(folder.recording)
        drawn = draw_recording(folder.recording, folder.figures / 'recording.png', name)
        result['figures'].extend(map(str, drawn))
    folder.write_metrics(result)
    return result


def _draw(results: TrainingResults, folder: Path, name: str) -> list[Path]:
    """Draw what there is to be drawn."""
    files: list[Path] = []
    for figure in results.figures():
        with contextlib.suppress(NothingToDrawError):
            files.extend(figure.draw(folder / figure.name, name))
    return files


def _identity(config: TrainConfig) -> dict[str, Any]:
    """Return what must be the same to resume a training: all but its place and length.

    What is in the files that it names is part of it.
    """
    values = config.to_dict()
    inputs = input_digests(values)
    del values['transport'], values['training']
    if inputs:
        values[INPUTS] = inputs
    # Without filters this is what it was before there were any.
    return {**values, 'filter': config.filter.chosen(), 'save_every': config.training.save_every}


def _write_episodes(
    terminations: list[Termination], columns: list[dict[str, Any]], path: Path
) -> None:
    names = [*Termination._fields, *(columns[0] if columns else ())]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(names)
    for termination, others in zip(terminations, columns, strict=True):
        writer.writerow([*termination, *others.values()])
    write_text_atomically(path, text.getvalue())
