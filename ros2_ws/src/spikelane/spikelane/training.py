"""Training a controller: what determines it, training in-process, and what it leaves."""

from __future__ import annotations

from collections.abc import Mapping
import csv
import dataclasses
import io
from pathlib import Path
import time
from typing import Any, cast, NamedTuple, TYPE_CHECKING

from spikelane.configuration import (
    Configuration,
    configure,
    configured_controller,
)
from spikelane.interruption import check
from spikelane.lap import Show
from spikelane.run_folder import RunFolder
from spikelane.settling import has_settled, last_lane_loss_step
from spikelane_controllers.learning_controller import (
    check_can_learn,
    check_learning_parameters,
    LearningController,
)
from spikelane_controllers.registry import controller_class, training_class
from spikelane_controllers.rstdp_training import PlasticTraining
from spikelane_controllers.scalars import LOG_FOLDER, ScalarLog
from spikelane_controllers.states import read_states
from spikelane_controllers.training import (
    Termination,
    Training,
    TrainingParameters,
)
from spikelane_sim.contract import controller_rng, TERMINATED_LANE_LOST, TERMINATED_LAPS_COMPLETE
from spikelane_sim.course import course_label, load_course
from spikelane_sim.encoding import EncodingParameters
from spikelane_sim.files import write_text_atomically
from spikelane_sim.simulator import Simulator

if TYPE_CHECKING:
    from spikelane_controllers.dqn_training import DqnTraining
    from spikelane_controllers.rstdp import RStdpParameters

#: What training differs in from driving a lap, by controller (paper sections 3.4 and 4.4).
TRAINING_DEFAULTS: Mapping[str, Mapping[str, Any]] = {
    'rstdp': {
        'simulator.episode.max_distance_m': 0.2,
        'simulator.episode.max_laps': 1,
        'rstdp.learning': True,
        'rstdp.checkpoint': '',
    },
    'dqn': {
        'simulator.episode.max_distance_m': 0.5,
        'simulator.episode.max_laps': 0,
        'simulator.episode.max_steps': 10_000,  # 1,000 actions
        'dqn.learning': True,
        'dqn.checkpoint': '',
    },
}


def training_defaults(controller: str) -> Mapping[str, Any]:
    """Return what training differs in from driving a lap; of other packages', only that it is."""
    learns = {f'{controller}.learning': True, f'{controller}.checkpoint': ''}
    return TRAINING_DEFAULTS.get(controller, learns)


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
        parameters: Others than the defaults of training.
        steps: To drive, as the controller's training counts them; None for as many as usual.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    cls = training_class(controller).parameters_class
    known = controller_class(controller).parameters_class.specs()
    check_learning_parameters(controller, {spec.name: spec for spec in known})
    parameters = {**training_defaults(controller), **parameters}
    parts = configure(scenario, controller, seed, transport, parameters)
    return TrainConfig(training=cls() if steps is None else cls(steps=steps), **parts)


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


def train(config: TrainConfig, folder: RunFolder, show: Show, *, resume: bool) -> Training:
    """Train in this process.

    Args:
        config: What to train.
        folder: Where checkpoints go.
        show: Called after every step.
        resume: Whether to go on from the folder's checkpoint.

    Raises:
        SpikelaneError: As in `make_training`, or a checkpoint cannot be written.
        Interrupted: A signal has come; the training can be resumed from its last checkpoint.
    """
    training = make_training(config, folder, resume=resume)
    ScalarLog(folder.path / LOG_FOLDER, training, time.monotonic)
    with Simulator(config.simulator) as simulator:
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


class Report(NamedTuple):
    """What the training of one kind of controller leaves beside what all leave."""

    metrics: dict[str, Any]
    columns: list[dict[str, Any]]  # of each episode, beside those of its termination
    figures: tuple[Path, ...]


