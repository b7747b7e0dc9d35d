"""Node `rstdp`: drives with learnt weights, or trains, as the controller does in-process."""

from collections.abc import Iterator
from pathlib import Path
import signal
from typing import Any

from event_camera_msgs.msg import EventPacket
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from spikelane_msgs.msg import ControllerState, LaneState, Weights
from spikelane_msgs.srv import Reset

from spikelane.loop import drive_episode
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import train
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.registry import make_controller
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.nodes.meeting import LATCHED
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

pytestmark = pytest.mark.ros

SEED = 3
COURSE = {'robot.model': 'kinematic', 'episode.max_steps': 130}
#: Uneven weights that lead off the lane soon.
SWERVING = {'initial_weights.low_pa': 100.0, 'initial_weights.high_pa': 500.0}
NARROW = {**COURSE, 'episode.max_distance_m': 0.005}


def trained_arrays(folder: Path, steps: int) -> dict[str, np.ndarray]:
    """Return what the same training in-process leaves."""
    parameters = {f'simulator.{name}': value for name, value in NARROW.items()}
    parameters |= {f'rstdp.{name}': value for name, value in SWERVING.items()}
    config = TrainConfig.make(Request('1', 'rstdp', SEED, 'inprocess', parameters), steps)
    train(config, RunFolder(folder), lambda steps, progress_m: None, resume=False)
    return read_checkpoint(folder, 'rstdp').arrays


def heard(graph: Any, kind: type, topic: str, qos: Any = 1000) -> list[Any]:
    """Return the list that the messages of a topic are added to."""
    messages: list[Any] = []
    graph.node.create_subscription(kind, topic, messages.append, qos)
    return messages


def test_it_drives_with_the_shipped_weights(graph) -> None:
    """At its defaults; spikes and rewards are those in-process, the weights are published once."""
    remapped = ('-r', '__ns:=/drive')
    weights = heard(graph, Weights, '/drive/controller/weights', LATCHED)
    states = heard(graph, ControllerState, '/drive/controller/state')
    graph.start('simulator', {**COURSE, 'autostart': False}, *remapped)
    node = graph.start('rstdp', {'seed': SEED}, *remapped)
    graph.until(lambda: weights)
    graph.until(lambda: graph.node.count_publishers('/drive/wheel_velocities'))
    assert graph.call(Reset, '/drive/simulator/reset', seed=SEED).success
    controller = make_controller('rstdp')
    expected = []

    def on_step(observation: Observation, wheels: WheelVelocities) -> None:
        expected.append((observation.lane.step, list(controller.spikes), controller.reward))

    with Simulator(SimulatorParameters.from_mapping(COURSE)) as simulator:
        drive_episode(simulator, controller, on_step, seed=SEED, controller_seed=SEED)
    graph.until(lambda: states and states[-1].step == expected[-1][0])
    got = [(each.step, list(each.spikes), each.reward) for each in states]
    assert got == expected[-len(got) :]
    assert len(got) > 100
    assert len({reward for *_, reward in got}) > 50
    assert not any(each.learning for each in states)
    (message,) = weights
    assert (message.name, list(message.shape), message.unit) == ('weights', [2, 32], 'pA')
    assert list(message.data) == controller.weights_pa.astype(np.float32).ravel().tolist()
    assert node.stop() == 0


@pytest.fixture(scope='module')
def simulator(graph) -> Iterator[list[Any]]:
    """Give the lane states of a simulator that began by itself, on another lane and seed."""
    lanes = heard(graph, LaneState, '/train/lane/state')
    # Who joins late is sent the first observation again on meeting the event packets' reader.
    heard(graph, EventPacket, '/train/event_camera/events')
    own = {**NARROW, 'lane': 'inner', 'seed': 9}
    process = graph.start('simulator', own, '-r', '__ns:=/train')
    graph.until(lambda: lanes)
    yield lanes
    # A training that was killed may seem to be there still, so that the drive is cut short.
    assert process.stop() in (0, 128 + signal.SIGINT)


