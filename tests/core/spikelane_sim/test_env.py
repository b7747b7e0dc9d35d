"""The Gymnasium environment."""

from __future__ import annotations

from collections.abc import Iterator
import copy
import os
import pickle
import subprocess
import sys
from typing import Any
import warnings

import gymnasium
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
import numpy as np
import pytest

from spikelane_sim.contract import WheelVelocities
from spikelane_sim.encoding import count_events, EncodingParameters
from spikelane_sim.env import LaneKeepingEnv
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

KINEMATIC = {'robot.model': 'kinematic'}
LEFT, STRAIGHT, RIGHT = 0, 1, 2


def make_env(**arguments: Any) -> LaneKeepingEnv:
    """Make an environment with the kinematic robot."""
    simulator = KINEMATIC | arguments.pop('simulator', {})
    return LaneKeepingEnv(simulator=simulator, **arguments)


@pytest.fixture
def env() -> Iterator[LaneKeepingEnv]:
    """Give the environment as it is by default, but kinematic."""
    made = make_env()
    yield made
    made.close()


@pytest.mark.parametrize('observation', ['state_image', 'spike_counts', 'event_image', 'sensors'])
@pytest.mark.parametrize('actions', ['discrete', 'wheels'])
def test_gymnasium_finds_no_fault(observation: str, actions: str) -> None:
    """Its own checks, warnings being errors; the wheels' limit is the robot's, not one."""
    made = gymnasium.make(
        'spikelane/LaneKeeping-v0',
        observation=observation,
        actions=actions,
        simulator=KINEMATIC,
        render_mode='rgb_array',
        disable_env_checker=True,
    )
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        warnings.filterwarnings('ignore', message='.*symmetric and normalized.*')
        check_env(made.unwrapped)
    made.close()


@pytest.mark.parametrize('observation', ['state_image', 'spike_counts'])
def test_stable_baselines_finds_no_fault(observation: str) -> None:
    """Its advice to flatten is ignored: these are small images without channels, not vectors."""
    stable_baselines = pytest.importorskip('stable_baselines3.common.env_checker')
    made = make_env(observation=observation, render_mode='rgb_array')
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        warnings.filterwarnings('ignore', message='.*unconventional shape.*')
        stable_baselines.check_env(made)
    made.close()


@pytest.mark.parametrize('observation', ['event_image', 'sensors', 'flat'])
def test_stable_baselines_has_no_advice(observation: str) -> None:
    """An image, a dictionary, and a vector are what it expects: not one warning."""
    stable_baselines = pytest.importorskip('stable_baselines3.common.env_checker')
    if observation == 'flat':
        made: gymnasium.Env[Any, Any] = gymnasium.wrappers.FlattenObservation(make_env())
    else:
        made = make_env(observation=observation)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        stable_baselines.check_env(made)
    made.close()


def test_the_event_image_counts_each_pixel_of_the_last_steps() -> None:
    """As many events as the cells count, where they are not cropped; ON and OFF apart."""
    image = make_env(observation='event_image', render_mode='rgb_array')
    cells = make_env(observation='state_image')
    image.reset(seed=3)
    cells.reset(seed=3)
    for action in (LEFT, STRAIGHT, RIGHT, RIGHT):
        seen, *_ = image.step(action)
        binary, *_ = cells.step(action)
        # Rows 40 to 103 in cells of 4 x 4 pixels.
        rows = seen.sum(axis=0)[40:104].reshape(16, 4, 32, 4).sum(axis=(1, 3))
        np.testing.assert_array_equal(rows > 0, binary > 0)
        last = image.render()  # of the last step alone: red and blue
        assert (seen[0][last[:, :, 2] == 255] > 0).all()
        assert (seen[1][last[:, :, 0] == 255] > 0).all()
    assert seen.max() == 1  # each edge has passed a pixel once
    several = make_env(observation='event_image', simulator={'pixels.model': 'esim'})
    several.reset(seed=3)
    assert several.step(LEFT)[0].max() > 1


