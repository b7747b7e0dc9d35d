"""The control period and the speed: simulators that step faster, and robots that drive faster."""

from typing import Any

import numpy as np
import pytest

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.encoding import StateImage, StateImageParameters
from spikelane_sim.env import LaneKeepingEnv
from spikelane_sim.errors import ParameterError
from spikelane_sim.fleet.vector_env import LaneKeepingVectorEnv
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import current_config, SimulatorParameters

TURNING = WheelVelocities(3.0, 4.0)


def make(**values: Any) -> Simulator:
    """Make a simulator of these parameters, `__` for a point."""
    named = {name.replace('__', '.'): value for name, value in values.items()}
    free = {'episode.max_distance_m': 0.0}
    return Simulator(SimulatorParameters.from_mapping(free | named))


def pose_after(seconds: float, wheels: WheelVelocities, **values: Any) -> list[float]:
    """Return x, y and the quaternion's z after driving for so long with the same command."""
    with make(**values) as simulator:
        simulator.reset('outer', 1)
        for _ in range(round(seconds / simulator.parameters.period_s)):
            simulator.step(wheels)
        state = simulator.robot_state
        return [*state.position[:2], state.orientation[2]]


def test_a_step_lasts_the_period() -> None:
    """Stamps count it from the first observation on; 10 ms of 2 rad/s are 1.95 mm."""
    with make(period_ms=10, robot__engine='kinematic') as simulator:
        seen = [simulator.reset('outer', 1)]
        seen += [simulator.step(WheelVelocities(2.0, 2.0)) for _ in range(3)]
    assert [each.stamp_ns for each in seen] == [10_000_000, 20_000_000, 30_000_000, 40_000_000]
    assert seen[-1].lane is not None
    assert seen[-1].lane.progress_m == pytest.approx(3 * 0.00195, abs=1e-12)


@pytest.mark.parametrize('engine', ['rigid', 'pybullet'])
@pytest.mark.parametrize('period_ms', [5, 10, 20, 25])
def test_the_physics_takes_the_same_steps_with_every_period(engine: str, period_ms: int) -> None:
    """Of 5 ms: after 0.6 s of one command the robot is where it is with steps of 50 ms."""
    usual = pose_after(0.6, TURNING, robot__engine=engine)
    found = pose_after(0.6, TURNING, robot__engine=engine, period_ms=period_ms)
    assert found == pytest.approx(usual, abs=1e-6)


@pytest.mark.parametrize('period_ms', [5, 7, 10, 20, 33])
def test_the_ideal_drive_is_exact_with_every_period(period_ms: int) -> None:
    """On an arc of radius r track / 2 (l + r) / (r - l), here 7 / 2 times the track."""
    seconds = 70 * period_ms / 1000
    turned = (4.0 - 3.0) * 0.0975 / 0.331 * seconds
    *_, z = pose_after(seconds, TURNING, robot__engine='kinematic', period_ms=period_ms)
    assert z == pytest.approx(np.sin(turned / 2), abs=1e-9)


def test_the_speed_is_a_factor_on_both_wheels() -> None:
    """Before the robot's limit: 2 rad/s three times are 6, and 8 are the limit of 12.3."""
    with make(robot__engine='kinematic', speed=3.0) as simulator:
        simulator.reset('outer', 1)
        simulator.step(WheelVelocities(2.0, -1.0))
        assert simulator.robot_state.wheel_velocities == (6.0, -3.0)
        simulator.step(WheelVelocities(8.0, 1.0))
        assert simulator.robot_state.wheel_velocities == (12.3, 3.0)
        assert simulator.command_counts.clipped == 1


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'period_ms': 4}, 'period_ms: expected a whole number from 5 to 50 ms, got 4'),
        ({'period_ms': 51}, 'period_ms: expected a whole number from 5 to 50 ms, got 51'),
        ({'period_ms': 12.5}, 'period_ms: expected a whole number from 5 to 50 ms, got 12.5'),
        (
            {'period_ms': 20, 'link__latency_ms': 50},
            'link.latency_ms: expected a multiple of 20 ms, the control period, got 50',
        ),
        (
            {'period_ms': 12},
            'physics_step_s: expected a whole fraction of 0.012 s like 0.005 or 0.001, got 0.005',
        ),
    ],
)
def test_what_does_not_fit_the_period_is_refused(values: dict[str, Any], message: str) -> None:
    """One sentence names the parameter."""
    with pytest.raises(ParameterError, match=message):
        make(**values)


