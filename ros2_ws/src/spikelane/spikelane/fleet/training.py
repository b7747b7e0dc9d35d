"""Trainings in a fleet: seeds of one setting, each with the same bits as alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from spikelane.fleet.fleet import Fleet
from spikelane.fleet.setting import setting
from spikelane.interruption import check
from spikelane.runs.train.config import TrainConfig
from spikelane_controllers.fleet import Journey, make_journey
from spikelane_controllers.learning.training import Start, Training
from spikelane_sim.errors import ParameterError

#: Called with the number of a training that has come on, and its progress along the lane [m].
OnProgress = Callable[[int, float], None]


def train_fleet(
    configs: Sequence[TrainConfig],
    trainings: Sequence[Training],
    show: OnProgress,
    *,
    threads: int = 1,
) -> None:
    """Drive trainings to their ends.

    Args:
        configs: What determines each; they differ in nothing but seed, course and length.
        trainings: Begun or resumed, one for each.
        show: Called as trainings come on.
        threads: How many threads drive them.

    Raises:
        SpikelaneError: They are not trainings of one setting, or a checkpoint cannot be written.
        Interrupted: A signal has come; each can be resumed from its last checkpoint.
    """
    first = configs[0]
    for config in configs[1:]:
        if setting(config) != setting(first):
            raise ParameterError(
                'fleet: expected trainings that differ in seed, course and length alone'
            )
    with Fleet(
        first.controller,
        [config.seed for config in configs],
        simulator=first.simulator,
        parameters=first.controller_parameters.to_dict(),
        courses=[config.simulator.course for config in configs],
        threads=threads,
    ) as fleet:
        for robot, training in enumerate(trainings):
            _begin(fleet, robot, training)
        _drive(fleet, trainings, show)


def _begin(fleet: Fleet, robot: int, training: Training) -> None:
    """Bring a robot to where its training stands, with the training's controller."""
    fleet.host(robot, training.controller, training.reset)
    lane, episode = training.start
    answers = training.answers_to_repeat
    fleet.reset(robot, lane, episode=episode)
    if len(answers):
        fleet.repeat(robot, answers[:-1])
        training.end_repetition(fleet.simulators.lane_state(robot))
        fleet.repeat(robot, answers[-1:])


def _drive(fleet: Fleet, trainings: Sequence[Training], show: OnProgress) -> None:
    journey = make_journey(len(fleet), max(each.parameters.save_every for each in trainings))
    while not all(training.is_done for training in trainings):
        check()
        for robot, training in enumerate(trainings):
            if training.needs_reset:
                fleet.reset(robot)
            journey.wanted[robot] = 0 if training.is_done else training.steps_to_take
        fleet.advance(journey)
        for robot, training in enumerate(trainings):
            if journey.wanted[robot]:
                _take(fleet, robot, training, journey)
                show(robot, fleet.simulators.robots.known['progress_m'][robot])


def _take(fleet: Fleet, robot: int, training: Training, journey: Journey) -> None:
    """Let a training take in what its robot has just done."""
    fleet.controllers.store(robot)  # for the checkpoint
    state = fleet.simulators.lane_state(robot)
    answers = journey.answers[robot, : journey.taken[robot]]
    distance_m = float(journey.distance_m[robot])
    training.take(Start(state.lane, state.episode), distance_m, answers)
    if journey.has_ended[robot]:
        training.end_episode(state)
