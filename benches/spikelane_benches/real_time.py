"""How soon wheel velocities answer an observation over ROS in real time, by the control period."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import json
import os
from pathlib import Path
import sys
import tempfile
from typing import Any

import numpy as np

from spikelane.executables import node_command
from spikelane.processes import Processes
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.files import write_yaml

PERIOD_MS = 10
CONTROLLERS = ('rstdp', 'dqn_snn')
#: Real-time priority of the processes, where the system allows one: they run before all others.
PRIORITY = 20
#: What the first observations need to compile nothing any more, and to meet all buffers.
WARM_UP_STEPS = 200
_DEADLINE_S = 240.0
_SIMULATOR = Path(__file__).parent / 'nodes/timed_simulator.py'


def measure_real_time(steps: int = 6000, is_urgent: bool = True) -> dict[str, Any]:
    """Drive in real time with simulator and controller in two processes.

    An answer is on time when it reaches the simulator within a control period of 10 ms after the
    simulator began to publish the observation. The robot is `rigid`, and learning is off.

    Args:
        steps: Steps looked at with each controller.
        is_urgent: Whether the processes are scheduled in real time (`chrt --rr`), where the
            system allows it.

    Returns:
        `on_time_percent`, the smaller of both shares of steps; for each controller its share,
        `<name>_on_time_percent`, the percentiles 50, 99 and 99.9 and the largest of the delays
        [ms], `<name>_p50_ms` and so on, and `<name>_late_ticks_percent`, the share of steps that
        the simulator itself began more than a period late; `scheduling`, 'real-time' or 'usual';
        and the load of the machine over the last minute, `load_before` and `load_after`.

    Raises:
        SpikelaneError: A process failed.
    """
    load_before = os.getloadavg()[0]
    found: dict[str, Any] = {}
    with _scheduled(is_urgent) as scheduling:
        for name in CONTROLLERS:
            values = summary(*_drive(name, steps))
            found |= {f'{name}_{key}': value for key, value in values.items()}
    shares = [found[f'{name}_on_time_percent'] for name in CONTROLLERS]
    return {
        'on_time_percent': min(shares),
        **found,
        'scheduling': scheduling,
        'load_before': round(load_before, 2),
        'load_after': round(os.getloadavg()[0], 2),
    }


@contextlib.contextmanager
def _scheduled(is_urgent: bool) -> Iterator[str]:
    """Give this process, and those that it starts, a real-time priority where that is allowed."""
    usual = os.sched_getscheduler(0), os.sched_getparam(0)
    scheduling = 'usual'
    if is_urgent:
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
            scheduling = 'real-time'
    try:
        yield scheduling
    finally:
        os.sched_setscheduler(0, *usual)


def summary(delays_ms: list[float | None], gaps_ms: list[float]) -> dict[str, float]:
    """Return shares and percentiles; an answer that never came is later than any other.

    Args:
        delays_ms: From each observation to its answer, None where none came, (n,).
        gaps_ms: From each observation to the next, (n,).
    """
    delays = np.array([np.inf if delay is None else delay for delay in delays_ms])
    # No interpolation: between a number and infinity there is nothing.
    points = np.quantile(delays, (0.5, 0.99, 0.999, 1.0), method='higher').round(2).tolist()
    return {
        'on_time_percent': round(100 * float((delays <= PERIOD_MS).mean()), 3),
        **dict(zip(('p50_ms', 'p99_ms', 'p999_ms', 'max_ms'), points, strict=True)),
        'late_ticks_percent': round(100 * float((np.array(gaps_ms) > 2 * PERIOD_MS).mean()), 3),
    }


def _drive(controller: str, steps: int) -> tuple[list[float | None], list[float]]:
    """Return the delays of the answers and the gaps between observations [ms]."""
    # Here and not above: the other measurements must work where there is no ROS.
    from spikelane.nodes.domain import own_domain

    simulator = {
        'mode': 'realtime',
        'period_ms': PERIOD_MS,
        'robot.engine': 'rigid',
        'episode.max_laps': 0,
        'episode.max_distance_m': 0.0,
        'bench_steps': steps,
        'bench_warm_up': WARM_UP_STEPS,
    }
    parameters = {'simulator': simulator, controller: {'period_ms': PERIOD_MS}}
    with own_domain() as domain, tempfile.TemporaryDirectory(prefix='spikelane_bench_') as folder:
        file = Path(folder, 'parameters.yaml')
        write_yaml(file, {node: {'ros__parameters': own} for node, own in parameters.items()})
        commands = {
            controller: node_command(controller),
            'simulator': [sys.executable, str(_SIMULATOR)],
        }
        with Processes(kept_open=(domain.reservation,)) as processes:
            for node, command in commands.items():
                command = [*command, '--ros-args', '--params-file', str(file)]
                environment = os.environ | domain.environment
                processes.start(node, command, Path(folder, f'{node}.log'), environment)
            processes.wait('simulator', _DEADLINE_S + steps * PERIOD_MS / 1000)
        lines = Path(folder, 'simulator.log').read_text().splitlines()
    said = [json.loads(line) for line in lines if line.startswith('{"delays_ms"')]
    if not said:
        raise SpikelaneError(f'real-time: expected delays of {controller}, got none')
    return said[0]['delays_ms'], said[0]['gaps_ms']
