"""`SimulatorFleet`: each robot of a fleet does what `Simulator` does alone, bit for bit."""

import dataclasses

import numba
import numpy as np
import pytest

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.fleet.generators import generator_at, Generators, TEMPLATE
from spikelane_sim.fleet.kernel import make_scratch, simulate
from spikelane_sim.fleet.simulators import SimulatorFleet
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

RIGID = {'robot.engine': 'rigid', 'episode.max_distance_m': 0.0}
NOISY = {
    'pixels.coppelia.noise_rate_hz': 1.0,
    'link.event_loss': 0.3,
    'link.latency_ms': 100,
    'episode.no_progress_steps': 90,
}
SMALL = {'camera.width': 100, 'camera.height': 77}


@numba.njit
def one_step(world, robots, scratch, template, i, left, right):
    """Make a step in a kernel, as controllers do."""
    return simulate(world, robots, scratch, template, i, left, right)


@numba.njit
def draw(template, addresses):
    """Draw from each generator what pixels and controllers draw."""
    drawn = np.zeros((len(addresses), 4))
    for i in range(len(addresses)):
        rng = generator_at(template, addresses[i])
        drawn[i, 0] = rng.poisson(17.5)
        drawn[i, 1] = rng.random(3).sum()
        drawn[i, 2] = rng.integers(0, 50_000, 5).sum()
        drawn[i, 3] = rng.integers(0, 2, 7).sum()
    return drawn


def test_generators_in_a_kernel_draw_what_numpy_draws() -> None:
    """Also the states afterwards are NumPy's."""
    generators, expected = Generators(4), [np.random.default_rng([5, i]) for i in range(4)]
    for i in range(4):
        generators[i] = np.random.default_rng([5, i])
    drawn = draw(TEMPLATE, generators.addresses)
    for i, rng in enumerate(expected):
        assert drawn[i].tolist() == [
            rng.poisson(17.5),
            rng.random(3).sum(),
            rng.integers(0, 50_000, 5).sum(),
            rng.integers(0, 2, 7).sum(),
        ]
        assert generators[i].bit_generator.state == rng.bit_generator.state


@pytest.mark.parametrize(
    ('values', 'courses', 'has_planes'),
    [
        pytest.param({}, None, True, id='rigid'),
        pytest.param({'robot.engine': 'kinematic'}, None, True, id='kinematic'),
        pytest.param({'camera.antialias': True}, None, False, id='antialias'),
        pytest.param(NOISY, None, True, id='noise, loss and latency'),
        pytest.param({**NOISY, **SMALL, 'camera.antialias': True}, None, False, id='noisy, gray'),
        pytest.param(
            {'camera.width': 130}, ['random:1', 'random:2', 'scenario_2'], True, id='own courses'
        ),
        pytest.param(
            {**SMALL, 'pixels.coppelia.threshold': 5.0},
            ['random:1', 'random:2', 'scenario_2'],
            False,
            id='intensities that do not always fire',
        ),
    ],
)
def test_each_robot_does_what_it_does_alone(
    values: dict[str, object], courses: list[str] | None, has_planes: bool
) -> None:
    """Events, lane states and counts of commands, over two episodes, robots one by one."""
    parameters = SimulatorParameters.from_mapping({**RIGID, **values}, 'simulator')
    fleet = SimulatorFleet(3, parameters, courses=courses)
    assert fleet.world.has_planes == has_planes
    scratch, rng = make_scratch(fleet.world), np.random.default_rng(0)
    for robot in (2, 0, 1):
        course = parameters.course if courses is None else courses[robot]
        single = Simulator(dataclasses.replace(parameters, course=course))
        n_events = 0
        for seed in (5 + robot, None):
            lane = single.reset(None, seed).lane
            assert fleet.reset(robot, None, seed) == lane
            for step in range(120):
                left, right = rng.uniform(-0.3, 1.7, 2) * (10 if step % 50 == 0 else 1)
                left = np.nan if step == 77 else left
                observation = single.step(WheelVelocities(left, right))
                number = one_step(fleet.world, fleet.robots, scratch, TEMPLATE, robot, left, right)
                events = scratch.events[:number]
                for field in ('x', 'y', 'polarity'):
                    assert np.array_equal(observation.events[field], events[field])
                assert fleet.lane_state(robot) == observation.lane
                n_events += number
                if observation.lane.terminated:
                    break
        assert n_events > 500
        assert fleet.command_counts(robot) == single.command_counts
        assert (fleet.seed(robot), fleet.episode(robot)) == (5 + robot, 2)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({}, 'robot.engine: expected kinematic or rigid in a fleet, got pybullet'),
        (
            {'robot.engine': 'rigid', 'pixels.model': 'esim'},
            'pixels.model: expected coppelia in a fleet, got esim',
        ),
    ],
)
def test_what_the_kernel_does_not_have_is_refused_by_name(
    values: dict[str, object], message: str
) -> None:
    """Never silently different."""
    with pytest.raises(ParameterError) as caught:
        SimulatorFleet(1, SimulatorParameters.from_mapping(values, 'simulator'))
    assert str(caught.value) == message


def test_wrong_robots_and_resets_are_refused() -> None:
    """One clear error each."""
    parameters = SimulatorParameters.from_mapping(RIGID, 'simulator')
    with pytest.raises(SpikelaneError, match='n_robots: expected at least 1, got 0'):
        SimulatorFleet(0, parameters)
    with pytest.raises(SpikelaneError, match='courses: expected one for each robot, got 1'):
        SimulatorFleet(2, parameters, courses=['scenario_1'])
    fleet = SimulatorFleet(1, parameters)
    with pytest.raises(SpikelaneError, match='no episode has begun'):
        fleet.lane_state(0)
    with pytest.raises(SpikelaneError, match='seed: expected one in the first reset'):
        fleet.reset(0)
    with pytest.raises(SpikelaneError, match='lane: expected outer or inner'):
        fleet.reset(0, 'middle', 1)
    with pytest.raises(
        SpikelaneError, match='episode: expected a number from 1 to 4294967295, got 0'
    ):
        fleet.reset(0, None, 1, episode=0)
