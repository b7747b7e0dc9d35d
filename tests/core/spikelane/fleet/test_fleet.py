"""`Fleet`: N robots with controllers, each as it would be alone, bit for bit."""

from typing import Any

import numpy as np
import pytest

from spikelane.fleet import Fleet
from spikelane.loop import drive_episode
from spikelane_controllers.registry import make_controller
from spikelane_sim.contract import controller_rng, LaneState
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.filters import FilterParameters, FilterStage
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

LEARNING = {'learning': True, 'checkpoint': ''}
NOISY = {
    'robot.engine': 'rigid',
    'episode.max_distance_m': 0.2,
    'pixels.coppelia.noise_rate_hz': 0.3,
    'link.event_loss': 0.1,
    'link.latency_ms': 50,
    'camera.antialias': True,
}
REAL = {
    'robot.engine': 'kinematic',
    'episode.max_distance_m': 0.2,
    'pixels.model': 'esim',
    'pixels.esim.shot_rate_hz': 1.0,
    'camera.antialias': True,
}
CORRELATION = {'chain': 'refractory, correlation', 'correlation.window_s': 0.005}
SEEDS = (3, 4, 5)


def drive_alone(
    name: str,
    seed: int,
    simulator: dict[str, Any],
    parameters: dict[str, Any],
    filters: dict[str, Any],
    steps: int,
) -> tuple[Any, list[LaneState]]:
    """Do what a training does, observation by observation; return the controller and the ends."""
    controller: Any = make_controller(name, parameters)
    if hasattr(controller, 'initialise'):
        controller.initialise(controller_rng(seed, 0))
    ends: list[LaneState] = []
    taken = 0
    stage = FilterStage(FilterParameters.from_mapping(filters, 'filter'), 128, 128)
    with Simulator(SimulatorParameters.from_mapping(simulator, 'simulator')) as single:
        observation = single.reset(None, seed)
        controller.reset(controller_rng(seed, 1))
        while taken < steps:
            wheels = controller.step(stage.observe(observation))
            lane = observation.lane
            assert lane is not None
            if lane.terminated:
                ends.append(lane)
                observation = single.reset()
                controller.reset(controller_rng(seed, lane.episode + 1))
                continue
            taken += 1
            observation = single.step(wheels)
    return controller, ends


@pytest.mark.parametrize(
    ('name', 'parameters', 'simulator', 'filters'),
    [
        pytest.param(
            'rstdp',
            LEARNING,
            {'robot.engine': 'kinematic', 'episode.max_distance_m': 0.2},
            {},
            id='learning',
        ),
        pytest.param('rstdp', LEARNING, NOISY, {}, id='learning with noise'),
        pytest.param('rstdp', LEARNING, REAL, CORRELATION, id='learning with filters'),
        pytest.param(
            'rstdp', {}, {'robot.engine': 'rigid', 'course': 'random:3'}, {}, id='trained'
        ),
        pytest.param(
            'braitenberg',
            {},
            {'robot.engine': 'rigid', 'episode.max_steps': 700},
            {'chain': 'nearest_neighbour'},
            id='by hand',
        ),
    ],
)
@pytest.mark.parametrize('threads', [1, 2])
def test_each_robot_drives_as_alone(
    name: str,
    parameters: dict[str, Any],
    simulator: dict[str, Any],
    filters: dict[str, Any],
    threads: int,
) -> None:
    """Ends of episodes, and all that the controllers are afterwards."""
    with Fleet(
        name,
        SEEDS,
        simulator=simulator,
        parameters=parameters,
        filters=filters,
        threads=threads,
    ) as fleet:
        fleet.initialise()
        # In two parts: where one ends makes no difference.
        ends = [*fleet.drive(777), *fleet.drive(723)]
        assert fleet.steps.tolist() == [1500] * len(SEEDS)
        for robot, seed in enumerate(SEEDS):
            alone, expected = drive_alone(name, seed, simulator, parameters, filters, 1500)
            assert [end.lane_state for end in ends if end.robot == robot] == expected
            together = fleet.controller(robot)
            assert together.rng.bit_generator.state == alone.rng.bit_generator.state
            assert together.steering == alone.steering
            assert together.spikes == alone.spikes
            assert together.shown.operations == alone.shown.operations
            assert together.shown.reward == pytest.approx(
                alone.shown.reward, rel=0, abs=0, nan_ok=True
            )
            if hasattr(alone, 'state'):
                mine = together.state()
                for field, value in alone.state().items():
                    assert np.array_equal(mine[field], value), field


