"""`make_vec`: many environments in one kernel return what single environments return."""

from pathlib import Path
from typing import Any

import gymnasium
from gymnasium.vector import AutoresetMode, SyncVectorEnv
import numpy as np
import pytest

from spikelane_sim.calibration import write_calibration
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.fleet.vector_env import LaneKeepingVectorEnv
from spikelane_sim.simulated_calibration import simulated_calibration
from spikelane_sim.simulator_parameters import SimulatorParameters

ID = 'spikelane/LaneKeeping-v0'
RIGID = {'robot.engine': 'rigid', 'episode.max_distance_m': 0.08}

#: A threshold so low that a pixel has many events in a step, and noise.
ESIM = {
    **RIGID,
    'pixels.model': 'esim',
    'pixels.esim.threshold_on': 0.02,
    'pixels.esim.shot_rate_hz': 1.0,
    'pixels.esim.substeps': 2,
}


def same(one: Any, other: Any) -> bool:
    """Return whether two results are the same, with types and bits."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[name], other[name]) for name in one)
    if type(one) is tuple or (isinstance(one, np.ndarray) and one.dtype == object):
        return all(same(*pair) for pair in zip(one, other, strict=True))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    return type(one) is type(other) and one == other


@pytest.mark.parametrize(
    'arguments',
    [
        pytest.param({}, id='state image'),
        pytest.param(
            {'observation': 'spike_counts', 'scenario': 'random:4', 'threads': 2}, id='counts'
        ),
        pytest.param(
            {
                'observation': 'event_image',
                'task': {'steps_per_action': 3},
                'simulator': {**RIGID, 'episode.max_distance_m': 0.004},
            },
            id='event image',
        ),
        pytest.param(
            {
                'observation': 'sensors',
                'actions': 'wheels',
                'simulator': {**RIGID, 'pixels.coppelia.noise_rate_hz': 0.5},
            },
            id='sensors',
        ),
        pytest.param(
            {
                'observation': 'event_image',
                'simulator': {**RIGID, 'period_ms': 20, 'speed': 2.0},
            },
            id='steps of 20 ms',
        ),
        pytest.param(
            {'observation': 'sensors', 'simulator': {**RIGID, 'robot.engine': 'kinematic'}},
            id='kinematic',
        ),
        pytest.param(
            {
                'observation': 'sensors',
                'simulator': {**RIGID, 'robot.engine': 'pybullet'},
                'threads': 2,
            },
            id='pybullet',
        ),
        pytest.param(
            {
                'observation': 'event_image',
                'simulator': {**ESIM, 'robot.engine': 'kinematic'},
                'threads': 2,
            },
            id='esim',
        ),
        pytest.param(
            {
                'observation': 'spike_counts',
                'simulator': {**ESIM, 'pixels.esim.latency_s': 0.07},
                'filters': {'chain': 'refractory,nearest_neighbour'},
            },
            id='esim with latency and filters',
        ),
        pytest.param(
            {
                'observation': 'sensors',
                'simulator': {**RIGID, 'pixels.coppelia.noise_rate_hz': 0.5},
                'filters': {'chain': 'correlation', 'correlation.window_s': 0.1},
            },
            id='filter',
        ),
    ],
)
@pytest.mark.parametrize('mode', list(AutoresetMode))
def test_results_are_those_of_single_environments(
    arguments: dict[str, Any], mode: AutoresetMode
) -> None:
    """Observations, rewards, ends and infos, with all ways to reset what is over."""
    arguments = {'simulator': RIGID, **arguments}
    arguments['task'] = {'max_actions': 9, **arguments.get('task', {})}
    vector = gymnasium.make_vec(
        ID,
        num_envs=5,
        vectorization_mode='vector_entry_point',
        autoreset_mode=mode,
        **arguments,
    )
    assert isinstance(vector.unwrapped, LaneKeepingVectorEnv)
    single = {name: value for name, value in arguments.items() if name != 'threads'}
    expected = SyncVectorEnv([lambda: gymnasium.make(ID, **single)] * 5, autoreset_mode=mode)
    assert vector.observation_space == expected.observation_space
    assert vector.action_space == expected.action_space
    assert same(vector.reset(seed=3), expected.reset(seed=3))
    vector.action_space.seed(1)
    ends = np.zeros(2, np.int64)
    for _ in range(25):
        actions = vector.action_space.sample()
        # The first one loses the lane, the second one drives straight on to the end.
        actions[:2] = [0, 1] if actions.ndim == 1 else [[0.5, 2.0], [1.0, 1.0]]
        one, other = vector.step(actions), expected.step(actions)
        assert same(one, other)
        ends += [one[2].sum(), one[3].sum()]
        is_over = one[2] | one[3]
        if mode == AutoresetMode.DISABLED and is_over.any():
            results = [
                each.reset(options={'lane': 'inner', 'reset_mask': is_over.copy()})
                for each in (vector, expected)
            ]
            assert same(*results)
    assert ends.min() > 0
    vector.close()
    expected.close()


def test_what_the_kernel_lacks_is_stepped_one_by_one_and_said(tmp_path: Path) -> None:
    """The results stay what they are, with a warning."""
    with pytest.warns(UserWarning, match='render_mode: expected None, got rgb_array'):
        vector = gymnasium.make_vec(ID, num_envs=2, render_mode='rgb_array')
    assert isinstance(vector, SyncVectorEnv)
    vector.close()
    write_calibration(tmp_path / 'camera.yaml', simulated_calibration(SimulatorParameters()))
    view = {'chain': 'ground_view', 'ground_view.file': str(tmp_path / 'camera.yaml')}
    with pytest.warns(UserWarning, match='single environments'):
        gymnasium.make_vec(ID, num_envs=2, simulator=RIGID, filters=view).close()


def test_wrong_calls_are_refused() -> None:
    """One clear error each."""
    vector = gymnasium.make_vec(ID, num_envs=2, simulator=RIGID, autoreset_mode='Disabled')
    with pytest.raises(SpikelaneError, match='seed: expected 2 seeds, got 3'):
        vector.reset(seed=[1, 2, 3])
    with pytest.raises(SpikelaneError, match='options: expected lane alone'):
        vector.reset(options={'road': 'x'})
    with pytest.raises(SpikelaneError, match='reset_mask: expected 2 values'):
        vector.reset(options={'reset_mask': np.array([False, False])})
    with pytest.raises(SpikelaneError, match='reset_mask: expected an array of bool'):
        vector.reset(options={'reset_mask': [True, False]})
    vector.reset(seed=0)
    for actions in ([0, 3], [0], [0.5, 1.0]):
        with pytest.raises(SpikelaneError, match='actions: expected one of MultiDiscrete'):
            vector.step(np.array(actions))
    while not any((result := vector.step(np.array([0, 1])))[2]):
        pass
    assert result[2].tolist() == [True, False]
    with pytest.raises(SpikelaneError, match='expected environments whose episodes are not over'):
        vector.step(np.array([0, 1]))
    vector.close()
    with pytest.raises(SpikelaneError, match='expected no call after close, got reset'):
        vector.reset()
    with pytest.raises(SpikelaneError, match=r"observation: expected state_image or .*, got 'x'"):
        gymnasium.make_vec(ID, num_envs=2, observation='x')