def test_the_wheels_are_what_the_encoders_measure() -> None:
    """The kinematic robot's wheels do what they are told; at rest after a reset."""
    made = make_env(observation='sensors', actions='wheels')
    first, _ = made.reset(seed=0)
    np.testing.assert_array_equal(first['wheels'], [0, 0])
    assert not first['events'].any()
    seen, *_ = made.step(np.array([1.5, 2.0], np.float32))
    np.testing.assert_allclose(seen['wheels'], [1.5, 2.0])
    assert made.observation_space.contains(seen)


@pytest.mark.parametrize('observation', ['state_image', 'sensors'])
def test_environments_in_a_vector_are_as_each_alone(observation: str) -> None:
    """`make_vec` with other seeds; an episode that is over begins anew by itself."""
    arguments: dict[str, Any] = {
        'observation': observation,
        'simulator': KINEMATIC,
        'task': {'max_actions': 3},
    }
    vector = gymnasium.make_vec('spikelane/LaneKeeping-v0', num_envs=2, **arguments)
    alone = [LaneKeepingEnv(**arguments) for _ in range(2)]
    seen, _ = vector.reset(seed=[5, 6])
    for env, seed in zip(alone, (5, 6), strict=True):
        env.reset(seed=seed)
    for _ in range(3):
        seen, rewards, _, truncated, infos = vector.step(np.array([LEFT, RIGHT]))
        for index, action in enumerate((LEFT, RIGHT)):
            expected, reward, _, is_truncated, info = alone[index].step(action)
            got = (
                {key: value[index] for key, value in seen.items()}
                if observation == 'sensors'
                else seen[index]
            )
            np.testing.assert_equal(got, expected)
            assert rewards[index] == reward
            assert truncated[index] == is_truncated
            assert infos['is_success'][index] == info['is_success']
    assert truncated.all()
    seen, _, _, truncated, _ = vector.step(np.array([LEFT, RIGHT]))
    assert not truncated.any()
    assert not np.any(seen['events'] if observation == 'sensors' else seen)
    vector.close()


def test_it_is_made_by_name() -> None:
    """For each of the paper's scenarios."""
    made = gymnasium.make('spikelane/LaneKeeping-v0', scenario=2, simulator=KINEMATIC)
    assert isinstance(made.unwrapped, LaneKeepingEnv)
    image, info = made.reset(seed=1)
    assert image.shape == (16, 32)
    assert info['lane_state'].lane == 'outer'
    made.close()


