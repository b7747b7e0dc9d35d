"""A drive that makes no progress along its lane comes to an end, and a lap has a time limit."""

from __future__ import annotations

from collections.abc import Callable
import json
from pathlib import Path
from typing import Any

import pytest

from spikelane.main import run
from spikelane.runs.configuration import Request
from spikelane.runs.evaluate.config import EvaluateConfig
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.train.config import TrainConfig
from spikelane_sim.contract import LaneState, WheelVelocities
from spikelane_sim.env import LaneKeepingEnv
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

#: A robot that stands, as the Braitenberg controller drives with these.
STANDING = {'braitenberg.steering.v_min': 0, 'braitenberg.steering.v_max': 0}


def last_state(
    wheels: Callable[[int], tuple[float, float]], most: int, **episode: Any
) -> LaneState:
    """Drive with the wheel velocities of each step to the end, or for so many steps."""
    values = {f'episode.{name}': value for name, value in episode.items()}
    parameters = SimulatorParameters.from_mapping({'robot.model': 'kinematic', **values})
    with Simulator(parameters) as simulator:
        lane = simulator.reset('outer', 0).lane
        for step in range(most):
            lane = simulator.step(WheelVelocities(*wheels(step))).lane
            assert lane is not None
            if lane.terminated:
                break
        assert lane is not None
        return lane


def back_and_forth(step: int) -> tuple[float, float]:
    """Drive 2 s ahead, 0.195 m, and 2 s back."""
    speed = 1.0 if step // 40 % 2 == 0 else -1.0
    return speed, speed


@pytest.mark.parametrize(
    ('wheels', 'steps'),
    [
        (lambda step: (0.0, 0.0), 600),
        (lambda step: (-1.0, 1.0), 600),  # turns on the spot
        (lambda step: (-0.5, -0.5), 600),  # backwards along the straight
        # 0.1 m is reached within step 21, in which 0.102375 m are: 600 steps after that.
        (back_and_forth, 621),
    ],
)
def test_a_drive_without_progress_ends(
    wheels: Callable[[int], tuple[float, float]], steps: int
) -> None:
    """After 600 steps in which the robot has not come 0.1 m farther."""
    lane = last_state(wheels, 3000, no_progress_steps=600, max_distance_m=0)
    assert (lane.terminated, lane.reason, lane.step) == (True, 'no_progress', steps)


def test_a_robot_in_circles_makes_no_progress() -> None:
    """A circle of 0.2 m radius within the lane."""
    lane = last_state(lambda step: (0.2, 2.0), 5000, no_progress_steps=600)
    assert lane.reason == 'no_progress'
    assert lane.step < 800


def test_a_slow_robot_makes_progress() -> None:
    """At 0.00975 m/s: 0.1 m in 10.3 s, of 30 s allowed."""
    lane = last_state(lambda step: (0.1, 0.1), 3000, no_progress_steps=600)
    assert (lane.terminated, lane.step) == (False, 3000)


def test_the_progress_that_counts_is_a_parameter() -> None:
    """The same robot comes 0.2925 m farther in 30 s, and not 0.5 m."""
    lane = last_state(lambda step: (0.1, 0.1), 3000, no_progress_steps=600, min_progress_m=0.5)
    assert (lane.reason, lane.step) == ('no_progress', 600)


def test_the_simulator_alone_lets_a_robot_stand() -> None:
    """A robot in real time may have to wait for its controller."""
    lane = last_state(lambda step: (0.0, 0.0), 3000)
    assert not lane.terminated


def test_an_episode_begins_with_no_steps_behind_it() -> None:
    """The farthest progress is forgotten at a reset."""
    values = {'robot.model': 'kinematic', 'episode.no_progress_steps': 50}
    with Simulator(SimulatorParameters.from_mapping(values)) as simulator:
        for _ in range(2):
            lane = simulator.reset('outer', 0).lane
            while lane is not None and not lane.terminated:
                speed = 1.0 if lane.step < 41 else 0.0
                lane = simulator.step(WheelVelocities(speed, speed)).lane
            assert lane is not None
            # 0.1 m is reached within step 21 and 0.199875 m in step 41, which is not 0.1 m more.
            assert (lane.reason, lane.step) == ('no_progress', 71)