def test_laps_are_those_of_single_robots_on_their_own_courses() -> None:
    """The table of a fleet has the numbers of single laps."""
    courses = ['random:1', 'random:2']
    limits = {'robot.engine': 'kinematic', 'episode.max_steps': 400}
    with Fleet('rstdp', [7, 8], simulator=limits, courses=courses, threads=2) as fleet:
        ends, table = fleet.lap('inner')
    for robot, (seed, course) in enumerate(zip([7, 8], courses, strict=True)):
        rows: list[tuple[float, float, float]] = []
        parameters = SimulatorParameters.from_mapping({**limits, 'course': course}, 'simulator')
        with Simulator(parameters) as single:
            last = drive_episode(
                single,
                make_controller('rstdp'),
                lambda seen, wheels, rows=rows: rows.append((seen.lane.distance_m, *wheels)),
                lane='inner',
                seed=seed,
                controller_seed=seed,
            )
        assert ends[robot] == last.lane
        mine = table[table['robot'] == robot]
        columns = mine[['distance_m', 'left_rad_s', 'right_rad_s']].to_numpy()
        assert np.array_equal(columns, np.array(rows)[:-1])  # the last one ended the episode
        assert mine['t_s'].tolist() == [step * 0.05 for step in range(len(rows) - 1)]


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (('dqn_snn', [0]), r'expected one that drives a fleet \(.*rstdp.*\), got dqn_snn'),
        (('rstdp', []), 'n_robots: expected at least 1, got 0'),
    ],
)
def test_what_cannot_be_a_fleet_is_refused(arguments: Any, message: str) -> None:
    """By name."""
    with pytest.raises(SpikelaneError, match=message):
        Fleet(*arguments, simulator={'robot.engine': 'rigid'})


def test_wrong_threads_images_and_endless_laps_are_refused() -> None:
    """One clear error each."""
    rigid = {'robot.engine': 'rigid'}
    with pytest.raises(SpikelaneError, match='threads: expected at least 1, got 0'):
        Fleet('rstdp', [0], simulator=rigid, threads=0)
    with pytest.raises(ParameterError, match='encoding: expected 64 x 128 px'):
        Fleet('rstdp', [0], simulator={**rigid, 'camera.width': 64})
    endless = {**rigid, 'episode.max_laps': 0}
    with (
        Fleet('braitenberg', [0], simulator=endless) as fleet,
        pytest.raises(SpikelaneError, match='expected a limit, or a lap may never end'),
    ):
        fleet.lap()


def test_a_controller_with_other_parameters_is_refused() -> None:
    """The kernel has the parameters of all: it would drive with others than the controller's."""
    with Fleet('rstdp', [0], simulator={'robot.engine': 'rigid'}) as fleet:
        other = make_controller('rstdp', {'c_r': 0.02})
        with pytest.raises(ParameterError, match='expected controllers with the same parameters'):
            fleet.host(0, other, other.reset)


def test_what_a_controller_shows_of_its_last_step_is_kept_and_recording_refused() -> None:
    """Operations and reward are those of the last answer; before the first one there are none."""
    with Fleet('rstdp', [3], simulator={'robot.engine': 'kinematic'}) as fleet:
        fleet.reset(0)
        assert fleet.controller(0).operations.decisions == 0
        assert np.isnan(fleet.controller(0).reward)
        fleet.drive(10)
        driven = fleet.controller(0)
        assert (driven.operations.decisions, driven.operations.synaptic > 0) == (1, True)
        assert fleet.controllers.operations(0).decisions == 10
        driven.record(['weights'])
        with pytest.raises(ParameterError, match='record: expected a controller that drives step'):
            fleet.drive(10)
