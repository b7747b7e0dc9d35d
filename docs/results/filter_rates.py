#!/usr/bin/env python3
"""Counts the events that filters let pass, without and with noise; prints a table in Markdown.

source setup/env.sh; docs/results/filter_rates.py

A robot drives the first 160 steps of the outer lane of scenario 1 along the lane's centre. All
filters are given the same events.
"""

from __future__ import annotations

import numpy as np
from shared.tables import print_row, table_header

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.encoding import count_events, EncodingParameters
from spikelane_sim.filters import FilterParameters, FilterStage
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

RATES_HZ = (0.0, 1.0, 10.0)
STEPS, FIRST = 160, 5
#: Supporters, window [s], reach [px], and whether only the same polarity counts.
FILTERS = (
    (1, 0.005, 1, False),
    (2, 0.02, 1, False),
    (2, 0.005, 1, False),
    (3, 0.005, 1, False),
    (2, 0.002, 1, False),
    (3, 0.01, 1, False),
    (4, 0.01, 2, False),
    (2, 0.01, 1, True),
    (2, 0.005, 1, True),
    (3, 0.01, 2, True),
    (5, 0.02, 2, True),
)


def main() -> None:
    """Count and print."""
    names = ['none', *map(name_of, FILTERS)]
    columns = [means(rate_hz) for rate_hz in RATES_HZ]
    print(table_header('filter', *(f'{rate_hz:g} Hz' for rate_hz in RATES_HZ)))
    for number, name in enumerate(names):
        print_row(name, *(f'{column[number]:.0f}' for column in columns))


def name_of(each: tuple[int, float, int, bool]) -> str:
    """Return a filter in words."""
    supporters, window_s, reach_px, same_polarity = each
    reach = f', reach of {reach_px} pixels' if reach_px > 1 else ''
    return f'{supporters} within {1000 * window_s:g} ms{reach}' + (
        ', same polarity' if same_polarity else ''
    )


def means(rate_hz: float) -> list[float]:
    """Return the mean number of events in the cells of R-STDP in a step, for each filter."""
    simulator = Simulator(
        SimulatorParameters.from_mapping(
            {
                'robot.engine': 'rigid',
                'camera.antialias': True,
                'pixels.model': 'esim',
                'pixels.esim.substeps': 2,
                'pixels.esim.leak_rate_hz': 0.0,
                'pixels.esim.shot_rate_hz': rate_hz,
                'pixels.esim.shot_bright_factor': 1.0,
            }
        )
    )
    stages = [FilterStage(FilterParameters(), 128, 128), *map(stage_of, FILTERS)]
    counts: list[list[int]] = [[] for _ in stages]
    seen = simulator.reset('outer', 0)
    for _ in range(STEPS):
        for stage, found in zip(stages, counts, strict=True):
            events = stage.observe(seen).events
            found.append(int(count_events(events, EncodingParameters()).sum()))
        assert seen.lane is not None
        turn = 1.5 * seen.lane.distance_m + 0.8 * seen.lane.heading_error_rad
        turn = float(np.clip(turn, -0.3, 0.3))
        seen = simulator.step(WheelVelocities(1.4 - turn, 1.4 + turn))
    return [float(np.mean(each[FIRST:])) for each in counts]


def stage_of(each: tuple[int, float, int, bool]) -> FilterStage:
    """Return a correlation filter."""
    supporters, window_s, reach_px, same_polarity = each
    values = {
        'chain': 'correlation',
        'correlation.supporters': supporters,
        'correlation.window_s': window_s,
        'correlation.reach_px': reach_px,
        'correlation.same_polarity': same_polarity,
    }
    return FilterStage(FilterParameters.from_mapping(values), 128, 128)


if __name__ == '__main__':
    main()
