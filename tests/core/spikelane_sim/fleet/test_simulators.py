"""`SimulatorFleet`: each robot of a fleet does what `Simulator` does alone, bit for bit."""

import dataclasses
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray
import pytest

from spikelane_sim.contract import RobotState, WheelVelocities
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.events import Events
from spikelane_sim.filters import FilterParameters, FilterStage
from spikelane_sim.filters import kind as filter_kinds
from spikelane_sim.filters.hot_pixels import HotPixels, write_hot_pixels
from spikelane_sim.fleet import bodies
from spikelane_sim.fleet.generators import generator_at, Generators, TEMPLATE
from spikelane_sim.fleet.kernel import make_scratch, simulate
from spikelane_sim.fleet.simulators import SimulatorFleet
from spikelane_sim.period import PERIOD_NS
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

RIGID = {'robot.engine': 'rigid', 'episode.max_distance_m': 0.0}
PYBULLET = {'robot.engine': 'pybullet'}
NOISY = {
    'pixels.coppelia.noise_rate_hz': 1.0,
    'link.event_loss': 0.3,
    'link.latency_ms': 100,
    'episode.no_progress_steps': 90,
}
SMALL = {'camera.width': 100, 'camera.height': 77}
ESIM = {
    'pixels.model': 'esim',
    'pixels.esim.shot_rate_hz': 3.0,
    'pixels.esim.hot_share': 0.001,
    'pixels.esim.refractory_s': 0.004,
    'pixels.esim.threshold_off': 0.25,
    'episode.no_progress_steps': 90,
}
LATE = {**ESIM, 'pixels.esim.latency_s': 0.07, 'pixels.esim.substeps': 5}
#: All that can change while driving, in the second second of the first episode.
CHANGES = [
    'markings=scenario_2',
    'camera.z_m=0.13',
    'camera.yaw_deg=5',
    'pixels.dead_share=0.3',
    'pixels.coppelia.noise_rate_hz=2.0',
    'pixels.esim.shot_rate_hz=2.0',
    'link.latency_ms=100',
    'link.event_loss=0.2',
    'robot.left_wheel_factor=0.9',
    'robot.track_factor=1.05',
]
CHANGED = {'perturbation.changes': CHANGES, 'perturbation.time_s': 1.2}
FADED = {'perturbation.changes': ['camera.contrast=0.3'], 'perturbation.time_s': 0.5}
RANDOM = {
    'randomisation.enabled': True,
    'randomisation.courses': ['scenario_1', 'random:1-3'],
    'perturbation.changes': ['link.latency_ms=0', 'pixels.dead_share=0.1'],
    'perturbation.episode': 2,
    'perturbation.time_s': 2.0,
}


@numba.njit
def one_step(world, robots, scratch, template, i, left, right):
    """Make a step in a kernel, as controllers do."""
    return simulate(world, robots, scratch, template, i, left, right)


@numba.njit
def draw(template, addresses):
    """Draw from each generator what pixels and controllers draw."""
    drawn = np.zeros((len(addresses), 5))
    for i in range(len(addresses)):
        rng = generator_at(template, addresses[i])
        drawn[i, 0] = rng.poisson(17.5)
        drawn[i, 1] = rng.random(3).sum()
        drawn[i, 2] = rng.integers(0, 50_000, 5).sum()
        drawn[i, 3] = rng.integers(0, 2, 7).sum()
        drawn[i, 4] = rng.poisson(0.7) + rng.poisson(8192.0)
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
            rng.poisson(0.7) + rng.poisson(8192.0),
        ]
        assert generators[i].bit_generator.state == rng.bit_generator.state


def assert_same_events(events: Events, expected: Events, begin_ns: int) -> None:
    """Assert that a fleet has the same events; its time is that since the episode began."""
    assert len(events) == len(expected)
    for field in ('x', 'y', 'polarity'):
        assert np.array_equal(events[field], expected[field])
    assert np.array_equal(events['t'] + begin_ns, expected['t'])


