"""The deep Q-network controller: when it acts, on what, and what it learns from."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from spikelane_controllers.checkpoint import write_checkpoint
from spikelane_controllers.dqn.controller import Dqn
from spikelane_controllers.dqn.parameters import DqnParameters
from spikelane_controllers.dqn.pytorch import MissingPyTorchError
from spikelane_controllers.dqn.q_network import greedy_action
from spikelane_sim.contract import LaneState, Observation, WheelVelocities
from spikelane_sim.env import LaneKeepingEnv
from spikelane_sim.errors import CheckpointError
from spikelane_sim.events import make_events
from spikelane_sim.period import PERIOD_NS
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

KINEMATIC = {'robot.model': 'kinematic', 'episode.max_laps': 0}


def dqn_of(**parameters: Any) -> Dqn:
    """Return a controller with small untrained networks."""
    values = {'checkpoint': '', 'network.hidden_1': 8, 'network.hidden_2': 6}
    return Dqn(DqnParameters.from_mapping(values | parameters))


def seen(step: int, *pixels: tuple[int, int], lane: LaneState | None = None) -> Observation:
    """Return an observation with events at pixels (x, y)."""
    x, y = zip(*pixels, strict=True) if pixels else ((), ())
    return Observation((step + 1) * PERIOD_NS, make_events(0, x, y, 1), lane)


def lane_at(step: int, distance_m: float = 0.0, reason: str = '') -> LaneState:
    """Return a lane state."""
    return LaneState('outer', distance_m, 0, 0, 'A', 0, 0, 1, step, bool(reason), reason)


def test_an_action_is_held_for_ten_steps() -> None:
    """Chosen on an empty state first, then on the ten steps since."""
    controller = dqn_of()
    controller.reset(np.random.default_rng(0))
    empty = greedy_action(controller.network, np.zeros(512, np.uint8))
    speeds = {
        0: WheelVelocities(0.75, 1.25),
        1: WheelVelocities(1.0, 1.0),
        2: WheelVelocities(1.25, 0.75),
    }
    controller.step(seen(0, (0, 40)))  # before anything was done: not in the state
    assert controller.action == empty
    for step in range(1, 10):
        assert controller.step(seen(step, (4 * step, 40), (4 * step, 40))) == speeds[empty]
        assert controller.actions == 0
    wheels = controller.step(seen(10, (127, 103)))
    assert controller.actions == 1
    expected = np.zeros((16, 32), int)
    expected[0, 1:10], expected[15, 31] = 2, 1
    assert controller.counts.tolist() == expected.tolist()
    state = (expected.ravel() > 0).astype(np.uint8)
    assert controller.action == greedy_action(controller.network, state)
    assert wheels == speeds[controller.action]
    assert math.isnan(controller.reward)


def test_an_action_lasts_half_a_second_with_every_period() -> None:
    """It is chosen on 0.5 s: 25 steps of 20 ms."""
    controller = dqn_of(period_ms=20)
    controller.reset(np.random.default_rng(0))
    for step in range(25):
        controller.step(seen(step, (4 * step, 40)))
        assert controller.actions == 0
    controller.step(seen(25, (4 * 25, 40)))
    assert controller.actions == 1
    assert controller.counts[0].tolist() == [0] + [1] * 25 + [0] * 6


@pytest.mark.parametrize(
    ('step_ms', 'period_ms', 'held', 'seen'), [(10, 10, 2, 8), (10, 5, 4, 16), (5, 20, 1, 2)]
)
def test_actions_and_images_can_be_shorter_than_50_ms(
    step_ms: int, period_ms: int, held: int, seen: int
) -> None:
    """Two steps for an action and eight for an image, rounded to the period: at least one."""
    controller = Dqn(
        DqnParameters.from_mapping(
            {
                'period_ms': period_ms,
                'task.steps_per_action': 2,
                'task.step_ms': step_ms,
                'image.frames': 8,
                'image.frame_ms': step_ms,
            }
        )
    )
    assert controller.steps_per_action == held
    assert len(controller.image.frames) == seen


def test_the_reward_is_the_papers() -> None:
    """2.66 at the centre, 1 / e of it at sqrt(2) times 0.15 m; NaN until an action has ended."""
    controller = dqn_of()
    controller.reset(np.random.default_rng(0))
    for step in range(11):
        assert math.isnan(controller.reward)
        controller.step(seen(step, lane=lane_at(step)))
    assert controller.reward == pytest.approx(2.6596, abs=1e-4)
    for step in range(11, 21):
        controller.step(seen(step, lane=lane_at(step, -0.15 * math.sqrt(2))))
    assert controller.reward == pytest.approx(2.6596 / math.e, abs=1e-4)


@pytest.mark.parametrize(('reason', 'is_final'), [('lane_lost', 1), ('step_limit', 0)])
def test_an_action_cut_short_counts(reason: str, is_final: int) -> None:
    """Losing the lane is final, a long episode's end is not."""
    controller = dqn_of(learning=True)
    controller.reset(np.random.default_rng(0))
    for step in range(3):
        controller.step(seen(step, lane=lane_at(step)))
    controller.step(seen(3, (0, 40), lane=lane_at(3, 0.51, reason)))
    state = controller.state()
    assert (controller.actions, state['steps']) == (1, 1)
    assert state['replay.is_final'][0] == is_final
    assert state['replay.states'][0].sum() == 0
    assert state['replay.next_states'][0].tolist() == [128] + [0] * 63
    assert state['replay.rewards'][0] == pytest.approx(0.008215, abs=1e-6)
    controller.reset(np.random.default_rng(1))
    controller.step(seen(4, lane=lane_at(0)))
    assert controller.actions == 1