def test_it_is_found_by_the_name_of_its_module() -> None:
    """Where nobody has imported it."""
    code = (
        'import gymnasium\n'
        "name = 'spikelane_sim:spikelane/LaneKeeping-v0'\n"
        "made = gymnasium.make(name, scenario=3, simulator={'robot.model': 'kinematic'})\n"
        'print(made.spec.id)'
    )
    ended = subprocess.run(
        [sys.executable, '-c', code],
        env=os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    assert ended.stdout == 'spikelane/LaneKeeping-v0\n'


def test_the_spaces_are_those_of_the_controllers() -> None:
    """The image of the deep network, the counts of the spiking ones."""
    image, counts = make_env(), make_env(observation='spike_counts', actions='wheels')
    assert image.observation_space == spaces.Box(0, 1, (16, 32), np.uint8)
    assert counts.observation_space == spaces.Box(0, 256, (4, 8), np.int64)
    assert image.action_space == spaces.Discrete(3)
    assert counts.action_space == spaces.Box(-12.3, 12.3, (2,), np.float32)


def test_the_reward_at_the_centre_is_2_6596(env: LaneKeepingEnv) -> None:
    """1 / (0.15 sqrt(2 pi)); at one sigma exp(-1/2) of it, the same on both sides."""
    assert env.lane_centre_reward(0.0) == pytest.approx(2.6596152, abs=1e-7)
    assert env.lane_centre_reward(0.15) == pytest.approx(1.6131382, abs=1e-7)
    assert env.lane_centre_reward(-0.15) == env.lane_centre_reward(0.15)


def test_the_reward_is_the_sum_of_its_named_terms(env: LaneKeepingEnv) -> None:
    """There is one, of the distance after the action."""
    env.reset(seed=0)
    _, reward, *_, info = env.step(STRAIGHT)
    assert info['reward_terms'] == {'lane_centre': reward}
    assert reward == pytest.approx(2.6596152, abs=1e-7)
    for _ in range(10):
        _, reward, *_, info = env.step(RIGHT)
    distance_m = info['lane_state'].distance_m
    assert distance_m > 0.01
    assert reward == pytest.approx(2.6596152 * np.exp(-(distance_m**2) / 0.045), abs=1e-7)


@pytest.mark.parametrize(
    ('action', 'wheels'),
    [(LEFT, (0.75, 1.25)), (STRAIGHT, (1.0, 1.0)), (RIGHT, (1.25, 0.75))],
)
def test_an_action_holds_for_ten_steps(action: int, wheels: tuple[float, float]) -> None:
    """The same drive as that of the simulator alone, and the same events."""
    made = make_env(observation='spike_counts')
    made.reset(seed=5)
    counts, _, _, _, info = made.step(action)
    with Simulator(SimulatorParameters.from_mapping(KINEMATIC)) as simulator:
        simulator.reset(seed=5)
        for _ in range(10):
            observation = simulator.step(WheelVelocities(*wheels))
    assert info['lane_state'] == observation.lane
    assert np.array_equal(counts, count_events(observation.events, EncodingParameters()))
    assert counts.sum() > 0


def test_wheels_are_driven_as_told() -> None:
    """In any number type; what is beyond the limit is no action."""
    made = make_env(actions='wheels', task={'steps_per_action': 1})
    made.reset(seed=0)
    for action in (np.array([2.0, 2.0], np.float32), np.array([2.0, 2.0]), [2, 2]):
        *_, info = made.step(action)
    assert info['lane_state'].progress_m == pytest.approx(3 * 2 * 0.004875, abs=1e-12)
    for wrong in ([13.0, 0.0], [np.nan, 0.0], [1.0], 1.0):
        with pytest.raises(SpikelaneError, match='action: expected one of Box'):
            made.step(wrong)


@pytest.mark.parametrize('action', [3, -1, 1.0, 'left', None])
def test_what_is_no_action_is_refused(env: LaneKeepingEnv, action: object) -> None:
    """And drives nothing."""
    env.reset(seed=0)
    with pytest.raises(SpikelaneError, match='action: expected one of Discrete'):
        env.step(action)
    assert env.step(STRAIGHT)[4]['lane_state'].step == 10


def test_the_first_observation_is_all_zeros(env: LaneKeepingEnv) -> None:
    """Also after a drive: nothing of the last episode is left."""
    for _ in range(2):
        image, _ = env.reset(seed=3)
        assert (image.shape, image.dtype, image.any()) == ((16, 32), np.uint8, np.False_)
        image, *_ = env.step(STRAIGHT)
        assert set(np.unique(image)) == {0, 1}


def test_an_episode_is_truncated_after_its_last_action() -> None:
    """Which is no failure."""
    made = make_env(task={'max_actions': 3, 'steps_per_action': 1})
    made.reset(seed=0)
    ends = [made.step(STRAIGHT)[2:] for _ in range(3)]
    assert [end[:2] for end in ends] == [(False, False), (False, False), (False, True)]
    assert ends[-1][2]['is_success']
    made.reset()
    assert made.step(STRAIGHT)[3] is False


def test_an_episode_is_terminated_where_the_lane_is_lost(env: LaneKeepingEnv) -> None:
    """By driving straight on where the road turns, in the middle of an action even."""
    env.reset(seed=0)
    is_terminated = is_truncated = False
    actions = 0
    while not (is_terminated or is_truncated):
        _, reward, is_terminated, is_truncated, info = env.step(STRAIGHT)
        actions += 1
    lane = info['lane_state']
    assert (is_terminated, is_truncated, lane.reason) == (True, False, 'lane_lost')
    assert not info['is_success']
    assert abs(lane.distance_m) > 0.5
    # Out of the turn of 2.25 m by 0.5 m: sqrt(2.75^2 - 2.25^2) m after the straight's 4.5 m.
    assert lane.step == np.ceil((4.5 + np.sqrt(2.75**2 - 2.25**2)) / 0.004875)
    assert actions == np.ceil(lane.step / 10)
    assert reward < 0.02
    with pytest.raises(SpikelaneError, match='no episode is running'):
        env.step(STRAIGHT)


def test_a_limit_of_the_simulator_truncates_with_success() -> None:
    """Steps or laps that were asked for are no failure."""
    made = make_env(simulator={'episode.max_steps': 15})
    made.reset(seed=0)
    assert made.step(STRAIGHT)[2:4] == (False, False)
    *_, is_terminated, is_truncated, info = made.step(STRAIGHT)
    assert (is_terminated, is_truncated, info['is_success']) == (False, True, True)
    assert info['lane_state'].step == 15


def test_lanes_take_turns_unless_one_is_named(env: LaneKeepingEnv) -> None:
    """A seed begins with the course's first."""
    named = {'options': {'lane': 'outer'}}
    resets: list[dict[str, Any]] = [{'seed': 1}, {}, {}, {'seed': 1}, named]
    lanes = [env.reset(**reset)[1]['lane_state'].lane for reset in resets]
    assert lanes == ['outer', 'inner', 'outer', 'outer', 'outer']


def test_an_unknown_lane_is_refused(env: LaneKeepingEnv) -> None:
    """With those that there are."""
    with pytest.raises(SpikelaneError, match="lane: expected outer or inner, got 'middle'"):
        env.reset(options={'lane': 'middle'})


def test_a_seed_determines_all_episodes_that_follow() -> None:
    """In the same environment and in another one, pixels being noisy."""
    noisy = {'pixels.model': 'esim', 'pixels.esim.shot_rate_hz': 20.0}

    def play(made: LaneKeepingEnv, seed: int) -> list[Any]:
        seen: list[Any] = []
        for begin in (seed, None):
            seen.append(made.reset(seed=begin)[0].tolist())
            for action in (STRAIGHT, LEFT, RIGHT):
                image, *rest = made.step(action)
                seen += [image.tolist(), *rest]
        return seen

    one, other = (make_env(observation='spike_counts', simulator=noisy) for _ in range(2))
    first = play(one, 21)
    assert play(one, 21) == first
    assert play(other, 21) == first
    assert play(other, 22) != first


def test_the_picture_shows_the_last_events() -> None:
    """ON blue, OFF red, black elsewhere."""
    made = make_env(render_mode='rgb_array', observation='spike_counts')
    assert not made.render().any()
    made.reset(seed=0)
    colours = set()
    for _ in range(10):
        counts, *_ = made.step(RIGHT)
        image = made.render()
        assert (image.shape, image.dtype) == ((128, 128, 3), np.uint8)
        # The counts leave 40 rows out at the top and 24 at the bottom.
        assert np.count_nonzero(image[40:104].any(axis=2)) == counts.sum()
        colours |= {tuple(colour) for colour in image.reshape(-1, 3).tolist()}
    assert colours == {(0, 0, 0), (0, 64, 255), (255, 64, 0)}


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (
            {'observation': 'pixels'},
            "observation: expected state_image or spike_counts or .* got 'pix",
        ),
        ({'actions': 'speed'}, "actions: expected discrete or wheels, got 'speed'"),
        ({'render_mode': 'human'}, "render_mode: expected rgb_array, got 'human'"),
        ({'scenario': 4}, "course: expected scenario_1, .* got 'scenario_4'"),
        (
            {'task': {'max_action': 3}},
            "task: unknown parameter 'max_action'; expected drive_rad_s",
        ),
        ({'task': {'max_actions': 0}}, 'task: max_actions: expected a whole number from 1'),
        ({'simulator': {'pace': 3}}, "simulator: unknown parameter 'pace'"),
    ],
)
def test_wrong_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    """With what is allowed."""
    with pytest.raises(SpikelaneError, match=message):
        make_env(**arguments)