def test_the_environment_truncates_where_it_is_asked_for() -> None:
    """With the reason in `info`; the default lets a robot stand for all its actions."""
    simulator = {'robot.model': 'kinematic', 'episode.no_progress_steps': 100}
    env = LaneKeepingEnv(actions='wheels', simulator=simulator)
    env.reset(seed=0)
    taken = [env.step([0.0, 0.0]) for _ in range(10)]
    assert [step[2:4] for step in taken] == [(False, False)] * 9 + [(False, True)]
    info = taken[-1][4]
    assert (info['lane_state'].reason, info['is_success']) == ('no_progress', False)
    env.close()
    usual = LaneKeepingEnv(simulator={'robot.model': 'kinematic'})
    assert usual.unwrapped._simulator.parameters.episode.no_progress_steps == 0
    usual.close()


def lap_of_a_standing_robot(out: Path, *arguments: str) -> list[str]:
    """Return the command that drives one."""
    given = [f'--param={name}={value}' for name, value in STANDING.items()]
    return ['lap', '--transport', 'inprocess', '--robot', 'kinematic', '--json'] + [
        *given,
        f'--out={out}',
        *arguments,
    ]


@pytest.mark.parametrize(
    ('arguments', 'reason', 'steps'),
    [
        ([], 'no_progress', 600),
        (['--param=simulator.episode.no_progress_steps=100'], 'no_progress', 100),
        (['--param=simulator.episode.no_progress_steps=0'], 'step_limit', 31992),
    ],
)
def test_a_lap_ends_with_its_reason(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    reason: str,
    steps: int,
) -> None:
    """The outer lane of 31.991 m at 0.02 m/s takes 31,992 steps of 50 ms."""
    assert run(lap_of_a_standing_robot(tmp_path / 'lap', *arguments)) == 1
    result = json.loads(capsys.readouterr().out)
    assert (result['completed'], result['reason'], result['steps']) == (False, reason, steps)


def test_an_evaluation_ends_its_laps_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It does so on both lanes, and counts the laps as not completed."""
    command = lap_of_a_standing_robot(tmp_path / 'evaluation')
    command[0] = 'evaluate'
    assert run(command) == 0
    result = json.loads(capsys.readouterr().out)
    assert [lap['reason'] for lap in result['laps']] == ['no_progress'] * 2
    assert result['summary']['all']['completed']['successes'] == 0


def test_the_time_limit_fits_course_and_laps() -> None:
    """A limit that is given is kept; laps without end have no limit."""

    def max_steps(**episode: int) -> int:
        given = {f'simulator.episode.{name}': value for name, value in episode.items()}
        made = LapConfig.make(Request('1', 'braitenberg', 0, 'inprocess', given), 'inner')
        return made.simulator.episode.max_steps

    assert max_steps() == 31992
    assert max_steps(max_laps=3) == 95974
    assert max_steps(max_laps=0) == 0
    assert max_steps(max_steps=7) == 7
    two = {'courses': ('1', 'random:0-0')}  # of which the second one's outer lane has 36.379 m
    evaluation = EvaluateConfig.make(Request('1', 'braitenberg', 0, 'inprocess', {}), two)
    assert evaluation.simulator.episode.max_steps == 36380


@pytest.mark.parametrize('controller', ['rstdp', 'dqn'])
def test_a_training_has_no_such_limits(controller: str) -> None:
    """Learning needs every kind of drive, and ends after its steps."""
    config = TrainConfig.make(Request('1', controller, 0, 'inprocess', {}))
    assert config.simulator.episode.no_progress_steps == 0
