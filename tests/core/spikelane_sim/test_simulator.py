"""The simulator: time, chance, episodes and commands."""

from __future__ import annotations

from collections.abc import Iterator
import hashlib
import math
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

import pytest

from spikelane_sim.contract import LaneState, Observation, WheelVelocities
from spikelane_sim.course import load_course
from spikelane_sim.errors import PoseError, SpikelaneError
from spikelane_sim.simulator import CommandCounts, Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

STEP_NS = 50_000_000
AHEAD = WheelVelocities(1.0, 1.0)
FAST = WheelVelocities(10.0, 10.0)  # 0.04875 m in a step

#: All engines, and the pixels that draw random numbers.
KINDS = {
    'pybullet': {'robot.model': 'pybullet'},
    'rigid': {'robot.engine': 'rigid'},
    'kinematic': {
        'robot.model': 'kinematic',
        'pixels.model': 'esim',
        'pixels.esim.shot_rate_hz': 5.0,
    },
}

CIRCLE = """
name: circle
description: A circle of one metre
road_width: 0.5
lane_width: 0.5
centre_line:
  start: {x: 0.0, y: 0.0, heading_deg: 0.0}
  parts:
    - {section: A, arc: {radius: 1.0, angle_deg: 180.0}}
    - {section: B, arc: {radius: 1.0, angle_deg: 180.0}}
lanes:
  only: {offset: 0.0, direction: along, first_section: A, start: {position: 0.5}}
markings:
  - {offset: 0.2, width: 0.04, style: solid}
floor_intensity: 0.0
marking_intensity: 1.0
"""
#: Wheels that drive along that circle at 0.04875 m a step: 10 (1 -+ track / 2).
AROUND = WheelVelocities(10 * (1 - 0.1655), 10 * (1 + 0.1655))


def make_simulator(**parameters: Any) -> Simulator:
    """Make a kinematic simulator; __ stands for a dot."""
    values = {name.replace('__', '.'): value for name, value in parameters.items()}
    return Simulator(SimulatorParameters.from_mapping({'robot.model': 'kinematic'} | values))


def lane_of(observation: Observation) -> LaneState:
    """Return the lane state, which a simulator always knows."""
    assert observation.lane is not None
    return observation.lane


def digest_of_two_episodes(simulator: Simulator, seed: int) -> str:
    """Hash every bit of two episodes of a sequence: 15 steps of each."""
    digest = hashlib.sha256()
    for begin in (seed, None):
        observation = simulator.reset(seed=begin, from_time_zero=begin is not None)
        for step in range(16):
            digest.update(repr(observation._replace(events=None)).encode())
            digest.update(repr(simulator.robot_state).encode())
            digest.update(observation.events.tobytes())
            if step < 15:
                observation = simulator.step(WheelVelocities(2.0 + step % 3, 3.0 - step % 2))
    return digest.hexdigest()


def digests(seed: int) -> list[str]:
    """Hash what both kinds of simulators do, each newly made."""
    found = []
    for values in KINDS.values():
        with Simulator(SimulatorParameters.from_mapping(values)) as simulator:
            found.append(digest_of_two_episodes(simulator, seed))
    return found


@pytest.fixture
def simulator() -> Iterator[Simulator]:
    """Give a kinematic simulator."""
    with make_simulator() as made:
        yield made


@pytest.fixture
def circle(tmp_path: Path) -> Iterator[Simulator]:
    """Give a robot on a circle, whose base_link is in the middle of its axle."""
    course = tmp_path / 'circle.yaml'
    course.write_text(CIRCLE)
    with make_simulator(course=str(course), robot__axle_x_m=0.0) as made:
        yield made


@pytest.mark.parametrize('kind', KINDS)
def test_a_seed_gives_the_same_bits_whatever_was_before(kind: str) -> None:
    """After other episodes as in a new simulator; another seed gives others."""
    parameters = SimulatorParameters.from_mapping(KINDS[kind])
    with Simulator(parameters) as used, Simulator(parameters) as new:
        first = digest_of_two_episodes(used, 7)
        used.reset('inner', 3)
        for _ in range(10):
            used.step(FAST)
        used.place(4.0, 0.3, 0.1)
        used.step(AHEAD)
        assert digest_of_two_episodes(used, 7) == first
        assert digest_of_two_episodes(new, 7) == first
        is_noisy = kind == 'kinematic'
        assert (digest_of_two_episodes(new, 8) != first) is is_noisy