def test_a_sensor_that_the_cells_do_not_fill_is_refused() -> None:
    """Rather than leaving its edge out."""
    with pytest.raises(ParameterError, match='cell: expected cells that fill'):
        make_env(simulator={'camera.width': 130})


@pytest.mark.parametrize('robot', ['pybullet', 'rigid', 'kinematic'])
@pytest.mark.parametrize(
    'more',
    [
        {'pixels.coppelia.noise_rate_hz': 1.0, 'link.latency_ms': 100, 'link.event_loss': 0.1},
        {'pixels.model': 'esim', 'pixels.esim.shot_rate_hz': 5.0, 'pixels.esim.latency_s': 0.06},
    ],
)
def test_a_copy_has_the_same_future_bit_for_bit(robot: str, more: dict[str, Any]) -> None:
    """Copied and pickled in the middle of an episode, with noise, losses and latencies."""
    env = LaneKeepingEnv(actions='wheels', simulator={'robot.model': robot} | more)
    drawn = np.random.default_rng(5)
    wheels = drawn.uniform(0.5, 2.0, (12, 2)).astype(np.float32)
    env.reset(seed=3)
    for each in wheels[:4]:
        env.step(each)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]  # noqa: S301
    futures = [_future(each, wheels[4:]) for each in (env, *copies)]
    assert futures[0] == futures[1] == futures[2]
    for each in (env, *copies):
        each.close()