def start_training(graph: Any, folder: Path, **others: Any) -> Any:
    """Start a node that trains."""
    parameters = {'learning': True, 'seed': SEED, 'output': folder, **SWERVING, **others}
    return graph.start('rstdp', parameters, '-r', '__ns:=/train')


def same(folder: Path, expected: dict[str, np.ndarray]) -> bool:
    """Return whether all arrays of a checkpoint are equal, to the last bit."""
    got = read_checkpoint(folder, 'rstdp').arrays
    return {name: value.tobytes() for name, value in got.items()} == {
        name: value.tobytes() for name, value in expected.items()
    }


def test_it_trains_as_in_process(graph, simulator: list[Any], tmp_path: Path) -> None:
    """What the simulator did before is of no matter; the node ends by itself."""
    # A reader that keeps one message only misses some on a busy machine.
    kept = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    weights = heard(graph, Weights, '/train/controller/weights', kept)
    node = start_training(graph, tmp_path / 'ros', steps=350)
    graph.until(lambda: node.status is not None, 'its end')
    [said] = node.log.splitlines()
    ready = 'ready: answers /train/event_camera/events on /train/wheel_velocities'
    assert (node.status, said.rpartition(']: ')[2]) == (0, ready)
    assert same(tmp_path / 'ros', trained_arrays(tmp_path / 'inprocess', 350))
    facts = read_checkpoint(tmp_path / 'ros', 'rstdp').facts
    assert len(facts['terminations']) > 2
    assert len({tuple(each.data) for each in weights}) >= 3


def test_interrupted_it_goes_on_where_it_was(graph, simulator: list[Any], tmp_path: Path) -> None:
    """By SIGINT and SIGKILL; the lanes and episodes go on as well."""
    folder = tmp_path / 'ros'
    kept = 0
    for number, status in ((signal.SIGINT, 130), (signal.SIGKILL, -9)):
        node = start_training(graph, folder, steps=10**6, resume=kept > 0)
        graph.until((folder / 'checkpoint.safetensors').exists)
        before = kept

        def has_gone_on(before: int = before) -> bool:
            return read_checkpoint(folder, 'rstdp').facts['steps'] >= before + 100

        graph.until(has_gone_on, 'a checkpoint')
        assert node.stop(number) == status
        assert 'Traceback' not in node.log
        kept = read_checkpoint(folder, 'rstdp').facts['steps']
    node = start_training(graph, folder, steps=kept + 150, resume=True)
    assert node.wait() == 0
    assert same(folder, trained_arrays(tmp_path / 'inprocess', kept + 150))


@pytest.mark.parametrize(
    ('parameters', 'message'),
    [
        ({'learning': True}, 'output: expected the folder of the training'),
        ({'learning': True, 'output': '/none', 'resume': True}, 'a checkpoint, got none'),
        ({'learning': True, 'output': '/none', 'use_lane_state': False}, 'use_lane_state: expect'),
        ({'checkpoint': 'scenario_9'}, 'checkpoint: expected one of scenario_1'),
    ],
)
def test_what_it_cannot_do_is_refused(graph, parameters: dict[str, Any], message: str) -> None:
    """With exit status 2 and one line."""
    node = graph.start('rstdp', parameters)
    assert node.wait() == 2
    assert message in node.log
    assert node.log.count('\n') == 1


def test_a_signal_ends_it_while_it_waits_for_a_simulator(graph, tmp_path: Path) -> None:
    """The beginning is saved; the exit status says that the work is not done."""
    node = graph.start('rstdp', {'learning': True, 'output': tmp_path}, '-r', '__ns:=/nobody')
    # The checkpoint is there before the node has been made.
    graph.until(lambda: 'waiting to reset the simulator' in node.log)
    assert (tmp_path / 'checkpoint.safetensors').exists()
    assert node.stop(signal.SIGTERM) == 143
    assert 'ended by SIGTERM after 0 of 30000 steps' in node.log
    assert 'Traceback' not in node.log