def test_it_acts_as_in_the_environment() -> None:
    """The same states, rewards and ends as the Gymnasium environment gives for its actions."""
    limits = {**KINEMATIC, 'episode.max_distance_m': 0.2}
    controller = dqn_of(learning=True)
    controller.reset(np.random.default_rng(3))
    env = LaneKeepingEnv(1, simulator=limits)
    env.reset(seed=0)
    with Simulator(SimulatorParameters.from_mapping(limits)) as simulator:
        observation = simulator.reset(seed=0)
        action, actions = controller.action, 0
        while True:
            wheels = controller.step(observation)
            if controller.actions > actions:
                actions = controller.actions
                state, reward, is_lost, _, _ = env.step(action)
                assert np.array_equal(state, controller.counts > 0)
                assert reward == controller.reward
                assert is_lost == observation.lane.terminated
            if observation.lane.terminated:
                break
            action = controller.action
            observation = simulator.step(wheels)
    env.close()
    assert actions > 5


def drive(controller: Dqn, simulator: Simulator, observation: Observation, steps: int) -> Any:
    """Drive on; return what was answered and the last observation."""
    answers = []
    for _ in range(steps):
        wheels = controller.step(observation)
        answers.append((wheels, controller.action, controller.actions))
        observation = simulator.step(wheels)
    return answers, observation


@pytest.mark.parametrize('learning', [False, True])
def test_a_restored_controller_goes_on_bit_for_bit(learning: bool) -> None:
    """Within an action, with its random numbers."""
    values = {'learning': learning, 'q_learning.random_steps': 2, 'q_learning.update_every': 1}
    first, second = dqn_of(**values), dqn_of(**values)
    first.initialise(np.random.default_rng(5))
    first.reset(np.random.default_rng(5))
    limits = {**KINEMATIC, 'episode.max_distance_m': 0.0}
    with Simulator(SimulatorParameters.from_mapping(limits)) as simulator:
        _, observation = drive(first, simulator, simulator.reset(seed=0), 57)
        state = first.state()
        answers, _ = drive(first, simulator, observation, 60)
    second.restore(state)
    with Simulator(SimulatorParameters.from_mapping(limits)) as simulator:
        fresh = dqn_of(**values)
        fresh.initialise(np.random.default_rng(5))
        fresh.reset(np.random.default_rng(5))
        _, observation = drive(fresh, simulator, simulator.reset(seed=0), 57)
        assert drive(second, simulator, observation, 60)[0] == answers
    for name, value in first.state().items():
        assert np.array_equal(value, second.state()[name]), name


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'action': 3}, 'action: expected 0 to 2, got 3'),
        ({'learning': True}, 'learning: expected False, got True'),
        ({'other': 1}, 'other: expected one of'),
        ({'image.frames': np.zeros((9, 16, 32), np.int64)}, 'image.frames: expected shape'),
    ],
)
def test_the_state_of_another_controller_is_refused(changes: dict[str, Any], message: str) -> None:
    """The line says what differs."""
    controller = dqn_of()
    with pytest.raises(CheckpointError, match=message):
        controller.restore(controller.state() | changes)