def _future(env: LaneKeepingEnv, wheels: np.ndarray) -> list[bytes]:
    """Return all bits of the next steps, and of an episode after them."""
    found = []
    for each in wheels:
        observation, reward, lost, _, info = env.step(each)
        found.append(pickle.dumps((observation.tobytes(), reward, lost, info)))
        found.append(env.render().tobytes())
        if lost:
            break
    observation, info = env.reset()
    found.append(pickle.dumps((observation.tobytes(), info, env.np_random.random())))
    found.append(pickle.dumps(env.step(wheels[0])[4]))
    return found


def test_a_copy_does_not_disturb_what_it_was_made_from() -> None:
    """Each has a physics engine of its own."""
    env = LaneKeepingEnv()
    env.reset(seed=1)
    env.step(1)
    other = copy.deepcopy(env)
    other.step(0)
    other.close()
    again = LaneKeepingEnv()
    again.reset(seed=1)
    again.step(1)
    assert env.step(2)[4]['lane_state'] == again.step(2)[4]['lane_state']
    env.close()
    again.close()


@pytest.mark.parametrize('robot', ['pybullet', 'rigid', 'kinematic'])
def test_a_closed_environment_says_so(robot: str) -> None:
    """A step, a reset, also of a copy; closing twice is fine."""
    env = LaneKeepingEnv(simulator={'robot.model': robot})
    env.reset(seed=1)
    env.close()
    env.close()
    for each in (env, copy.deepcopy(env)):
        with pytest.raises(SpikelaneError, match='expected no call after close, got step'):
            each.step(1)
        with pytest.raises(SpikelaneError, match='expected no call after close, got reset'):
            each.reset(seed=1)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'lanes': 'inner'}, "options: expected lane alone, got 'lanes'"),
        ({'lane': 3}, "options: lane: expected a lane's name, got 3"),
        ({'lane': 'middle'}, "lane: expected outer or inner, got 'middle'"),
    ],
)
def test_options_that_there_are_not_are_refused(options: dict[str, Any], message: str) -> None:
    """In one line."""
    env = LaneKeepingEnv(simulator={'robot.model': 'kinematic'})
    with pytest.raises(SpikelaneError, match=message):
        env.reset(seed=1, options=options)


def test_events_are_filtered_before_they_are_observed() -> None:
    """Noise alone, of a robot that stands still: without the filter it is seen, with it not."""
    noise = {'pixels.coppelia.noise_rate_hz': 0.1}
    counts = []
    for filters in ({}, {'chain': 'correlation', 'correlation.supporters': 3}):
        made = make_env(
            observation='spike_counts', actions='wheels', simulator=noise, filters=filters
        )
        made.reset(seed=1)
        seen = [made.step(np.zeros(2, np.float32))[0].sum() for _ in range(10)]
        counts.append(sum(seen))
        made.close()
    assert counts[0] > 20
    assert counts[1] == 0
    with pytest.raises(ParameterError, match=r"filters: filter.chain: .* got 'none'"):
        make_env(filters={'chain': 'none'})