def test_a_seed_gives_the_same_bits_in_another_process() -> None:
    """Nothing depends on what else is in memory, or on the hash seed."""
    environment = os.environ | {'PYTHONPATH': os.pathsep.join(sys.path), 'PYTHONHASHSEED': '5'}
    other = subprocess.run(
        [sys.executable, __file__, '11'],
        env=environment,
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert other.stdout.split() == digests(11)


def test_time_begins_at_one_step_and_goes_on_over_episodes(simulator: Simulator) -> None:
    """Zero means that there is no time yet."""
    assert simulator.time_ns == 0
    stamps = [simulator.reset(seed=1).stamp_ns, simulator.step(AHEAD).stamp_ns]
    stamps += [simulator.reset().stamp_ns, simulator.step(AHEAD).stamp_ns]
    stamps += [simulator.reset(seed=1).stamp_ns]
    assert stamps == [50_000_000, 100_000_000, 150_000_000, 200_000_000, 250_000_000]
    assert simulator.time_ns == 250_000_000


def test_time_begins_again_only_where_asked(simulator: Simulator) -> None:
    """With a reset from time zero, or with a reset of time alone."""
    simulator.reset()
    simulator.step(AHEAD)
    assert simulator.reset(from_time_zero=True).stamp_ns == STEP_NS
    driven = lane_of(simulator.step(AHEAD))
    again = simulator.reset_time()
    assert (again.stamp_ns, len(again.events), again.lane) == (STEP_NS, 0, driven)
    assert simulator.step(AHEAD).stamp_ns == 2 * STEP_NS


def test_time_alone_cannot_begin_again_before_an_episode(simulator: Simulator) -> None:
    """There is nothing to observe."""
    with pytest.raises(SpikelaneError, match='no episode has begun'):
        simulator.reset_time()


@pytest.mark.parametrize('kind', KINDS)
def test_the_first_observation_has_no_events(kind: str) -> None:
    """Even after a drive, for the camera forgets what it saw; the next ones have some."""
    with Simulator(SimulatorParameters.from_mapping(KINDS[kind])) as simulator:
        for _ in range(2):
            first = simulator.reset()
            assert len(first.events) == 0
            events = [simulator.step(FAST).events for _ in range(5)]
            assert sum(map(len, events)) > 0


def test_events_happen_within_their_step(simulator: Simulator) -> None:
    """After the last observation's stamp, up to their own."""
    last_ns = simulator.reset().stamp_ns
    for _ in range(5):
        observation = simulator.step(FAST)
        times = observation.events['t']
        assert len(times)
        assert last_ns < times.min() <= times.max() <= observation.stamp_ns
        last_ns = observation.stamp_ns


def test_an_episode_begins_at_the_start_of_its_lane(simulator: Simulator) -> None:
    """At rest in the middle, nothing driven."""
    lane = lane_of(simulator.reset('inner', 4))
    assert lane == LaneState(
        lane='inner',
        distance_m=pytest.approx(0.0, abs=1e-12),
        heading_error_rad=pytest.approx(0.0, abs=1e-12),
        position_m=pytest.approx(0.5, abs=1e-12),
        section='C',
        progress_m=0.0,
        laps=0,
        episode=1,
        step=0,
        terminated=False,
        reason='',
    )
    assert simulator.robot_state.position[:2] == pytest.approx((9.25, 7.0))
    assert simulator.robot_state.wheel_velocities == (0.0, 0.0)
    assert simulator.lane_state == lane


def test_lanes_take_turns(simulator: Simulator) -> None:
    """From the course's first; a seed begins a new sequence."""
    lanes = [lane_of(simulator.reset(seed=seed)) for seed in (None, None, None, 5, None)]
    assert [lane.lane for lane in lanes] == ['outer', 'inner', 'outer', 'outer', 'inner']
    assert [lane.episode for lane in lanes] == [1, 2, 3, 1, 2]
    assert simulator.seed == 5


def test_the_turn_goes_on_after_a_lane_that_was_named(simulator: Simulator) -> None:
    """The one after it is next, also if it was named with a seed."""
    lanes = [
        lane_of(simulator.reset(*reset)).lane for reset in (('inner', 1), (None,), ('outer',))
    ]
    lanes.append(lane_of(simulator.reset()).lane)
    assert lanes == ['inner', 'outer', 'outer', 'inner']


@pytest.mark.parametrize(
    ('lane', 'seed', 'message'),
    [
        ('middle', 3, "lane: expected outer or inner, got 'middle'"),
        ('inner', -1, 'seed: expected a whole number of at least 0, got -1'),
    ],
)
def test_a_wrong_reset_changes_nothing(
    simulator: Simulator, lane: str, seed: int, message: str
) -> None:
    """The episode that runs goes on."""
    simulator.reset(seed=2)
    with pytest.raises(SpikelaneError, match=message):
        simulator.reset(lane, seed, from_time_zero=True)
    after = simulator.step(AHEAD)
    assert (after.stamp_ns, simulator.seed, lane_of(after).episode) == (2 * STEP_NS, 2, 1)


def test_a_straight_drive_is_measured_exactly(simulator: Simulator) -> None:
    """1 rad/s times 0.0975 m and 0.05 s is 4.875 mm a step."""
    simulator.reset()
    for _ in range(40):
        lane = lane_of(simulator.step(AHEAD))
    assert lane.progress_m == pytest.approx(0.195, abs=1e-12)
    assert lane.position_m == pytest.approx(0.695, abs=1e-12)
    assert lane.distance_m == pytest.approx(0.0, abs=1e-12)
    assert (lane.step, lane.section, lane.terminated) == (40, 'A', False)


def test_a_robot_right_of_the_centre_has_a_positive_distance(simulator: Simulator) -> None:
    """The outer lane's centre is at y = 0.25 m there, driven along x."""
    simulator.reset()
    simulator.place(4.0, 0.15, 0.1)
    lane = lane_of(simulator.step(WheelVelocities(0.0, 0.0)))
    assert lane.distance_m == pytest.approx(0.1, abs=1e-12)
    assert lane.heading_error_rad == pytest.approx(0.1, abs=1e-12)
    assert lane.position_m == pytest.approx(1.5, abs=1e-12)


def test_a_robot_that_is_placed_has_not_driven(simulator: Simulator) -> None:
    """Progress, time and step go on from where they were."""
    simulator.reset()
    for _ in range(10):
        driven = simulator.step(AHEAD)
    simulator.place(6.0, 0.25, 0.0)
    assert simulator.robot_state.position[:2] == (6.0, 0.25)
    after = simulator.step(AHEAD)
    assert after.stamp_ns == driven.stamp_ns + STEP_NS
    assert lane_of(after).step == 11
    assert lane_of(after).progress_m == pytest.approx(11 * 0.004875, abs=1e-12)
    assert lane_of(after).position_m == pytest.approx(3.504875, abs=1e-12)


@pytest.mark.parametrize('y_m', [0.25 - 0.5, 0.25 + 0.5])
def test_a_lane_is_lost_beyond_half_a_metre_and_not_at_it(
    simulator: Simulator, y_m: float
) -> None:
    """On either side."""
    standing = WheelVelocities(0.0, 0.0)
    simulator.reset()
    simulator.place(5.0, y_m, 0.0)
    assert not lane_of(simulator.step(standing)).terminated
    simulator.place(5.0, y_m + math.copysign(1e-9, y_m - 0.25), 0.0)
    lost = lane_of(simulator.step(standing))
    assert (lost.terminated, lost.reason) == (True, 'lane_lost')


def test_no_lane_is_lost_where_the_limit_is_zero() -> None:
    """Zero is for never."""
    with make_simulator(episode__max_distance_m=0.0) as simulator:
        simulator.reset()
        simulator.place(5.0, -10.0, 0.0)
        lane = lane_of(simulator.step(AHEAD))
        assert (lane.distance_m, lane.terminated) == (pytest.approx(10.25), False)


def test_an_episode_ends_with_its_last_step() -> None:
    """Neither one earlier nor one later."""
    with make_simulator(episode__max_steps=3) as simulator:
        simulator.reset()
        ends = [lane_of(simulator.step(AHEAD)) for _ in range(3)]
        assert [(lane.terminated, lane.reason) for lane in ends] == [
            (False, ''),
            (False, ''),
            (True, 'step_limit'),
        ]


def test_a_lap_is_complete_after_its_length_has_been_driven(circle: Simulator) -> None:
    """2 pi m at 0.04875 m a step are 128.9 steps, wherever they began."""
    lane = lane_of(circle.reset())
    assert load_course(circle.parameters.course).lanes['only'].length_m == pytest.approx(math.tau)
    while not lane.terminated:
        before, lane = lane, lane_of(circle.step(AROUND))
        assert abs(lane.distance_m) < 1e-9
    assert (lane.step, lane.laps, lane.reason) == (129, 1, 'laps_complete')
    assert (before.laps, before.terminated) == (0, False)
    assert lane.progress_m == pytest.approx(129 * 0.04875, abs=1e-9)
    assert lane.position_m == pytest.approx(0.5 + 129 * 0.04875 - math.tau, abs=1e-9)


def test_driving_backwards_counts_down_and_completes_nothing(circle: Simulator) -> None:
    """What was driven backwards must be driven again; a lap once complete stays so."""
    circle.reset()
    backwards = WheelVelocities(-AROUND.left, -AROUND.right)
    for _ in range(140):
        lane = lane_of(circle.step(backwards))
    assert (lane.laps, lane.terminated) == (0, False)
    assert lane.progress_m == pytest.approx(-140 * 0.04875, abs=1e-9)
    for _ in range(140 + 128):
        lane = lane_of(circle.step(AROUND))
        assert lane.laps == 0
    assert lane_of(circle.step(AROUND)).laps == 1


def test_laps_go_on_where_they_do_not_end_the_episode(tmp_path: Path) -> None:
    """Two laps are 257.8 steps; going back does not take one away."""
    course = tmp_path / 'circle.yaml'
    course.write_text(CIRCLE)
    with make_simulator(course=str(course), robot__axle_x_m=0.0, episode__max_laps=0) as simulator:
        simulator.reset()
        laps = [lane_of(simulator.step(AROUND)).laps for _ in range(258)]
        assert [laps.count(number) for number in (0, 1, 2)] == [128, 129, 1]
        for _ in range(5):
            lane = lane_of(simulator.step(WheelVelocities(-AROUND.left, -AROUND.right)))
        assert (lane.laps, lane.progress_m < 2 * math.tau) == (2, True)


@pytest.mark.parametrize('wheels', [(math.nan, 1.0), (1.0, math.inf), (-math.inf, math.nan)])
def test_a_command_that_is_not_finite_stops_the_wheels_for_that_step(
    simulator: Simulator, wheels: tuple[float, float]
) -> None:
    """It is counted, and the next one counts again."""
    simulator.reset()
    before = lane_of(simulator.step(AHEAD))
    stopped = lane_of(simulator.step(WheelVelocities(*wheels)))
    assert stopped.progress_m == before.progress_m
    assert simulator.robot_state.wheel_velocities == (0.0, 0.0)
    assert lane_of(simulator.step(AHEAD)).progress_m > before.progress_m
    assert simulator.command_counts == CommandCounts(not_finite=1, clipped=0)


@pytest.mark.parametrize(
    ('wheels', 'driven', 'clipped'),
    [
        ((12.3, -12.3), (12.3, -12.3), 0),
        ((12.4, 1.0), (12.3, 1.0), 1),
        ((-13.0, 1e300), (-12.3, 12.3), 1),
    ],
)
def test_a_command_beyond_the_limit_is_clipped(
    simulator: Simulator, wheels: tuple[float, float], driven: tuple[float, float], clipped: int
) -> None:
    """Each wheel by itself; a command is counted once."""
    simulator.reset()
    simulator.step(WheelVelocities(*wheels))
    assert simulator.robot_state.wheel_velocities == driven
    assert simulator.command_counts == CommandCounts(not_finite=0, clipped=clipped)


def test_nothing_moves_without_an_episode(simulator: Simulator) -> None:
    """Neither before the first one nor after the last one's end."""
    with pytest.raises(SpikelaneError, match='no episode is running'):
        simulator.step(AHEAD)
    with pytest.raises(SpikelaneError, match='no episode is running'):
        simulator.place(1.0, 1.0, 0.0)
    simulator.reset()
    simulator.place(5.0, -3.0, 0.0)
    last = simulator.step(AHEAD)
    with pytest.raises(SpikelaneError, match='no episode is running'):
        simulator.step(AHEAD)
    with pytest.raises(SpikelaneError, match='no episode is running'):
        simulator.place(1.0, 1.0, 0.0)
    assert (simulator.time_ns, simulator.lane_state) == (last.stamp_ns, last.lane)


def test_a_closed_simulator_may_be_closed_again() -> None:
    """By hand and at the end of a block."""
    with Simulator() as simulator:
        simulator.reset()
        simulator.close()


if __name__ == '__main__':
    print(*digests(int(sys.argv[1])))


@pytest.mark.parametrize(
    'pose',
    [
        (1.7e308, 0.25, 0.0),
        (3.0, math.inf, 0.0),
        (math.nan, 0.25, 0.0),
        (3.0, 0.25, math.nan),
        (-10.1, 5.0, 0.0),
        (5.0, 20.1, 0.0),
    ],
)
def test_the_robot_is_placed_within_10_m_of_the_road(pose: tuple[float, float, float]) -> None:
    """The road of scenario 1 lies between 0 and 10 m in x and y."""
    with make_simulator() as simulator:
        simulator.reset('outer', 0)
        before = simulator.robot_state
        with pytest.raises(PoseError, match=r'^pose: expected x from -10\.0'):
            simulator.place(*pose)
        assert simulator.robot_state == before
        simulator.place(-10.0, 20.0, 0.0)
        assert simulator.step(AHEAD).lane.reason == 'lane_lost'


@pytest.mark.parametrize('episode', [0, 2**32, -1])
def test_an_episode_has_a_number_that_a_message_can_name(episode: int) -> None:
    """From 1 to 2^32 - 1; after the last one a sequence begins anew with a seed only."""
    with make_simulator() as simulator:
        with pytest.raises(SpikelaneError, match=rf'^episode: .*, got {episode}$'):
            simulator.reset('outer', 0, episode=episode)
        assert simulator.reset('outer', 0, episode=2**32 - 1).lane.episode == 4294967295
        with pytest.raises(SpikelaneError, match=r'^episode: .*, got 4294967296$'):
            simulator.reset()
        assert simulator.reset('outer', 1).lane.episode == 1