def test_weights_that_cannot_be_used_are_refused(tmp_path: Path) -> None:
    """They have another size or NaN, belong to another controller, or are missing."""
    file = tmp_path / 'checkpoint.safetensors'
    arrays = {f'controller.network.{k}': v for k, v in dqn_of().network._asdict().items()}

    def message(controller: str = 'dqn', **parameters: Any) -> str:
        write_checkpoint(file, controller, arrays, {})
        with pytest.raises(CheckpointError) as caught:
            dqn_of(checkpoint=str(tmp_path), **parameters)
        return str(caught.value)

    assert 'weights_1: expected shape (512, 9), got shape (512, 8)' in message(
        **{'network.hidden_1': 9}
    )
    assert message('rstdp').endswith('expected controller dqn, got rstdp')
    arrays['controller.network.biases_2'][3] = np.nan
    assert message().endswith('biases_2: expected finite numbers, got NaN or infinity')
    del arrays['controller.network.biases_2']
    assert 'biases_2: expected in the state, but it is missing' in message()
    with pytest.raises(CheckpointError, match=r"checkpoint: expected one of .* got 'none'"):
        dqn_of(checkpoint='none')


def test_the_average_of_the_network_that_learnt_can_drive(tmp_path: Path) -> None:
    """It is the target network, if the checkpoint has it."""
    learnt, average = (dqn_of().network._asdict() for _ in range(2))
    average = {name: values + np.float32(1) for name, values in average.items()}
    file = tmp_path / 'checkpoint.safetensors'
    own = {f'controller.network.{name}': values for name, values in learnt.items()}
    targets = {f'controller.target.{name}': values for name, values in average.items()}
    write_checkpoint(file, 'dqn', own | targets, {})
    for averaged, expected in ((False, learnt), (True, average)):
        network = dqn_of(checkpoint=str(file), averaged=averaged).network._asdict()
        assert all(np.array_equal(network[name], expected[name]) for name in expected)
    write_checkpoint(file, 'dqn', own, {})
    with pytest.raises(CheckpointError, match=r'controller\.target\.weights_1: expected in the'):
        dqn_of(checkpoint=str(file), averaged=True)


def test_driving_does_not_wait_for_torch() -> None:
    """Only learning needs it."""
    code = (
        'import sys, spikelane_controllers.registry as r;'
        'r.make_controller("dqn", {"checkpoint": ""}); print("torch" in sys.modules)'
    )
    done = subprocess.run(
        [sys.executable, '-c', code],
        capture_output=True,
        text=True,
        check=True,
        env={'PYTHONPATH': ':'.join(sys.path)},
    )
    assert done.stdout.strip() == 'False'


def test_without_pytorch_it_learns_with_numba_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise the message says how to get it."""
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, 'find_spec', lambda name: None if name == 'torch' else found(name)
    )
    controller = dqn_of()
    controller.reset(np.random.default_rng(0))
    assert controller.step(seen(0, (64, 64))).left > 0
    dqn_of(learning=True).initialise(np.random.default_rng(0))
    with pytest.raises(
        MissingPyTorchError, match=r"pip install 'spikelane\[learn\]', or setup/bootstrap learn "
    ):
        dqn_of(learning=True, **{'q_learning.backend': 'torch'}).initialise(
            np.random.default_rng(0)
        )
