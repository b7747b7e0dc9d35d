"""Node `dqn`: drives with a learnt network, or learns it, as the controller does in-process."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from spikelane_msgs.msg import ControllerState
from spikelane_msgs.srv import Reset

from spikelane.loop import drive_episode
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import train
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.dqn.training import DqnTrainingParameters
from spikelane_controllers.dqn.visited_states import read_states
from spikelane_controllers.registry import make_controller
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

pytestmark = pytest.mark.ros

SEED = 3
COURSE = {'robot.model': 'kinematic', 'episode.max_steps': 130, 'episode.max_laps': 0}
NARROW = {**COURSE, 'episode.max_distance_m': 0.05}
#: A small network that learns from the beginning.
SMALL = {
    'network.hidden_1': 8,
    'network.hidden_2': 6,
    'q_learning.random_steps': 10,
    'q_learning.update_every': 2,
    'q_learning.buffer_size': 40,
}
STEPS, SAVE_EVERY = 45, 10


def heard(graph: Any, kind: type, topic: str) -> list[Any]:
    """Return the list that the messages of a topic are added to."""
    messages: list[Any] = []
    graph.node.create_subscription(kind, topic, messages.append, 1000)
    return messages


@pytest.fixture(scope='module')
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the folder of a training in-process."""
    folder = tmp_path_factory.mktemp('inprocess')
    parameters = {f'simulator.{name}': value for name, value in NARROW.items()}
    parameters |= {f'dqn.{name}': value for name, value in SMALL.items()}
    config = TrainConfig.make(Request('1', 'dqn', SEED, 'inprocess', parameters))
    length = DqnTrainingParameters(steps=STEPS, save_every=SAVE_EVERY)
    config = replace(config, training=length)
    train(config, RunFolder(folder), lambda steps, progress_m: None, resume=False)
    return folder


def test_it_drives_with_a_trained_network(graph, trained: Path) -> None:
    """Its actions and rewards are those in-process."""
    remapped = ('-r', '__ns:=/drive')
    parameters = {**SMALL, 'checkpoint': str(trained)}
    states = heard(graph, ControllerState, '/drive/controller/state')
    graph.start('simulator', {**COURSE, 'autostart': False}, *remapped)
    node = graph.start('dqn', {**parameters, 'seed': SEED}, *remapped)
    graph.until(lambda: graph.node.count_publishers('/drive/wheel_velocities'))
    assert graph.call(Reset, '/drive/simulator/reset', seed=SEED).success
    controller = make_controller('dqn', parameters)
    expected = []

    def on_step(observation: Observation, wheels: WheelVelocities) -> None:
        expected.append((observation.lane.step, controller.action, controller.reward))

    with Simulator(SimulatorParameters.from_mapping(COURSE)) as simulator:
        drive_episode(simulator, controller, on_step, seed=SEED, controller_seed=SEED)
    graph.until(lambda: states and states[-1].step == expected[-1][0])
    got = [(each.step, each.action, each.reward) for each in states if each.step >= 10]
    assert got == [each for each in expected if each[0] >= 10][-len(got) :]
    assert len(got) > 30
    assert not any(each.learning for each in states)
    assert node.stop() == 0


def test_it_trains_as_in_process(graph, trained: Path, tmp_path: Path) -> None:
    """The same checkpoint and states; the node ends by itself."""
    remapped = ('-r', '__ns:=/train')
    simulator = graph.start('simulator', {**NARROW, 'lane': 'inner', 'seed': 9}, *remapped)
    parameters = {
        **SMALL,
        'learning': True,
        'seed': SEED,
        'output': tmp_path,
        'steps': STEPS,
        'save_every': SAVE_EVERY,
    }
    node = graph.start('dqn', parameters, *remapped)
    graph.until(lambda: node.status is not None, 'its end')
    ready = 'ready: answers /train/event_camera/events on /train/wheel_velocities'
    assert node.status == 0
    [line] = node.log.splitlines()
    assert line.startswith('[INFO]')
    assert line.endswith(ready)
    got, expected = (read_checkpoint(path, 'dqn') for path in (tmp_path, trained))
    for name, value in expected.arrays.items():
        assert got.arrays[name].tobytes() == value.tobytes(), name
    assert got.facts['terminations'] == expected.facts['terminations']
    assert len(got.facts['terminations']) > 1
    assert np.array_equal(read_states(tmp_path), read_states(trained))
    assert (tmp_path / 'tensorboard').is_dir()
    assert simulator.stop() == 0
