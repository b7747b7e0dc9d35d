"""Trainings in a fleet: seeds of one setting, each with the same bits as alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import contextlib

import numpy as np

from spikelane.fleet.fleet import Fleet
from spikelane.fleet.setting import fleet_of
from spikelane.interruption import check
from spikelane.runs.train.config import TrainConfig
from spikelane_controllers.fleet import Journey, make_journey
from spikelane_controllers.learning.training import Start, Training
from spikelane_sim.errors import SpikelaneError

#: That a robot answers before it is the next one's turn: their records stay small.
_MOST_OBSERVATIONS = 1000

#: Called with the number of a training that has come on, and its progress along the lane [m].
OnProgress = Callable[[int, float], None]

#: Called with the number of a training that has failed, and why.
OnFailure = Callable[[int, SpikelaneError], None]


def train_fleet(
    configs: Sequence[TrainConfig],
    trainings: Sequence[Training],
    show: OnProgress,
    *,
    threads: int = 1,
    fail: OnFailure | None = None,
) -> None:
    """Drive trainings to their ends.

    Args:
        configs: What determines each; they differ in nothing but seed, course and length.
        trainings: Begun or resumed, one for each.
        show: Called as trainings come on.
        threads: How many threads drive them.
        fail: Called with a training that cannot go on, while the others do; None for an error.

    Raises:
        SpikelaneError: They are not trainings of one setting, or the kernel has failed. Without
            `fail`, also where a checkpoint cannot be written, or an episode is not the same again.
        Interrupted: A signal has come; each can be resumed from its last checkpoint.
    """
    with fleet_of(configs, threads) as fleet:
        attempts = _Attempts(fail)
        for robot, training in enumerate(trainings):
            with attempts.of(robot):
                _begin(fleet, robot, training)
        _drive(fleet, trainings, show, attempts)


class _Attempts:
    """Keeps the failure of one training from ending the others.

    Attributes:
        lost: Trainings that have failed.
    """

    def __init__(self, fail: OnFailure | None) -> None:
        self.lost: set[int] = set()
        self._fail = fail

    @contextlib.contextmanager
    def of(self, robot: int) -> Iterator[None]:
        """Do something for one training."""
        try:
            yield
        except SpikelaneError as error:
            if self._fail is None:
                raise
            self.lost.add(robot)
            self._fail(robot, error)


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


def _drive(
    fleet: Fleet, trainings: Sequence[Training], show: OnProgress, attempts: _Attempts
) -> None:
    journey = make_journey(len(fleet), _MOST_OBSERVATIONS)
    while True:
        check()
        journey.wanted[:] = 0
        for robot, training in enumerate(trainings):
            if robot in attempts.lost or training.is_done:
                continue
            if training.needs_reset:
                fleet.reset(robot)
            journey.wanted[robot] = min(training.observations_to_take, _MOST_OBSERVATIONS)
        if not journey.wanted.any():
            return
        fleet.advance(journey)
        for robot in np.flatnonzero(journey.wanted).tolist():
            training = trainings[robot]
            with attempts.of(robot):
                _take(fleet, robot, training, journey)
                show(robot, fleet.simulators.robots.known['progress_m'][robot])


def _take(fleet: Fleet, robot: int, training: Training, journey: Journey) -> None:
    """Let a training take in what its robot has just done."""
    fleet.controllers.store(robot)  # for the checkpoint
    state = fleet.simulators.lane_state(robot)
    answers = journey.answers[robot, : journey.taken[robot]]
    distance_m = float(journey.distance_m[robot])
    has_ended = bool(journey.has_ended[robot])
    taken_in = fleet.controllers.taken_in(robot)
    training.take(
        Start(state.lane, state.episode), distance_m, answers, taken_in, has_ended=has_ended
    )
    if has_ended:
        training.end_episode(state)
