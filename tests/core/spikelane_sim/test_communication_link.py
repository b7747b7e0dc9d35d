"""The link between robot and controller: late commands and lost events."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

AHEAD = WheelVelocities(1.0, 1.0)  # 4.875 mm in a step


def make_simulator(**link: Any) -> Simulator:
    """Make a kinematic simulator with such a link."""
    values = {'robot.model': 'kinematic', 'link': link}
    return Simulator(SimulatorParameters.from_mapping(values))


def progress_m(observation: Observation) -> float:
    """Return how far the robot has come."""
    assert observation.lane is not None
    return observation.lane.progress_m


def fixed_drive(simulator: Simulator, seed: int = 3) -> list[Observation]:
    """Drive the same way whatever is seen."""
    seen = [simulator.reset(seed=seed)]
    return seen + [simulator.step(WheelVelocities(6.0 + n % 2, 6.0)) for n in range(30)]


@pytest.mark.parametrize(('latency_ms', 'steps'), [(0, 0), (50, 1), (200, 4)])
def test_a_command_drives_the_wheels_so_many_steps_later(latency_ms: int, steps: int) -> None:
    """Until then the wheels stand still; a reset forgets what is on its way."""
    with make_simulator(latency_ms=latency_ms) as simulator:
        for _ in range(2):
            simulator.reset()
            driven = [progress_m(simulator.step(AHEAD)) for _ in range(6)]
            expected = [max(0, n - steps) * 0.004875 for n in range(1, 7)]
            assert driven == pytest.approx(expected, abs=1e-12)


def test_each_command_arrives_once_and_in_turn() -> None:
    """One step ahead among steps at rest moves the robot once, three steps later."""
    commands = [AHEAD if n == 2 else WheelVelocities(0.0, 0.0) for n in range(8)]
    with make_simulator(latency_ms=150) as simulator:
        simulator.reset()
        driven = [progress_m(simulator.step(command)) for command in commands]
    assert driven == pytest.approx([0.0] * 5 + [0.004875] * 3, abs=1e-12)


@pytest.mark.parametrize('loss', [0.1, 0.5])
def test_events_are_lost_at_the_rate_given(loss: float) -> None:
    """Those that arrive are some of those seen, in their order; the drive is the same."""
    with make_simulator() as whole, make_simulator(event_loss=loss) as lossy:
        pairs = list(zip(fixed_drive(whole), fixed_drive(lossy), strict=True))
    for seen, arrived in pairs:
        assert seen.lane == arrived.lane
        remaining = iter(seen.events.tolist())
        assert all(event in remaining for event in arrived.events.tolist())
    n_seen = sum(len(seen.events) for seen, _ in pairs)
    n_lost = n_seen - sum(len(arrived.events) for _, arrived in pairs)
    assert n_seen > 2000
    assert n_lost / n_seen == pytest.approx(loss, abs=4 * np.sqrt(loss * (1 - loss) / n_seen))


def test_all_or_nothing_can_be_lost() -> None:
    """With 1 nothing arrives, with 0 nothing is drawn."""
    with make_simulator(event_loss=1.0) as deaf, make_simulator(event_loss=0.0) as keen:
        assert sum(len(seen.events) for seen in fixed_drive(deaf)) == 0
        assert sum(len(seen.events) for seen in fixed_drive(keen)) > 2000


def test_the_seed_determines_what_is_lost() -> None:
    """Whatever was driven before; losses do not disturb what the pixels draw."""
    with make_simulator(event_loss=0.3) as simulator:
        first, again, other = (fixed_drive(simulator, seed) for seed in (3, 3, 4))
    bits = [b''.join(seen.events['x'].tobytes() for seen in run) for run in (first, again, other)]
    assert bits[0] == bits[1]
    assert bits[0] != bits[2]


def test_a_latency_within_a_step_is_refused() -> None:
    """Wheels change their target between steps only."""
    expected = 'latency_ms: expected a multiple of 50 ms, the control period, got 70'
    with pytest.raises(ParameterError, match=expected):
        make_simulator(latency_ms=70)
