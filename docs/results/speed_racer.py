"""R-STDP on the racer at 4 m/s: training in stages, and weights that are chosen by laps.

At this speed the weights go on changing after the robot can lap, and the last ones are not the
best. In the stages at full speed, each training is interrupted again and again for laps with
learning off. Of its weights at these times, those are kept with which most of the laps are
completed, and of these the ones with the smallest error.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from shared.driving import LANES
from shared.parts import Rows
from speed_driving import drive, laps_in_fleet, learn, learning_fleet, weights_of
from speed_settings import RACER_URDF, Setting, TRAINED

from spikelane_sim.contract import TERMINATED_LAPS_COMPLETE

SEEDS = range(10)
#: Full speed asked for on a straight lane.
FULL_M_S = 4.42
#: First seeds of the laps that weights are chosen by; the laps of the table have other seeds.
CHOICE_SEEDS = (5000, 6000)


class Stage(NamedTuple):
    """A part of the training.

    Attributes:
        asked_m_s: Speed asked for on a straight lane.
        c_r: The reward.
        seconds: How long.
        choices: How often weights are looked at in this time.
    """

    asked_m_s: float
    c_r: float
    seconds: float
    choices: int = 0


STAGES = (
    Stage(2.0, 0.08, 400.0),
    Stage(2.8, 0.08, 400.0),
    Stage(3.6, 0.08, 400.0),
    Stage(FULL_M_S, 0.08, 600.0, 6),
    Stage(FULL_M_S, 0.016, 600.0, 6),
    Stage(FULL_M_S, 0.004, 300.0, 3),
)


class Choice(NamedTuple):
    """Weights, and how well the robot drives with them; the larger of two is the better one.

    Attributes:
        completed: How many laps were.
        negative_error_m: Mean error of all laps [m], with the opposite sign.
        weights_pa: Weights [pA].
    """

    completed: int
    negative_error_m: float
    weights_pa: NDArray[np.float64]


def racer(scenario: int) -> Rows:
    """Train R-STDP on the racer in a scenario, and drive with both engines."""
    weights, losses = train_racer(scenario, SEEDS)
    setting = setting_at(FULL_M_S)
    rows = drive(setting, scenario, SEEDS, weights, losses)
    return rows + drive(setting._replace(engine='pybullet'), scenario, SEEDS, weights, losses)


def setting_at(asked_m_s: float) -> Setting:
    """Return who drives how at a speed."""
    return Setting('rstdp', TRAINED, asked_m_s, 5, robot=RACER_URDF)


def train_racer(
    scenario: int, seeds: Sequence[int], stages: Sequence[Stage] = STAGES
) -> tuple[list[NDArray[np.float64]], list[int]]:
    """Train in stages; return the weights of each training, and how often it lost the lane."""
    weights: list[NDArray[np.float64]] = []
    best: list[Choice | None] = [None] * len(seeds)
    losses = np.zeros(len(seeds), np.int64)
    for stage in stages:
        setting, parts = setting_at(stage.asked_m_s), max(stage.choices, 1)
        with learning_fleet(setting, scenario, seeds, stage.c_r, weights) as fleet:
            for _ in range(parts):
                losses += learn(fleet, stage.seconds / parts, setting)
                weights = weights_of(fleet)
                if stage.choices:
                    found = judge(setting, scenario, seeds, weights)
                    best = [_better(*pair) for pair in zip(best, found, strict=True)]
    chosen = [each.weights_pa for each in best if each is not None]
    return chosen, losses.tolist()


def judge(
    setting: Setting,
    scenario: int,
    seeds: Sequence[int],
    weights: Sequence[NDArray[np.float64]],
) -> list[Choice]:
    """Drive laps of both lanes with the weights of each training."""
    laps = [
        laps_in_fleet(setting, scenario, seeds, weights, lane, first_seed)
        for lane in LANES
        for first_seed in CHOICE_SEEDS
    ]
    found = []
    for robot, weights_pa in enumerate(weights):
        mine = [each[robot] for each in laps]
        completed = sum(each.end.reason == TERMINATED_LAPS_COMPLETE for each in mine)
        error_m = float(np.mean([np.abs(each.distances_m).mean() for each in mine]))
        found.append(Choice(completed, -error_m, weights_pa))
    return found


def _better(best: Choice | None, found: Choice) -> Choice:
    """Return the better one of two, the first one where neither is."""
    return found if best is None or found[:2] > best[:2] else best
