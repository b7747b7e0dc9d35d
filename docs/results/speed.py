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

from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path
import sys

import pandas as pd
from shared.parts import add_missing, put_part, Rows
from speed_driving import drive, train
from speed_figure import show
from speed_racer import racer
from speed_settings import (
    NETWORK_SPEED,
    PERIODS_MS,
    Setting,
    SHIPPED,
    STRAIGHT_RAD_S,
    TRAINED,
    WHEEL_M,
)

SCENARIOS = (1, 2, 3)
#: Seeds of the map, and of the goals.
FEW, MANY = range(3), range(10)
#: Control periods and latencies of the map [ms].
CELLS = (*((period_ms, 0) for period_ms in PERIODS_MS), (10, 50), (10, 100), (10, 200))
#: Speeds asked for on a straight lane: the last one is the top speed of a P3-DX [m/s].
SPEEDS_M_S = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)
#: Settings of experiments/speed.yaml by part: names of runs, control period and latency [ms].
NETWORKS = {
    'networks': ('fast', 10, 0),
    'map networks, 20 ms, 0 ms': ('fast-period_ms-20-max_steps-3000', 20, 0),
    'map networks, 5 ms, 0 ms': ('fast-period_ms-5-max_steps-12000', 5, 0),
    **{
        f'map networks, 10 ms, {latency_ms} ms': (f'fast-latency_ms-{latency_ms}', 10, latency_ms)
        for latency_ms in (50, 100, 200)
    },
}
#: Engines of the laps; those with other periods and latencies are driven with the first one.
ENGINES = ('rigid', 'pybullet')
#: What trains which network there.
TRAININGS = (('train', 'dqn'), ('transfer', 'dqn_snn'))
#: The reward at the end of the trainings of the goal, and for how long [s].
SETTLING_C_R, SETTLING_S = 0.0025, 250.0
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
        for part, (ending, period_ms, latency_ms) in NETWORKS.items():
            rows = collect(Path(sys.argv[3]), ending, period_ms, latency_ms)
            if rows:
                put_part(data, 'part', part, rows, DIGITS)
    else:
        named = sys.argv[3:]
        chosen = {name: part for name, part in parts().items() if not named or name in named}
        add_missing(data, 'part', chosen, DIGITS)


def parts() -> dict[str, Callable[[], Rows]]:
    """Return what is driven, part by part."""
    found: dict[str, Callable[[], Rows]] = {'goal': goal}
    for scenario in SCENARIOS:
        found[f'racer {scenario}'] = partial(racer, scenario)
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
        # A smaller reward at the end makes the errors smaller.
        weights, more = train(
            setting, scenario, MANY, c_r=SETTLING_C_R, seconds=SETTLING_S, begin=weights
        )
        losses = [sum(pair) for pair in zip(losses, more, strict=True)]
        rows += drive(setting, scenario, MANY, weights, losses)
        rows += drive(setting._replace(engine='pybullet'), scenario, MANY, weights, losses)
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


def collect(runs: Path, ending: str, period_ms: int, latency_ms: int) -> Rows:
    """Drive with the networks that experiments/speed.yaml has trained, a lap of each lane.

    Args:
        runs: The experiment's folder.
        ending: What names the setting in the names of the runs.
        period_ms: The setting's control period.
        latency_ms: The setting's latency.
    """
    rows = []
    for scenario, (kind, controller) in product(SCENARIOS, TRAININGS):
        for folder in sorted(runs.glob(f'{kind}-{controller}-{scenario}-rigid-{ending}-seed*')):
            if not (folder / 'metrics.json').exists():
                continue  # it is not over
            seed = int(folder.name.rsplit('seed', 1)[1])
            asked_m_s = NETWORK_SPEED * STRAIGHT_RAD_S[controller] * WHEEL_M
            for engine in ENGINES if not latency_ms and period_ms == 10 else ENGINES[:1]:
                weights = str(folder)
                setting = Setting(
                    controller, weights, asked_m_s, period_ms, latency_ms, engine=engine
                )
                for row in drive(setting, scenario, (seed,)):
                    rows.append({**row, 'weights': TRAINED})
    return rows


if __name__ == '__main__':
    main()
