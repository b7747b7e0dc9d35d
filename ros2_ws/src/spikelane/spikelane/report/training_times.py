"""When a training had its first lap and drove stably, in steps of 50 ms for all controllers.

A training that did not get there is censored: the time is when it was observed last without it.
"""

from __future__ import annotations

import math

from spikelane.figures.training_time import Time
from spikelane.report.runs import course_of, TrainingRun
from spikelane_sim.contract import STEP_S, TERMINATED_LAPS_COMPLETE


def first_lap(run: TrainingRun) -> Time:
    """Return when the first lap was completed [steps of 50 ms], or the training's end.

    DQN's episodes go on after a lap. Its robot drives at one speed, so that a lap is what an
    episode of the lane's length at that speed has.
    """
    if run.controller != 'dqn':
        laps = (e.step for e in run.terminations if e.reason == TERMINATED_LAPS_COMPLETE)
        first = next(laps, None)
        return Time(float(run.steps), False) if first is None else Time(float(first), True)
    course = course_of(run)
    radius_m = run.config['simulator']['robot.wheel_radius_m']
    per_step_m = run.config['dqn']['task.drive_rad_s'] * radius_m * STEP_S
    driven = 0
    for episode in run.terminations:
        needed = math.ceil(course.lane(episode.lane).length_m / per_step_m)
        if episode.episode_steps >= needed:
            return Time(float(driven + needed), True)
        driven += episode.episode_steps
    return Time(float(driven), False)


def stable(run: TrainingRun) -> Time:
    """Return from when it drove without losing the lane [steps of 50 ms].

    For R-STDP that is its last lane loss, which is censored where it has not settled; for DQN the
    begin of the first three full episodes in a row, or the end of its last episode.
    """
    if run.controller != 'dqn':
        return Time(float(run.last_lane_loss_step), run.has_settled)
    solved = run.solved_episode
    before = run.terminations if solved is None else run.terminations[: solved - 1]
    return Time(float(sum(e.episode_steps for e in before)), solved is not None)
