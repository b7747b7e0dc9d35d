"""What a lockstep step costs over ROS, against in-process and a bare rclpy ping-pong.

Over ROS, simulator and controller are in two processes, or composed in one.
"""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path
import statistics
import sys
import tempfile
from typing import Any

from spikelane.processes import Processes
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.config import LapConfig
from spikelane_benches.closed_loop import measure_closed_loop

#: Bytes of an event packet on scenario 1: about 30 events, each a word of address and one of row.
PACKET_BYTES = 120
_DEADLINE_S = 120.0
_PING_PONG = Path(__file__).parent / 'nodes/ping_pong.py'


def measure_lockstep(steps: int = 2000, repeats: int = 3) -> dict[str, Any]:
    """Measure all four in turn, again and again, with the kinematic robot.

    Args:
        steps: Steps of each repeat.
        repeats: Their medians are returned.

    Returns:
        `ros_us`, `composed_us`, `inprocess_us` (a step) and `round_trip_us` (of the ping-pong
        between two processes) [µs], and `round_trips` and `composed_round_trips`: what a step in
        two processes and in one costs beyond one in-process, in round trips.

    Raises:
        SpikelaneError: A process failed.
    """
    parameters = {'simulator.robot.engine': 'kinematic', 'simulator.episode.max_steps': steps}
    config = LapConfig.make(Request('1', 'braitenberg', 0, 'ros', parameters), 'outer')
    together = dataclasses.replace(config, transport='composed')
    ros, composed, inprocess, round_trips = [], [], [], []
    for _ in range(repeats):
        round_trips.append(_ping_pong_us(steps))
        ros.append(_lockstep_us(config, steps))
        composed.append(_lockstep_us(together, steps))
        inprocess.append(measure_closed_loop('kinematic', steps, 1)['steps_per_s'])
    ros_us, composed_us = statistics.median(ros), statistics.median(composed)
    inprocess_us = 1e6 / statistics.median(inprocess)
    round_trip_us = statistics.median(round_trips)
    return {
        'ros_us': round(ros_us, 1),
        'ros_steps_per_s': round(1e6 / ros_us),
        'composed_us': round(composed_us, 1),
        'composed_steps_per_s': round(1e6 / composed_us),
        'inprocess_us': round(inprocess_us, 1),
        'round_trip_us': round(round_trip_us, 1),
        'round_trips': round((ros_us - inprocess_us) / round_trip_us, 2),
        'composed_round_trips': round((composed_us - inprocess_us) / round_trip_us, 2),
    }


def _lockstep_us(config: LapConfig, steps: int) -> float:
    # Here and not above: the other measurements must work where there is no ROS.
    from spikelane.runs.lap.nodes.driving import drive_unrecorded

    with tempfile.TemporaryDirectory(prefix='spikelane_bench_') as folder:
        wall_time_s: float = drive_unrecorded(config, RunFolder(Path(folder)))
    return wall_time_s / steps * 1e6


def _ping_pong_us(rounds: int) -> float:
    from spikelane.nodes.domain import own_domain

    with own_domain() as domain, tempfile.TemporaryDirectory() as folder:
        with Processes(kept_open=(domain.reservation,)) as processes:
            for role in ('pong', 'ping'):
                command = [sys.executable, str(_PING_PONG), role, '--ros-args']
                command += ['-p', f'rounds:={rounds}', '-p', f'packet_bytes:={PACKET_BYTES}']
                processes.start(role, command, Path(folder, role), os.environ | domain.environment)
            processes.wait('ping', _DEADLINE_S)
        result = json.loads(Path(folder, 'ping').read_text().splitlines()[-1])
    return float(result['round_trip_us'])
