"""Episodes that differ from each other by chance, in stated ranges."""

from __future__ import annotations

import numpy as np
import pytest

from spikelane_sim.conditions.schedule import Schedule
from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

RANDOM = {
    'robot.engine': 'kinematic',
    'randomisation.enabled': True,
    'randomisation.courses': ['scenario_1', 'random:4-6'],
}
#: What is drawn, with its bounds by the ranges that reference and docs state.
BOUNDS = {
    'pixels.coppelia.noise_rate_hz': (0.0, 1.0),
    'pixels.esim.shot_rate_hz': (0.0, 1.0),
    'pixels.coppelia.threshold': (0.08, 0.12),
    'pixels.esim.threshold_on': (0.16, 0.24),
    'pixels.esim.threshold_off': (0.16, 0.24),
    'camera.contrast': (0.5, 1.0),
    'camera.z_m': (0.097, 0.137),
    'camera.pitch_deg': (27.0, 33.0),
    'camera.yaw_deg': (-3.0, 3.0),
    'robot.left_wheel_factor': (0.95, 1.05),
    'robot.right_wheel_factor': (0.95, 1.05),
    'robot.track_factor': (0.95, 1.05),
    'link.event_loss': (0.0, 0.1),
}


def drawn(values: dict[str, object], episodes: int = 400) -> dict[str, list[object]]:
    """Return what each of some episodes has, by the names of the parameters."""
    schedule = Schedule(SimulatorParameters.from_mapping(values))
    found = [schedule.phases(3, number).first.to_dict() for number in range(1, episodes + 1)]
    return {name: [each[name] for each in found] for name in found[0]}


def test_each_episode_draws_uniformly_from_the_stated_ranges() -> None:
    """Each quarter of a range has its share; what has no range stays as it is."""
    found, usual = drawn(RANDOM), SimulatorParameters.from_mapping(RANDOM).to_dict()
    for name, (low, high) in BOUNDS.items():
        counts = np.histogram(np.array(found[name], float), 4, (low, high))[0]
        assert counts.sum() == 400, name
        assert counts / 400 == pytest.approx([0.25] * 4, abs=0.09), name
    for name, choices in (
        ('link.latency_ms', [0, 50, 100]),
        ('course', ['scenario_1', 'random:4', 'random:5', 'random:6']),
    ):
        counts = [found[name].count(each) for each in choices]
        assert sum(counts) == 400
        assert np.array(counts) / 400 == pytest.approx([1 / len(choices)] * len(choices), abs=0.09)
    changing = (*BOUNDS, 'link.latency_ms', 'course', 'randomisation.enabled')
    constant = {name for name in usual if name not in changing}
    assert all(set(map(str, found[name])) == {str(usual[name])} for name in constant)


def test_a_range_of_nought_leaves_a_parameter_alone_and_the_others_as_they_were() -> None:
    """So that one can be left out and the rest compared."""
    with_all, without = drawn(RANDOM, 20), drawn({**RANDOM, 'randomisation.yaw_deg': 0.0}, 20)
    assert without.pop('camera.yaw_deg') == [0.0] * 20
    del with_all['camera.yaw_deg'], with_all['randomisation.yaw_deg']
    assert without | with_all == without


def test_ranges_are_around_what_the_simulator_is_given() -> None:
    """Noise, latency and loss come on top; a contrast and a height are its own."""
    values = {**RANDOM, 'camera.z_m': 0.2, 'link.latency_ms': 50, 'camera.contrast': 0.8}
    found = drawn({**values, 'pixels.coppelia.noise_rate_hz': 2.0}, 50)
    assert min(found['camera.z_m']) >= 0.18
    assert max(found['camera.z_m']) <= 0.22
    assert set(found['link.latency_ms']) == {50, 100, 150}
    assert max(found['camera.contrast']) <= 0.8
    assert min(found['pixels.coppelia.noise_rate_hz']) >= 2.0


def test_an_episode_follows_from_seed_and_number_alone() -> None:
    """So a resumed training has the same courses and cameras as one that never stopped."""
    runs = []
    for first in (1, 3):
        with Simulator(SimulatorParameters.from_mapping(RANDOM)) as simulator:
            seen = []
            for number in range(first, 5):
                simulator.reset('inner', 7 if number == first else None, episode=number)
                steps = [simulator.step(WheelVelocities(1.2, 1.1)).events for _ in range(20)]
                events = np.concatenate(steps)  # their time goes on from episode to episode
                pixels = [events[name].tobytes() for name in ('x', 'y', 'polarity')]
                seen.append((simulator.course.name, pixels))
            runs.append(seen)
    assert runs[0][2:] == runs[1]
    assert len({name for name, _ in runs[0]}) > 1


def test_courses_that_cannot_follow_each_other_are_refused() -> None:
    """By name, before anything drives."""
    values = {**RANDOM, 'markings': 'scenario_2'}
    with pytest.raises(ParameterError, match='markings: expected a course with the lanes of'):
        Simulator(SimulatorParameters.from_mapping(values))


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        (
            {'camera.pitch_deg': 88.0},
            'randomisation: camera.pitch_deg: expected a number from -90 to 90 deg, got 91.0',
        ),
        (
            {'pixels.coppelia.noise_rate_hz': 1000.0},
            'randomisation: pixels.coppelia.noise_rate_hz: expected a number from 0 to 1000 Hz',
        ),
        ({'randomisation.courses': ['random:9-3']}, 'random:9-3'),
    ],
)
def test_ranges_that_reach_what_is_not_allowed_are_refused(
    values: dict[str, object], message: str
) -> None:
    """Before anything drives, not in the episode that draws it."""
    with pytest.raises(SpikelaneError) as caught:
        SimulatorParameters.from_mapping({**RANDOM, **values})
    assert message in str(caught.value)
