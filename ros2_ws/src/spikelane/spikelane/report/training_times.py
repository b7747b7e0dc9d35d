"""When a training had its first lap and drove stably, in steps of 50 ms for all controllers."""

from __future__ import annotations

import math

from spikelane.report.runs import course_of, TrainingRun
from spikelane_sim.contract import STEP_S, TERMINATED_LAPS_COMPLETE


def first_lap_step(run: TrainingRun) -> float | None:
    """Return when the first lap was completed [steps of 50 ms], None where none was.

    DQN's episodes go on after a lap. Its robot drives at one speed, so that a lap is what an
    episode of the lane's length at that speed has.
    """
    if run.controller != 'dqn':
        laps = (e.step for e in run.terminations if e.reason == TERMINATED_LAPS_COMPLETE)
        return next((float(step) for step in laps), None)
    course = course_of(run)
    radius_m = run.config['simulator']['robot.wheel_radius_m']
    per_step_m = run.config['dqn']['task.drive_rad_s'] * radius_m * STEP_S
    driven = 0
    for episode in run.terminations:
        needed = math.ceil(course.lane(episode.lane).length_m / per_step_m)
        if episode.episode_steps >= needed:
            return float(driven + needed)
        driven += episode.episode_steps
    return None


def stable_step(run: TrainingRun) -> float | None:
    """Return when it drove without losing the lane [steps of 50 ms], None where it never did."""
    if run.controller != 'dqn':
        return float(run.last_lane_loss_step) if run.has_settled else None
    if run.solved_episode is None:
        return None
    return float(sum(e.episode_steps for e in run.terminations[: run.solved_episode - 1]))