def test_latency_is_counted_in_periods() -> None:
    """30 ms are three steps of 10 ms, in which the wheels stand."""
    with make(robot__engine='kinematic', period_ms=10, link__latency_ms=30) as simulator:
        simulator.reset('outer', 1)
        moved = []
        for _ in range(5):
            simulator.step(WheelVelocities(1.0, 1.0))
            moved.append(simulator.robot_state.wheel_velocities[0] > 0)
    assert moved == [False, False, False, True, True]


def test_what_is_for_50_ms_is_converted() -> None:
    """Ten steps of 50 ms are 25 of 20 ms, 71 of 7 ms, and one is never less than one."""
    steps = [SimulatorParameters(period_ms=period_ms).steps_of(10) for period_ms in (50, 20, 7, 5)]
    assert steps == [10, 25, 71, 100]
    assert SimulatorParameters(period_ms=49).steps_of(1) == 1
    assert SimulatorParameters(period_ms=10).steps_of(8, 10) == 8
    assert SimulatorParameters(period_ms=20).steps_of(8, 5) == 2
    assert SimulatorParameters().steps_of(1, 5) == 1
    assert SimulatorParameters(period_ms=20).share == 0.4
    assert StateImageParameters().frames == 10


@pytest.mark.parametrize(
    ('frames', 'frame_ms', 'steps'), [(10, 50, 10), (8, 10, 2), (20, 5, 2), (1, 5, 1)]
)
def test_an_image_counts_frames_of_any_length(frames: int, frame_ms: int, steps: int) -> None:
    """In steps of 50 ms, rounded to whole ones: at least one."""
    image = StateImage(StateImageParameters(frames=frames, frame_ms=frame_ms))
    assert len(image.frames) == steps


def test_an_action_of_the_environment_lasts_half_a_second() -> None:
    """Also with steps of 20 ms: 25 of them."""
    simulator = {'robot.engine': 'kinematic', 'period_ms': 20, 'speed': 2.0}
    environment = LaneKeepingEnv(simulator=simulator)
    environment.reset(seed=3, options={'lane': 'outer'})
    for action in (1, 0, 2):
        *_, info = environment.step(action)
    assert info['lane_state'].step == 75
    assert info['lane_state'].progress_m == pytest.approx(1.5 * 2.0 * 0.0975, rel=0.01)


def test_an_action_of_the_environment_can_be_shorter() -> None:
    """Two steps of 10 ms, alone and in a vector."""
    simulator = {'robot.engine': 'kinematic', 'period_ms': 10}
    task = {'steps_per_action': 2, 'step_ms': 10}
    environment = LaneKeepingEnv(simulator=simulator, task=task)
    environment.reset(seed=3, options={'lane': 'outer'})
    environment.step(1)
    assert environment.step(0)[-1]['lane_state'].step == 4
    vector = LaneKeepingVectorEnv(1, simulator=simulator, task=task)
    vector.reset(seed=3, options={'lane': 'outer'})
    vector.step([1])
    assert vector.step([0])[-1]['lane_state'][0].step == 4


def test_runs_of_earlier_versions_had_steps_of_50_ms() -> None:
    """And drove with the controller's own velocities."""
    old = current_config({'simulator': {'robot.model': 'p3dx'}})
    assert (old['simulator']['period_ms'], old['simulator']['speed']) == (50, 1.0)