def report_training(
    config: TrainConfig, training: Training, folder: RunFolder, wall_time_s: float | None
) -> dict[str, Any]:
    """Write the episodes, metrics and figures of a training.

    Returns:
        The metrics and where everything is, ready for JSON.
    """
    title = f'{config.controller}, scenario {config.scenario}, seed {config.seed}'
    report = _REPORTS.get(config.controller, _report_any)(config, training, folder, title)
    _write_episodes(training.terminations, report.columns, folder.episodes)
    result = {
        'scenario': config.scenario,
        'controller': config.controller,
        'seed': config.seed,
        'transport': config.transport,
        'robot': config.simulator.robot.model,
        'pixels': config.simulator.pixels.model,
        'antialias': config.simulator.camera.antialias,
        **training_metrics(training),
        **report.metrics,
        'wall_time_s': wall_time_s,
        'folder': str(folder.path),
        'checkpoint': str(folder.checkpoint),
        'figures': [str(figure) for figure in report.figures],
    }
    folder.write_metrics(result)
    return result


def _report_any(config: TrainConfig, training: Training, folder: RunFolder, title: str) -> Report:
    from spikelane.figures.terminations import draw_terminations

    course = load_course(config.simulator.course)
    figures = draw_terminations(training, course, folder.figures / 'terminations', title)
    return Report({}, [{} for _ in training.terminations], tuple(figures))


def _report_plastic(
    config: TrainConfig, training: Training, folder: RunFolder, title: str
) -> Report:
    from spikelane.figures.terminations import draw_terminations
    from spikelane.figures.weights import draw_weights

    watched = cast(PlasticTraining, training)
    course = load_course(config.simulator.course)
    figures = (
        *draw_weights(watched, _encoding(config), folder.figures / 'weights', title),
        *draw_terminations(training, course, folder.figures / 'terminations', title),
    )
    metrics = {'braitenberg_correlation': _braitenberg_correlation(config, watched)}
    return Report(metrics, [{} for _ in training.terminations], figures)


def _report_dqn(config: TrainConfig, training: Training, folder: RunFolder, title: str) -> Report:
    from spikelane.dqn_results import dqn_metrics, episode_columns
    from spikelane.figures.episodes import draw_episodes
    from spikelane.figures.state_images import draw_state_images

    learnt = cast('DqnTraining', training)
    lanes = tuple(load_course(config.simulator.course).lanes)
    figures = draw_episodes(learnt, lanes, folder.figures / 'episodes', title)
    if len(states := read_states(folder.path)):
        figures += draw_state_images(states, folder.figures / 'state_images', title)
    return Report(dqn_metrics(learnt), episode_columns(learnt.outcomes), figures)


_REPORTS = {'rstdp': _report_plastic, 'dqn': _report_dqn}


def training_metrics(training: Training) -> dict[str, Any]:
    """Measure a training.

    Returns:
        steps: Steps driven.
        episodes: Episodes ended.
        lane_losses: Those that ended with the lane lost.
        last_lane_loss_step: Step of the last of them, 0 where there was none.
        settled: Whether every lane was driven in full after it (`settling.has_settled`); where
            not, it is only the last one so far.
        laps_since: Laps completed after it, by lane.
    """
    last = last_lane_loss_step(training.terminations)
    lost = [each for each in training.terminations if each.reason == TERMINATED_LANE_LOST]
    since = [
        each.lane
        for each in training.terminations
        if each.reason == TERMINATED_LAPS_COMPLETE and each.step > last
    ]
    return {
        'steps': training.steps,
        'episodes': len(training.terminations),
        'lane_losses': len(lost),
        'last_lane_loss_step': last,
        'settled': has_settled(training.terminations),
        'laps_since': {lane: since.count(lane) for lane in sorted(set(since))},
    }


def _encoding(config: TrainConfig) -> EncodingParameters:
    """Return how the learning controller's inputs are made."""
    return cast('RStdpParameters', config.controller_parameters).encoding


def _braitenberg_correlation(
    config: TrainConfig, training: PlasticTraining
) -> dict[str, float | None] | None:
    """Compare the weights with those set by hand; None where the inputs are others."""
    from spikelane.figures.weights import weights_correlation

    if _encoding(config) != EncodingParameters():
        return None
    return weights_correlation(training.controller.weights_pa, training.weight_history[0])


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
