"""Laps in a fleet: of any seeds, lanes, courses and weights, each with the same bits as alone."""

from __future__ import annotations

from collections.abc import Sequence
import time

import numpy as np

from spikelane.fleet.fleet import OnAdvance, Track
from spikelane.fleet.setting import fleet_of, has_kernel
from spikelane.runs.configuration import configured_controller
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.run import DrivenLap
from spikelane.runs.lap.trajectory import Trajectory, trajectory_from_columns
from spikelane_sim.course import load_course


def can_drive(config: LapConfig) -> bool:
    """Return whether the kernel has all that determines a lap, and something ends it."""
    limits = config.simulator.episode
    return has_kernel(config) and bool(limits.max_laps or limits.max_steps)


def drive_fleet(
    configs: Sequence[LapConfig],
    on_advance: OnAdvance = lambda *_: None,
    *,
    threads: int = 1,
) -> list[DrivenLap]:
    """Drive laps, all at once.

    Args:
        configs: What determines each; they differ in nothing but seed, lane, course and weights.
        on_advance: Called as they come on.
        threads: How many threads drive them.

    Returns:
        What came of each; its wall time is that of all.

    Raises:
        SpikelaneError: They are not laps of one setting, or one cannot be driven.
        Interrupted: A signal has come.
    """
    with fleet_of(configs, threads) as fleet:
        for robot, config in enumerate(configs):
            if config.controller_parameters != configs[0].controller_parameters:
                controller = configured_controller(config)
                fleet.host(robot, controller, controller.reset)
        start_s = time.perf_counter()
        tracks = fleet.episodes([config.lane for config in configs], on_advance)
        wall_time_s = time.perf_counter() - start_s
        return [
            DrivenLap(
                _trajectory(config, track), wall_time_s, None, fleet.controllers.operations(robot)
            )
            for robot, (config, track) in enumerate(zip(configs, tracks, strict=True))
        ]


def _trajectory(config: LapConfig, track: Track) -> Trajectory:
    """Return an episode as a single simulator's recorder has it."""
    course, lane, places = load_course(config.simulator.course), config.lane, track.places
    steps = np.arange(len(places))
    names = [course.section_name(lane, each) for each in places['section'].tolist()]
    return trajectory_from_columns(
        lane,
        track.end.reason,
        {
            **{name: places[name].copy() for name in _TAKEN},
            'stamp_ns': (steps + 1) * config.simulator.period_ns,
            'step': steps,
            'section': np.array(names, np.str_),
            'left_rad_s': track.answers[:, 0].copy(),
            'right_rad_s': track.answers[:, 1].copy(),
        },
    )


#: Columns of a trajectory that a fleet has as they are.
_TAKEN = (
    'x_m',
    'y_m',
    'orientation_x',
    'orientation_y',
    'orientation_z',
    'orientation_w',
    'distance_m',
    'heading_error_rad',
    'position_m',
    'progress_m',
    'laps',
    'events',
)
