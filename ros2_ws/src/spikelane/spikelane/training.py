"""Training a controller: what determines it, training in-process, and what it leaves."""

from __future__ import annotations

from collections.abc import Mapping
import contextlib
import csv
import dataclasses
import io
from pathlib import Path
import time
from typing import Any, cast

from spikelane.configuration import (
    Configuration,
    configure,
    configured_controller,
)
from spikelane.interruption import check
from spikelane.lap import OnLapProgress
from spikelane.run_folder import RunFolder
from spikelane.transport import over_ros
from spikelane_controllers.learning.learning_controller import (
    check_can_learn,
    check_learning_parameters,
    LearningController,
)
from spikelane_controllers.learning.results import (
    FinishedRun,
    NothingToDrawError,
    TrainingResults,
)
from spikelane_controllers.learning.scalar_log import LOG_FOLDER, ScalarLog
from spikelane_controllers.learning.training import Termination, Training, TrainingParameters
from spikelane_controllers.registry import (
    controller_class,
    title,
    training_card,
    training_class,
    training_results,
)
from spikelane_sim.contract import controller_rng, sensors_of
from spikelane_sim.course import course_label
from spikelane_sim.errors import ParameterError
from spikelane_sim.files import write_text_atomically
from spikelane_sim.simulator import Simulator

#: What the names of the simulator's parameters begin with.
_SIMULATOR = 'simulator.'
#: What those of the training begin with.
_TRAINING = 'training.'
_STEPS = 'training.steps'


def training_defaults(controller: str) -> Mapping[str, Any]:
    """Return the parameters whose defaults are different in a training.

    Raises:
        ParameterError: No controller that learns by driving has this name.
    """
    given = training_card(controller).defaults.items()
    return {
        **{
            name if name.startswith(_SIMULATOR) else f'{controller}.{name}': v for name, v in given
        },
        f'{controller}.learning': True,
        f'{controller}.checkpoint': '',
    }


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainConfig(Configuration):
    """Everything that determines a training.

    Attributes:
        training: How long it takes and how often it is saved.
    """

    training: TrainingParameters

    @property
    def usual_name(self) -> str:
        """As in `run_folder.Run`."""
        return f'train-{self.controller}-{course_label(self.scenario)}-seed{self.seed}'

    def check(self) -> None:
        """Make sure that there is what learns.

        Raises:
            SpikelaneError: The controller cannot be made or trained, or its node not be started.
        """
        super().check()
        _learning_controller(self)


def make_config(
    scenario: str,
    controller: str,
    seed: int,
    transport: str,
    parameters: Mapping[str, Any],
    steps: int | None = None,
) -> TrainConfig:
    """Make the configuration of a training: see `configure`.

    Args:
        scenario: As in Configuration.
        controller: As in Configuration, one that learns.
        seed: As in Configuration.
        transport: As in Configuration.
        parameters: Others than the defaults of training; those of its length and its checkpoints
            are in the group `training`.
        steps: Value of `training.steps`; None for as many as usual, or as in the parameters.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    cls = training_class(controller).parameters_class
    known = controller_class(controller).parameters_class.specs()
    check_learning_parameters(controller, {spec.name: spec for spec in known})
    if steps is not None and _STEPS in parameters:
        raise ParameterError(f'{_STEPS}: expected either --steps or the parameter, got both')
    given = {
        **training_defaults(controller),
        **parameters,
        **({} if steps is None else {_STEPS: steps}),
    }
    own = {
        name.removeprefix(_TRAINING): value
        for name, value in given.items()
        if name.startswith(_TRAINING)
    }
    return TrainConfig(
        given={**parameters, **({} if steps is None else {_STEPS: steps})},
        training=cls.from_mapping(own, 'training'),
        **configure(scenario, controller, seed, transport, given, ('training',)),
    )


def make_training(config: TrainConfig, folder: RunFolder, *, resume: bool) -> Training:
    """Make the controller in training, new or as its last checkpoint left it.

    Raises:
        SpikelaneError: There is no checkpoint to resume from, or of another training.
    """
    training = training_class(config.controller)(
        config.controller,
        _learning_controller(config),
        config.training,
        _identity(config),
        folder.checkpoint,
    )
    if resume:
        training.resume()
    else:
        training.begin(config.seed)
    return training


def _learning_controller(config: TrainConfig) -> LearningController:
    controller = configured_controller(config)
    check_can_learn(config.controller, controller)
    return cast(LearningController, controller)


def train(
    config: TrainConfig, folder: RunFolder, show: OnLapProgress, *, resume: bool
) -> Training:
    """Train in this process or over ROS, as the configuration says.

    Args:
        config: What to train.
        folder: Where checkpoints go.
        show: Called after every step, over ROS about once a second.
        resume: Whether to go on from the folder's checkpoint.

    Raises:
        SpikelaneError: As in `make_training`, or a checkpoint cannot be written.
        Interrupted: A signal has come; the training can be resumed from its last checkpoint.
    """
    if config.transport == 'ros':
        trained: Training = over_ros('training', 'train_over_ros')(
            config, folder, show, resume=resume
        )
        return trained
    training = make_training(config, folder, resume=resume)
    ScalarLog(folder.path / LOG_FOLDER, training, time.monotonic)
    sensors = sensors_of(controller_class(config.controller))
    with Simulator(config.simulator, sensors=sensors) as simulator:
        lane, episode = training.start
        observation = simulator.reset(lane, config.seed, episode=episode)
        while not training.is_done:
            state = observation.lane
            assert state is not None  # a simulator always knows it
            if state.step == 0:
                training.reset(controller_rng(config.seed, state.episode))
            wheels = training.step(observation)
            show(training.steps, state.progress_m)
            check()
            observation = simulator.reset() if state.terminated else simulator.step(wheels)
    return training


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
        'scenario': config.scenario,
        'controller': config.controller,
        'seed': config.seed,
        'transport': config.transport,
        'robot': config.simulator.robot.model,
        'engine': config.simulator.robot.engine,
        'pixels': config.simulator.pixels.model,
        'antialias': config.simulator.camera.antialias,
        **results.metrics(),
        'wall_time_s': wall_time_s,
        'folder': str(folder.path),
        'checkpoint': str(folder.checkpoint),
        'figures': [str(file) for file in _draw(results, folder.figures, name)],
    }
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
    """Return what must be the same to go on with a training: all but where and how long."""
    values = config.to_dict()
    del values['transport'], values['training']
    return {**values, 'save_every': config.training.save_every}


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
