#!/usr/bin/env python3
"""How fast the controllers drive: data, tables and figure of speed.md.

source setup/env.sh; docs/results/speed.py drive docs/results/speed.csv
source setup/env.sh; docs/results/speed.py collect docs/results/speed.csv runs/speed
source setup/env.sh; docs/results/speed.py show docs/results/speed.csv FIGURE.png

The first command drives what the file lacks, part by part, or only the parts that are named after
the file; it is deterministic. The second one adds laps with the networks that
experiments/speed.yaml has trained. The third one prints the tables and draws the figure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
import sys

import numpy as np
from numpy.typing import NDArray
import pandas as pd
from shared.driving import Driven, fleet_laps, give_weights, host, LANES, LAP_SEED, single_lap
from shared.parts import add_missing, put_part, Rows
from speed_figure import show
from speed_settings import (
    NETWORK_SPEEDS,
    PERIODS_MS,
    RACER_URDF,
    Setting,
    SHIPPED,
    STRAIGHT_RAD_S,
    TRAINED,
    WHEEL_M,
)

from spikelane.fleet import Fleet
from spikelane_controllers.registry import make_controller
from spikelane_sim.contract import TERMINATED_LAPS_COMPLETE

SCENARIOS = (1, 2, 3)
#: Seeds of the map, and of the goals.
FEW, MANY = range(3), range(10)
#: Control periods and latencies of the map [ms].
CELLS = (*((period_ms, 0) for period_ms in PERIODS_MS), (10, 50), (10, 100), (10, 200))
#: Speeds asked for on a straight lane: the last one is the top speed of a P3-DX [m/s].
SPEEDS_M_S = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)
#: What R-STDP is trained for [s]: as long as 15,000 steps of 50 ms.
TRAINING_S = 750.0
#: The racer's training: the reward, and for how long [s].
RACER_TRAINING = ((0.025, 300.0), (0.01, 300.0), (0.0025, 200.0))
#: How fractions are written to the data.
DIGITS = '%.6g'


def main() -> None:
    """Drive, collect, or show."""
    if len(sys.argv) < 3 or sys.argv[1] not in ('drive', 'collect', 'show'):
        sys.exit(__doc__)
    data = Path(sys.argv[2])
    if sys.argv[1] == 'show':
        show(pd.read_csv(data), Path(sys.argv[3]))
    elif sys.argv[1] == 'collect':
        for scenario in SCENARIOS:
            if rows := collect(Path(sys.argv[3]), scenario):
                put_part(data, 'part', f'networks {scenario}', rows, DIGITS)
    else:
        named = sys.argv[3:]
        chosen = {name: part for name, part in parts().items() if not named or name in named}
        add_missing(data, 'part', chosen, DIGITS)


def parts() -> dict[str, Callable[[], Rows]]:
    """Return what is driven, part by part."""
    found: dict[str, Callable[[], Rows]] = {'goal': goal, 'racer': racer}
    for controller in STRAIGHT_RAD_S:
        found[f'map {controller}'] = partial(shipped_map, controller)
    for period_ms, latency_ms in CELLS:
        name = f'map trained, {period_ms} ms, {latency_ms} ms'
        found[name] = partial(trained_map, period_ms, latency_ms)
    return found | {'errors': errors}


def goal() -> Rows:
    """Train R-STDP at the top speed of the P3-DX, and drive with both engines."""
    rows = []
    for scenario in SCENARIOS:
        setting = Setting('rstdp', TRAINED, 1.2, 10)
        weights, losses = train(setting, scenario, MANY)
        rows += drive(setting, scenario, MANY, weights, losses)
        rows += drive(setting._replace(engine='pybullet'), scenario, MANY, weights, losses)
    return rows


def racer() -> Rows:
    """Train R-STDP on the racer in scenario 1, and drive with both engines."""
    rows = []
    setting = Setting('rstdp', TRAINED, 4.42, 10, robot=RACER_URDF)
    weights, losses = None, [0] * len(MANY)
    for c_r, seconds in RACER_TRAINING:
        weights, more = train(setting, 1, MANY, c_r=c_r, seconds=seconds, begin=weights)
        losses = [sum(pair) for pair in zip(losses, more, strict=True)]
    rows += drive(setting, 1, MANY, weights, losses)
    rows += drive(setting._replace(engine='pybullet'), 1, MANY, weights, losses)
    return rows


def shipped_map(controller: str) -> Rows:
    """Find the highest speed at which the shipped weights lap, by period and latency."""
    rows = []
    scenarios = (1,) if controller == 'braitenberg' else SCENARIOS
    for period_ms, latency_ms in CELLS:

        def laps(asked: float, period: int = period_ms, late: int = latency_ms) -> bool:
            setting = Setting(controller, SHIPPED, asked, period, late)
            driven = [row for each in scenarios for row in drive(setting, each, FEW)]
            rows.extend(driven)
            return all(row['completed'] for row in driven)

        bisect(laps)
    return rows


def bisect(laps: Callable[[float], bool]) -> None:
    """Look for the highest of SPEEDS_M_S with which all laps are completed."""
    low, high = -1, len(SPEEDS_M_S) - 1
    if laps(SPEEDS_M_S[high]):
        return
    while high - low > 1:
        middle = (low + high) // 2
        if laps(SPEEDS_M_S[middle]):
            low = middle
        else:
            high = middle


def trained_map(period_ms: int, latency_ms: int) -> Rows:
    """Train R-STDP at the top speed of the P3-DX, with a period and a latency."""
    rows = []
    for scenario in SCENARIOS:
        setting = Setting('rstdp', TRAINED, 1.2, period_ms, latency_ms)
        weights, losses = train(setting, scenario, FEW)
        rows += drive(setting, scenario, FEW, weights, losses)
    return rows


def errors() -> Rows:
    """Drive scenario 1 at each speed: with the shipped weights, and trained at that speed."""
    rows = []
    for asked in SPEEDS_M_S:
        for controller in STRAIGHT_RAD_S:
            rows += drive(Setting(controller, SHIPPED, asked, 50), 1, FEW)
        if asked in (0.4, 0.8):
            continue
        setting = Setting('rstdp', TRAINED, asked, 10)
        weights, losses = train(setting, 1, FEW)
        rows += drive(setting, 1, FEW, weights, losses)
    return rows


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
    course = setting.simulator(scenario) | {'episode.max_distance_m': 0.2, 'episode.max_steps': 0}
    learning = setting.parameters(scenario) | {'learning': True, 'checkpoint': ''}
    learning['c_r'] = c_r
    steps = round(seconds * 1000 / setting.period_ms)
    losses = [0] * len(seeds)
    with Fleet('rstdp', seeds, simulator=course, parameters=learning) as fleet:
        fleet.initialise()
        host(fleet, begin or ())
        for end in fleet.drive(steps):
            losses[end.robot] += end.lane_state.reason != TERMINATED_LAPS_COMPLETE
        weights = [np.array(fleet.controller(robot).weights_pa) for robot in range(len(seeds))]
    return weights, losses


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
    one = _single_laps if setting.controller == 'dqn_snn' else _fleet_laps
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


def _fleet_laps(
    setting: Setting,
    scenario: int,
    seeds: Sequence[int],
    weights: Sequence[NDArray[np.float64]],
    lane: str,
) -> list[Driven]:
    lap_seeds = [LAP_SEED + seed for seed in seeds]
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


def collect(runs: Path, scenario: int) -> Rows:
    """Drive with the networks that experiments/speed.yaml has trained, a lap of each lane."""
    rows = []
    for kind, controller in (('train', 'dqn'), ('transfer', 'dqn_snn')):
        for folder in sorted(runs.glob(f'{kind}-{controller}-{scenario}-*')):
            if not (folder / 'metrics.json').exists():
                continue  # it is not over
            seed = int(folder.name.rsplit('seed', 1)[1])
            asked_m_s = NETWORK_SPEEDS[scenario] * STRAIGHT_RAD_S[controller] * WHEEL_M
            setting = Setting(controller, str(folder), asked_m_s, 50)
            for row in drive(setting, scenario, (seed,)):
                rows.append({**row, 'weights': TRAINED})
    return rows


if __name__ == '__main__':
    main()
