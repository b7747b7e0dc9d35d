"""Parameters that take other values while driving."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import current_config, SimulatorParameters

AHEAD = WheelVelocities(1.0, 1.0)  # 4.875 mm in a step
#: The wheel's own radius, and the distance between the wheels [m].
RADIUS_M, TRACK_M = 0.0975, 0.331


def make(changes: list[str], **perturbation: Any) -> SimulatorParameters:
    """Return parameters of a kinematic robot that changes, without an end of its episode."""
    values = {'robot.engine': 'kinematic', 'episode.max_distance_m': 0.0}
    given = {'changes': changes, **perturbation}
    return SimulatorParameters.from_mapping({**values, 'perturbation': given})


def drive(parameters: SimulatorParameters, episodes: int = 1, steps: int = 30) -> list[Any]:
    """Return the observations of the last of some episodes of straight commands."""
    seen: list[Observation] = []
    with Simulator(parameters) as simulator:
        for number in range(episodes):
            seen = [simulator.reset('outer', 0 if number == 0 else None)]
            seen += [simulator.step(AHEAD) for _ in range(steps)]
    return seen


def turned_rad(seen: list[Observation]) -> list[float]:
    """Return by how much the robot has turned in each step."""
    errors = [each.lane.heading_error_rad for each in seen if each.lane]
    return np.diff(errors).tolist()


def test_a_smaller_left_wheel_turns_the_robot_to_the_left_from_its_time_on() -> None:
    """By (1 - 0.9) r / b a radian of the wheels: 1.4727 mrad in a step."""
    parameters = make(['robot.left_wheel_factor=0.9'], time_s=0.5)
    expected = 0.1 * RADIUS_M / TRACK_M * 0.05
    assert turned_rad(drive(parameters)) == pytest.approx([0.0] * 10 + [expected] * 20, abs=1e-12)


def test_it_lasts_for_all_later_episodes_and_not_for_earlier_ones() -> None:
    """Here from the second episode on, whose first second is as before."""
    parameters = make(['robot.right_wheel_factor=1.2'], time_s=1.0, episode=2)
    expected = 0.2 * RADIUS_M / TRACK_M * 0.05
    for episodes, changed in ((1, 0), (2, 10), (3, 30)):
        turns = turned_rad(drive(parameters, episodes))
        wanted = [0.0] * (30 - changed) + [expected] * changed
        assert turns == pytest.approx(wanted, abs=1e-12)


def test_a_wider_track_turns_the_robot_less() -> None:
    """By the factor, whatever the wheels are."""
    turns = []
    for factor in (1.0, 1.25):
        values = {'robot.engine': 'kinematic', 'robot.track_factor': factor}
        with Simulator(SimulatorParameters.from_mapping(values)) as simulator:
            first = simulator.reset('outer', 0)
            then = simulator.step(WheelVelocities(1.0, 2.0))
            turns += turned_rad([first, then])
    assert turns[0] == pytest.approx(RADIUS_M / TRACK_M * 0.05)
    assert turns[1] == pytest.approx(turns[0] / 1.25)


def test_a_latency_that_grows_holds_the_last_command_that_arrived() -> None:
    """Two steps of standing still are felt two steps later; none is felt twice."""
    parameters = make(['link.latency_ms=100'], time_s=0.2)
    with Simulator(parameters) as simulator:
        seen = [simulator.reset('outer', 0)]
        for speed in (1, 1, 1, 1, 2, 3, 4, 5, 6, 7):
            seen.append(simulator.step(WheelVelocities(speed, speed)))
    progress = [each.lane.progress_m for each in seen if each.lane]
    speeds = np.diff(progress) / 0.004875
    assert speeds == pytest.approx([1, 1, 1, 1, 1, 1, 2, 3, 4, 5])


def test_dead_pixels_are_silent_and_the_others_as_before() -> None:
    """A share of 30 % of them, from its time on; a pixel's events are lost, not changed."""
    noisy = {'pixels.coppelia.noise_rate_hz': 20.0, 'robot.engine': 'kinematic'}
    runs = []
    for changes in ([], ['pixels.dead_share=0.3']):
        values = {**noisy, 'perturbation.changes': changes, 'perturbation.time_s': 0.5}
        runs.append(drive(SimulatorParameters.from_mapping(values)))
    whole, part = ([each.events for each in run] for run in runs)
    assert all(np.array_equal(*pair) for pair in zip(whole[:11], part[:11], strict=True))
    silent = set()
    for all_events, living in zip(whole[11:], part[11:], strict=True):
        places = {(x, y) for _, x, y, _ in living.tolist()}
        lost = {(x, y) for _, x, y, _ in all_events.tolist()} - places
        assert {tuple(each) for each in living.tolist()} <= {
            tuple(each) for each in all_events.tolist()
        }
        assert not places & silent
        silent |= lost
    assert len(silent) / 128**2 == pytest.approx(0.3, abs=0.01)


def test_a_camera_that_is_turned_sees_what_one_that_was_always_so_sees() -> None:
    """In all steps but that in which it turns, which has events of the turn."""
    turned = drive(make(['camera.yaw_deg=5'], time_s=0.5))
    values = {'robot.engine': 'kinematic', 'camera.yaw_deg': 5.0}
    always = drive(SimulatorParameters.from_mapping(values))
    assert len(turned[11].events) > 5 * len(always[11].events)
    for one, other in zip(turned[12:], always[12:], strict=True):
        assert np.array_equal(one.events, other.events)


def test_markings_of_another_course_on_the_same_road_can_be_seen() -> None:
    """Scenario 2 has the roads of scenario 1 without the edges."""
    faded = drive(make(['markings=scenario_2'], time_s=0.5))
    values = {'robot.engine': 'kinematic', 'course': 'scenario_2'}
    other = drive(SimulatorParameters.from_mapping(values))
    for one, wanted in zip(faded[12:], other[12:], strict=True):
        assert np.array_equal(one.events, wanted.events)
    with pytest.raises(ParameterError, match='markings: expected a course with the lanes of'):
        Simulator(make(['markings=random:1']))


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        (['camera.fov_deg=90'], 'expected NAME=VALUE with one of markings, camera.x_m'),
        (['camera.yaw_deg'], "got 'camera.yaw_deg'"),
        (['camera.yaw_deg=5', 'camera.yaw_deg=6'], 'expected camera.yaw_deg once, got it twice'),
        (['camera.yaw_deg=left'], 'camera.yaw_deg: expected a number from -180 to 180 deg'),
        (['link.latency_ms=70'], 'latency_ms: expected a multiple of 50 ms, the control period'),
        (['pixels.dead_share=['], 'perturbation.changes: expected a value as in YAML'),
    ],
)
def test_what_cannot_change_is_refused_by_name(changes: list[str], message: str) -> None:
    """When the parameters are made, not when it would change."""
    with pytest.raises(ParameterError) as caught:
        make(changes)
    assert message in str(caught.value)


def test_runs_of_earlier_versions_are_those_without_changes() -> None:
    """What their configurations lack is as the defaults are."""
    now = SimulatorParameters().to_dict()
    former = {
        name: value
        for name, value in now.items()
        if not name.startswith(('perturbation.', 'randomisation.', 'pixels.dead_'))
        and name not in ('markings', 'camera.yaw_deg', 'camera.contrast')
        and not (name.startswith('robot.') and name.endswith('_factor'))
    }
    assert len(now) - len(former) > 20
    assert current_config({'simulator': former}) == {'simulator': now}
