"""Trainings and laps of speed.py: R-STDP that learns at a speed, and everyone who drives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from shared.driving import Driven, fleet_laps, give_weights, host, LANES, LAP_SEED, single_lap
from shared.parts import Rows
from speed_settings import Setting

from spikelane.fleet import Fleet
from spikelane_controllers.registry import make_controller
from spikelane_sim.contract import TERMINATED_LAPS_COMPLETE

#: What R-STDP is trained for [s]: as long as 15,000 steps of 50 ms.
TRAINING_S = 750.0


def train(
    setting: Setting,
    scenario: int,
    seeds: Sequence[int],
    *,
    c_r: float = 0.01,
    seconds: float = TRAINING_S,
    begin: Sequence[NDArray[np.float64]] | None = None,
) -> tuple[list[NDArray[np.float64]], list[int]]:
    """Train R-STDP, over episodes that end at 0.2 m from the centre.

    Args:
        setting: Who drives how.
        scenario: Number of the course.
        seeds: Seeds of the trainings.
        c_r: The reward.
        seconds: How long.
        begin: Weights to begin with; None for those that are drawn.

    Returns:
        The weights of each training, and how often it lost the lane.
    """
    with learning_fleet(setting, scenario, seeds, c_r, begin) as fleet:
        losses = learn(fleet, seconds, setting)
        return weights_of(fleet), losses


def learning_fleet(
    setting: Setting,
    scenario: int,
    seeds: Sequence[int],
    c_r: float,
    begin: Sequence[NDArray[np.float64]] | None = None,
) -> Fleet:
    """Return trainings of R-STDP that are to begin; the arguments are those of `train`."""
    course = setting.simulator(scenario) | {'episode.max_distance_m': 0.2, 'episode.max_steps': 0}
    learning = setting.parameters(scenario) | {'learning': True, 'checkpoint': '', 'c_r': c_r}
    fleet = Fleet('rstdp', seeds, simulator=course, parameters=learning)
    fleet.initialise()
    host(fleet, begin or ())
    return fleet


def learn(fleet: Fleet, seconds: float, setting: Setting) -> list[int]:
    """Let trainings go on for some time; return how often each lost the lane."""
    losses = [0] * len(fleet)
    for end in fleet.drive(round(seconds * 1000 / setting.period_ms)):
        losses[end.robot] += end.lane_state.reason != TERMINATED_LAPS_COMPLETE
    return losses


def weights_of(fleet: Fleet) -> list[NDArray[np.float64]]:
    """Return the weights of each training now [pA]."""
    return [np.array(fleet.controller(robot).weights_pa) for robot in range(len(fleet))]


def drive(
    setting: Setting,
    scenario: int,
    seeds: Sequence[int],
    weights: Sequence[NDArray[np.float64]] = (),
    losses: Sequence[int] = (),
) -> Rows:
    """Drive a lap of each lane with each seed, learning off.

    Args:
        setting: Who drives how.
        scenario: Number of the course.
        seeds: Seeds of the laps, less LAP_SEED.
        weights: Of R-STDP, for each seed; none for the shipped ones.
        losses: Lane losses of the training, for each seed.
    """
    one = _single_laps if setting.controller == 'dqn_snn' else laps_in_fleet
    # A Q-network has no randomness of its own.
    used = seeds[:1] if setting.controller == 'dqn' else seeds
    rows = []
    for lane in LANES:
        found = one(setting, scenario, used, weights, lane)
        for seed, driven in zip(used, found, strict=True):
            row = {**setting._asdict(), 'scenario': scenario, 'lane': lane, 'seed': seed}
            row |= driven.result() | {'speed_m_s': _speed_m_s(driven, setting.period_ms)}
            rows.append(row | ({'losses': losses[seed]} if losses else {}))
    return rows


def laps_in_fleet(
    setting: Setting,
    scenario: int,
    seeds: Sequence[int],
    weights: Sequence[NDArray[np.float64]],
    lane: str,
    first_seed: int = LAP_SEED,
) -> list[Driven]:
    """Drive a lap of the lane for each seed with its weights; the lap has first_seed + seed."""
    lap_seeds = [first_seed + seed for seed in seeds]
    with Fleet(
        setting.controller,
        lap_seeds,
        simulator=setting.simulator(scenario),
        parameters=setting.parameters(scenario),
    ) as fleet:
        host(fleet, weights)
        return fleet_laps(fleet, [lane] * len(lap_seeds))


def _single_laps(
    setting: Setting,
    scenario: int,
    seeds: Sequence[int],
    weights: Sequence[NDArray[np.float64]],
    lane: str,
) -> list[Driven]:
    found = []
    for number, seed in enumerate(seeds):
        controller = make_controller(setting.controller, setting.parameters(scenario))
        if weights:
            give_weights(controller, weights[number])
        found.append(single_lap(setting.simulator(scenario), controller, lane, LAP_SEED + seed))
    return found


def _speed_m_s(driven: Driven, period_ms: int) -> float:
    """Return the mean speed of a lap along its lane."""
    seconds = max(len(driven.distances_m) - 1, 1) * period_ms / 1000
    return driven.end.progress_m / seconds
