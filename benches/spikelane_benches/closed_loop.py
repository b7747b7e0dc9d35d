"""How many steps a second the closed loop makes in one process: simulator and controller."""

from __future__ import annotations

import statistics
import time
from typing import Any

from spikelane.loop import drive_episode
from spikelane_controllers.registry import make_controller
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters


def measure_closed_loop(engine: str, steps: int = 2000, repeats: int = 5) -> dict[str, Any]:
    """Drive the Braitenberg controller on scenario 1, again and again.

    Args:
        engine: 'pybullet', 'rigid' or 'kinematic'.
        steps: Steps of each repeat.
        repeats: Counted ones; one before them compiles and is not counted.

    Returns:
        `steps_per_s` (median of the repeats), `steps_per_s_min`, `steps_per_s_max`, and
        `cpu_us_per_step` (median processor time [µs], which other processes disturb less).
    """
    parameters = SimulatorParameters.from_mapping(
        {'robot.engine': engine, 'episode.max_steps': steps}
    )
    controller = make_controller('braitenberg')
    rates, costs = [], []
    with Simulator(parameters) as simulator:
        for repeat in range(repeats + 1):
            wall_s, cpu_s = time.perf_counter(), time.process_time()
            drive_episode(simulator, controller, _ignore, lane='outer', seed=0)
            if repeat:
                rates.append(steps / (time.perf_counter() - wall_s))
                costs.append((time.process_time() - cpu_s) / steps * 1e6)
    return {
        'engine': engine,
        'steps_per_s': round(statistics.median(rates)),
        'steps_per_s_min': round(min(rates)),
        'steps_per_s_max': round(max(rates)),
        'cpu_us_per_step': round(statistics.median(costs), 1),
    }


def _ignore(observation: Observation, wheels: WheelVelocities) -> None:
    del observation, wheels