@pytest.mark.parametrize(
    ('values', 'courses', 'has_planes'),
    [
        pytest.param({}, None, True, id='rigid'),
        pytest.param({'robot.engine': 'kinematic'}, None, True, id='kinematic'),
        pytest.param(PYBULLET, None, True, id='pybullet'),
        pytest.param({**PYBULLET, **CHANGED, **NOISY}, None, True, id='pybullet, changed'),
        pytest.param({**PYBULLET, **LATE, **SMALL}, None, False, id='pybullet, esim'),
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
        pytest.param(ESIM, None, False, id='esim'),
        pytest.param(
            {**LATE, **SMALL, 'camera.antialias': True, 'robot.engine': 'kinematic'},
            ['random:1', 'random:2', 'scenario_2'],
            False,
            id='esim with latency, gray',
        ),
        pytest.param({**ESIM, 'link.event_loss': 0.3}, None, False, id='esim with loss'),
        pytest.param(CHANGED, None, True, id='changed while driving'),
        pytest.param({**CHANGED, **ESIM, **SMALL}, None, False, id='esim, changed'),
        pytest.param({**FADED, **SMALL}, None, False, id='faded'),
        pytest.param(RANDOM, None, False, id='randomised'),
        pytest.param({**RANDOM, **LATE, **SMALL}, None, False, id='esim, randomised'),
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
            first = single.reset(None, seed)
            assert fleet.reset(robot, None, seed) == first.lane
            begin_ns = first.stamp_ns - PERIOD_NS
            for step in range(120):
                left, right = rng.uniform(-0.3, 1.7, 2) * (10 if step % 50 == 0 else 1)
                left = np.nan if step == 77 else left
                observation = single.step(WheelVelocities(left, right))
                events = one_step(fleet.world, fleet.robots, scratch, TEMPLATE, robot, left, right)
                assert_same_events(events, observation.events, begin_ns)
                assert fleet.lane_state(robot) == observation.lane
                n_events += len(events)
                if observation.lane.terminated:
                    break
        assert n_events > 500
        assert fleet.command_counts(robot) == single.command_counts
        assert (fleet.seed(robot), fleet.episode(robot)) == (5 + robot, 2)


@pytest.mark.parametrize('changed', [{}, CHANGED], ids=['plain', 'with unequal wheels'])
@pytest.mark.parametrize('engine', ['kinematic', 'rigid', 'pybullet'])
def test_encoders_measure_what_they_measure_alone(engine: str, changed: dict[str, object]) -> None:
    """To rounding."""
    values = {**RIGID, **changed, 'robot.engine': engine}
    parameters = SimulatorParameters.from_mapping(values, 'simulator')
    fleet, single = SimulatorFleet(2, parameters), Simulator(parameters)
    single.reset(None, 3)
    fleet.reset(1, None, 3)
    scratch = make_scratch(fleet.world)
    for _ in range(40):
        single.step(WheelVelocities(1.5, 2.0))
        one_step(fleet.world, fleet.robots, scratch, TEMPLATE, 1, 1.5, 2.0)
    fleet.reset(0, None, 3)
    assert fleet.wheel_velocities()[0] == pytest.approx([0.0, 0.0], abs=1e-9)
    measured = single.robot_state.wheel_velocities
    assert fleet.wheel_velocities()[1] == pytest.approx(measured, rel=1e-9)


class _Stuck:
    """A robot that does not come on, and then breaks."""

    closed = 0

    def __init__(self) -> None:
        self.steps = 0

    def reset(self, x_m: float, y_m: float, heading_rad: float) -> None:
        self.state = RobotState(
            position=(x_m, y_m, 0.0),
            orientation=(0.0, 0.0, np.sin(heading_rad / 2), np.cos(heading_rad / 2)),
            linear=(0.0, 0.0, 0.0),
            angular=(0.0, 0.0, 0.0),
            wheel_angles=(0.0, 0.0),
            wheel_velocities=(0.0, 0.0),
        )

    def step(self, wheels: WheelVelocities) -> NDArray[np.float64]:
        self.steps += 1
        if self.steps > 3:
            raise SpikelaneError(f'stuck: expected room ahead, got {wheels.left} rad/s')
        return np.array([self.state.position + self.state.orientation])

    def close(self) -> None:
        _Stuck.closed += 1


def test_an_engine_of_another_package_drives_in_a_fleet(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it raises comes through the kernel; its robots are closed once."""
    monkeypatch.setattr(bodies, 'make_robot', lambda *_: _Stuck())
    parameters = SimulatorParameters.from_mapping({'robot.engine': 'pybullet'}, 'simulator')
    fleet = SimulatorFleet(2, parameters)
    start = fleet.reset(1, None, 3)
    scratch = make_scratch(fleet.world)
    for _ in range(3):
        one_step(fleet.world, fleet.robots, scratch, TEMPLATE, 1, 1.5, 2.0)
    assert fleet.lane_state(1).position_m == start.position_m
    assert fleet.lane_state(1).step == 3
    with pytest.raises(SpikelaneError, match=r'^stuck: expected room ahead, got 1\.5 rad/s$'):
        one_step(fleet.world, fleet.robots, scratch, TEMPLATE, 1, 1.5, 2.0)
    numbers = set(fleet.robots.bodies.tolist())
    assert numbers <= bodies._robots.keys()
    fleet.close()
    fleet.close()
    assert _Stuck.closed == 2
    assert not numbers & bodies._robots.keys()


FILTERS = {
    'nearest_neighbour': {'nearest_neighbour.window_s': 0.05},
    'correlation': {
        'correlation.window_s': 0.005,
        'correlation.reach_px': 2,
        'correlation.same_polarity': True,
    },
    'refractory': {'refractory.period_s': 0.06},
    'hot_pixels, refractory, correlation, nearest_neighbour': {'correlation.window_s': 0.01},
}


@pytest.mark.parametrize('chain', FILTERS)
@pytest.mark.parametrize('pixels', [NOISY, LATE], ids=['coppelia', 'esim'])
def test_filters_let_the_same_events_pass(
    chain: str, pixels: dict[str, object], tmp_path: Path
) -> None:
    """Over two episodes; events of the first one support none of the second one."""
    mask = tmp_path / 'hot.json'
    hot = [[x, y] for y in range(128) for x in range(0, 128, 3)]
    write_hot_pixels(mask, HotPixels(128, 128, np.array(hot)))
    values = {'chain': chain, **FILTERS[chain], 'hot_pixels.file': str(mask)}
    filters = FilterParameters.from_mapping(values, 'filter')
    parameters = SimulatorParameters.from_mapping({**RIGID, **pixels}, 'simulator')
    fleet, single = SimulatorFleet(2, parameters, filters=filters), Simulator(parameters)
    stage = FilterStage(filters, 128, 128)
    scratch, rng = make_scratch(fleet.world), np.random.default_rng(1)
    fleet.reset(0, None, 1)
    for seed in (8, None):
        first = single.reset(None, seed)
        stage.observe(first)
        fleet.reset(1, None, seed)
        begin_ns = first.stamp_ns - PERIOD_NS
        for _ in range(60):
            left, right = rng.uniform(0.7, 1.5, 2)
            seen = single.step(WheelVelocities(left, right))
            one_step(fleet.world, fleet.robots, scratch, TEMPLATE, 0, right, left)
            events = one_step(fleet.world, fleet.robots, scratch, TEMPLATE, 1, left, right)
            assert_same_events(events, stage.observe(seen).events, begin_ns)
            assert fleet.robots.known['n_events'][1] == len(seen.events)
    assert 0 < stage.events_out < stage.events_in


def test_a_filter_that_is_not_compiled_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """As one of another package, which has no part in the kernel."""
    kinds = {**filter_kinds.filter_kinds()}
    kinds['refractory'] = kinds['refractory']._replace(is_compiled=False)
    monkeypatch.setattr(filter_kinds, 'filter_kinds', lambda: kinds)
    parameters = SimulatorParameters.from_mapping(RIGID, 'simulator')
    with pytest.raises(ParameterError) as caught:
        SimulatorFleet(1, parameters, filters=FilterParameters(chain='refractory'))
    expected = 'filter.chain: expected filters that are compiled in a fleet, got refractory'
    assert str(caught.value) == expected


def test_more_waiting_events_than_there_is_room_for_are_an_error() -> None:
    """The kernel says so."""
    parameters = SimulatorParameters.from_mapping({**RIGID, **LATE}, 'simulator')
    fleet = SimulatorFleet(1, parameters)
    robots = fleet.robots._replace(waiting=fleet.robots.waiting[:, :5].copy())
    scratch = make_scratch(fleet.world)
    fleet.reset(0, None, 1)
    with pytest.raises(SpikelaneError, match=r'pixels.esim.latency_s: expected fewer events'):
        one_step(fleet.world, robots, scratch, TEMPLATE, 0, 1.0, 1.0)


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
