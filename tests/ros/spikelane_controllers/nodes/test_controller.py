"""A controller node: what it answers to observations, good and bad."""

from array import array
import math
from pathlib import Path
import signal
from typing import Any

from event_camera_msgs.msg import EventPacket
import pytest
from rcl_interfaces.srv import DescribeParameters
from spikelane_msgs.msg import ControllerState, LaneState, WheelVelocities
import yaml

from spikelane_controllers.braitenberg.controller import (
    Braitenberg,
    BraitenbergParameters,
)
from spikelane_controllers.nodes.controller_parameters import ControllerNodeParameters
from spikelane_sim import messages
from spikelane_sim.contract import controller_rng, Observation
from spikelane_sim.contract import WheelVelocities as Wheels
from spikelane_sim.events import no_events
from spikelane_sim.nodes import conversions
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

pytestmark = pytest.mark.ros

SEED = 5
STEP_NS = 50_000_000
FILE = Path(__file__).parents[4] / 'controllers' / 'config' / 'braitenberg.yaml'


class Camera:
    """Shows observations to a controller process in the place of a simulator."""

    def __init__(self, graph: Any, process: Any, has_lane: bool = True, at: str = '') -> None:
        self.graph = graph
        self.process = process
        self.answers: list[WheelVelocities] = []
        self._sequence = self._stamp_ns = 0
        node = graph.node
        self._lanes = node.create_publisher(LaneState, f'{at}/lane/state', 10)
        self._packets = node.create_publisher(EventPacket, f'{at}/event_camera/events', 10)
        node.create_subscription(
            WheelVelocities, f'{at}/wheel_velocities', self.answers.append, 10
        )
        graph.until(self._packets.get_subscription_count)
        graph.until(lambda: self._lanes.get_subscription_count() or not has_lane)
        graph.until(lambda: node.count_publishers(f'{at}/wheel_velocities'))

    def packet(self, observation: Observation, stamp_ns: int | None = None) -> EventPacket:
        """Return an observation as the next packet, at the next time if not at a given one.

        No two answers can be confused then: one is sent again whenever somebody joins.
        """
        self._sequence += 1
        if stamp_ns is None:
            self._stamp_ns += STEP_NS
            stamp_ns = self._stamp_ns
        events = observation.events.copy()
        events['t'] += stamp_ns - observation.stamp_ns
        message = EventPacket(width=128, height=128)
        conversions.fill_event_packet(message, events, stamp_ns, self._sequence, 'evt3')
        return message

    def show(self, packet: EventPacket, observation: Observation) -> Wheels:
        """Publish a packet and its lane state; return the answer."""
        seen = len(self.answers_to(packet))
        lane = LaneState()
        conversions.fill_lane_state(lane, observation.lane, 0)
        lane.header.stamp = packet.header.stamp
        self._lanes.publish(lane)
        self._packets.publish(packet)
        self.graph.until(lambda: len(self.answers_to(packet)) > seen, 'an answer')
        return messages.wheels_from_message(self.answers_to(packet)[-1])

    def answers_to(self, packet: EventPacket) -> list[WheelVelocities]:
        """Return the answers so far with a packet's stamp."""
        return [each for each in self.answers if each.header.stamp == packet.header.stamp]

    def show_all(self, observations: list[Observation]) -> list[Wheels]:
        """Show observations one after the other; return the answers."""
        return [self.show(self.packet(each), each) for each in observations]

    def lose(self, count: int) -> None:
        """Leave out packets."""
        self._sequence += count


@pytest.fixture(scope='module')
def observations() -> list[Observation]:
    """Give an episode that the Braitenberg controller has not driven, but could have seen."""
    parameters = SimulatorParameters.from_mapping({'robot.model': 'kinematic'})
    with Simulator(parameters) as simulator:
        seen = [simulator.reset('outer', 1)]
        return seen + [simulator.step(Wheels(3.0, 2.0 + n % 3)) for n in range(30)]


def in_process(
    observations: list[Observation], episode: int, seed: int = SEED
) -> tuple[list[Wheels], list[list[int]]]:
    """Return what the controller itself answers, and its spikes."""
    controller = Braitenberg(BraitenbergParameters())
    controller.reset(controller_rng(seed, episode))
    answers, spikes = [], []
    for observation in observations:
        answers.append(controller.step(observation))
        spikes.append([int(count) for count in controller.spikes])
    return answers, spikes


def renumbered(observations: list[Observation], episode: int) -> list[Observation]:
    """Return the observations as those of another episode."""
    return [each._replace(lane=each.lane._replace(episode=episode)) for each in observations]


@pytest.fixture(scope='module')
def camera(graph) -> Camera:
    """Give a camera before a Braitenberg controller that was started by its parameter file."""
    file = ('--params-file', str(FILE))
    process = graph.start('braitenberg', {'seed': SEED}, *file)
    return Camera(graph, process)


def test_it_answers_as_the_controller_does_in_process(
    camera: Camera, observations: list[Observation]
) -> None:
    """Bit for bit, each answer with its observation's stamp."""
    expected, _ = in_process(observations, 1)
    assert len({wheels.left for wheels in expected}) > 3
    assert camera.show_all(observations) == expected


def test_a_new_episode_begins_afresh(camera: Camera, observations: list[Observation]) -> None:
    """The same episode gives the same answers again; another one its own."""
    camera.show_all(observations[:7])
    assert camera.show_all(observations) == in_process(observations, 1)[0]
    second, _ = in_process(observations, 2)
    assert second != in_process(observations, 1)[0]
    assert camera.show_all(renumbered(observations, 2)) == second


def test_an_observation_that_comes_again_is_not_a_step(
    camera: Camera, observations: list[Observation]
) -> None:
    """It gets the same answer, and the next ones are not changed by it."""
    expected, _ = in_process(observations, 1)
    for observation, wheels in zip(observations, expected, strict=True):
        packet = camera.packet(observation)
        assert camera.show(packet, observation) == wheels
        assert camera.show(packet, observation) == wheels


def test_another_observation_with_the_same_stamp_is_a_step(
    camera: Camera, observations: list[Observation]
) -> None:
    """As after a reset of time, told by the packet's number."""
    first = camera.packet(observations[0])
    camera.show(first, observations[0])
    following = renumbered(observations, 2)
    again = camera.packet(following[0], messages.to_stamp_ns(first.header.stamp))
    camera.show(again, following[0])
    # The controller has begun the second episode.
    assert camera.show_all(following[1:]) == in_process(following, 2)[0][1:]


def spoil(packet: EventPacket, how: str) -> None:
    """Make a packet malformed."""
    if how == 'odd length':
        packet.events = array('B', bytes(packet.events) + b'\0')
    elif how == 'unknown encoding':
        packet.encoding = 'evt9'
    elif how == 'no size':
        packet.width = packet.height = 0
    else:
        packet.is_bigendian = True


@pytest.mark.parametrize(
    ('how', 'said'),
    [
        ('odd length', 'bytes'),
        ('unknown encoding', 'evt9'),
        ('no size', '0 x 0'),
        ('big-endian', 'little-endian'),
    ],
)
def test_a_malformed_packet_is_reported_and_taken_as_empty(
    camera: Camera, observations: list[Observation], how: str, said: str
) -> None:
    """It is answered all the same, and what follows as well."""
    empty = observations[10]._replace(events=no_events())
    expected, _ = in_process([*observations[:10], empty, *observations[11:]], 1)
    before = len(camera.process.log)

    def drive() -> bool:
        """Drive the episode again: the log takes an error a second."""
        packets = [camera.packet(each) for each in observations]
        spoil(packets[10], how)
        pairs = zip(packets, observations, strict=True)
        assert [camera.show(*pair) for pair in pairs] == expected
        return 'taken as empty' in camera.process.log[before:]

    camera.graph.until(drive, 'the error')
    line = next(line for line in camera.process.log[before:].splitlines() if 'as empty' in line)
    assert 'event_camera/events: ' in line
    assert said in line


def test_lost_packets_are_reported(camera: Camera, observations: list[Observation]) -> None:
    """With their number; what arrives is answered."""
    camera.show_all(observations[:1])
    camera.lose(3)
    camera.show_all(observations[1:2])
    expected = 'event_camera/events: 3 packets were lost'
    camera.graph.until(lambda: expected in camera.process.log, 'the warning')
    assert 'ERROR' not in camera.process.log.splitlines()[-1]


def test_who_joins_late_is_given_the_last_answer(
    camera: Camera, observations: list[Observation]
) -> None:
    """A simulator that starts after the controller waits for nothing."""
    packet = camera.packet(observations[10])
    answer = camera.show(packet, observations[10])
    late: list[WheelVelocities] = []
    camera.graph.node.create_subscription(WheelVelocities, 'wheel_velocities', late.append, 10)
    camera.graph.until(lambda: late)
    assert messages.wheels_from_message(late[0]) == answer
    assert late[0].header.stamp == packet.header.stamp


def test_a_late_subscriber_to_its_state_is_given_the_last_one(
    camera: Camera, observations: list[Observation]
) -> None:
    """The answer, which nobody has missed, is not sent again."""
    packet = camera.packet(observations[10])
    camera.show(packet, observations[10])
    late: list[ControllerState] = []
    node = camera.graph.node
    subscription = node.create_subscription(ControllerState, 'controller/state', late.append, 10)
    camera.graph.until(lambda: late)
    node.destroy_subscription(subscription)
    assert late[0].header.stamp == packet.header.stamp
    camera.show_all(observations[11:12])  # what was sent before it has come by then
    assert len(camera.answers_to(packet)) == 1


def test_its_state_is_published_to_who_asks(
    camera: Camera, observations: list[Observation]
) -> None:
    """Spikes of either neuron; no action and no reward in this controller."""
    got: list[ControllerState] = []
    subscription = camera.graph.node.create_subscription(
        ControllerState, 'controller/state', got.append, 100
    )
    camera.graph.until(lambda: camera.show_all(observations[:1]) and got)
    observations = renumbered(observations, 3)
    camera.show_all(observations)
    camera.graph.until(lambda: len([1 for each in got if each.episode == 3]) == len(observations))
    states = [each for each in got if each.episode == 3]
    _, spikes = in_process(observations, 3)
    assert [list(state.spikes) for state in states] == spikes
    assert any(any(counts) for counts in spikes)
    assert [state.step for state in states] == list(range(len(observations)))
    answered = {(each.header.stamp.sec, each.header.stamp.nanosec) for each in camera.answers}
    assert {(each.header.stamp.sec, each.header.stamp.nanosec) for each in states} <= answered
    last = states[-1]
    assert (last.controller, last.episode, last.action) == ('braitenberg', 3, -1)
    assert math.isnan(last.reward)
    assert list(last.neurons) == ['left', 'right']
    camera.graph.node.destroy_subscription(subscription)


def test_every_parameter_is_described(camera: Camera) -> None:
    """And is what the parameter file may set."""
    specs = {
        spec.name: spec
        for parameters in (ControllerNodeParameters, BraitenbergParameters)
        for spec in parameters.specs()
    }
    described = camera.graph.call(
        DescribeParameters, 'braitenberg/describe_parameters', names=list(specs)
    ).descriptors
    assert len(described) == len(specs)
    for each in described:
        assert specs[each.name].description in each.description
        assert each.read_only


def test_the_parameter_file_holds_the_defaults() -> None:
    """Every name in it is declared."""
    values = yaml.safe_load(FILE.read_text())['/**']['ros__parameters']
    assert BraitenbergParameters.from_mapping(values) == BraitenbergParameters()


@pytest.fixture(scope='module')
def bare_camera(graph) -> Camera:
    """Give a camera that nobody knows the lane of."""
    parameters = {'seed': SEED, 'use_lane_state': 'false'}
    process = graph.start('braitenberg', parameters, '-r', '__ns:=/bare')
    return Camera(graph, process, has_lane=False, at='/bare')


def test_without_a_lane_state_packets_alone_are_answered(
    bare_camera: Camera, observations: list[Observation]
) -> None:
    """As for a real camera: one episode that never ends. The log says when it is ready."""
    ready = 'ready: answers /bare/event_camera/events on /bare/wheel_velocities'
    bare_camera.graph.until(lambda: ready in bare_camera.process.log, ready)
    assert bare_camera.show_all(observations) == in_process(observations, 0)[0]
    assert bare_camera.process.stop(signal.SIGTERM) == 0


def test_a_wrong_parameter_is_refused_with_one_line(graph) -> None:
    """Exit status 2."""
    process = graph.start('braitenberg', {'poisson.max_events': 0})
    assert process.wait() == 2
    assert process.log.count('error: poisson.max_events: expected') == 1
    assert 'Traceback' not in process.log


def test_a_simulator_of_another_size_is_refused(graph) -> None:
    """The exit status is 2 with one line, also after messages about waiting for the simulator."""
    remapped = ('-r', '__ns:=/small')
    graph.start('simulator', {'robot.model': 'kinematic', 'camera.width': 64}, *remapped)
    process = graph.start('braitenberg', {}, *remapped)
    assert process.wait() == 2
    *before, last = process.log.splitlines()
    assert 'image of 128 x 128 px, as the controller wants, got 64 x 128 px' in last
    assert all('waiting for observations' in line or 'ready: ' in line for line in before)


@pytest.mark.parametrize('numbers', [(signal.SIGINT, signal.SIGTERM), (15, 2)])
def test_signals_in_full_drive_end_both_nodes_quietly(graph, numbers: tuple[int, int]) -> None:
    """They say so and end with 128 + n, without a traceback, whichever goes first."""
    remapped = ('-r', f'__ns:=/drive{numbers[0]:d}')
    parameters = {'robot.model': 'kinematic', 'episode.max_distance_m': 0}
    nodes = [
        graph.start('simulator', parameters, *remapped),
        graph.start('braitenberg', {}, *remapped),
    ]
    steps: list[int] = []
    subscription = graph.node.create_subscription(
        LaneState, f'{remapped[1][6:]}/lane/state', lambda lane: steps.append(lane.step), 10
    )
    graph.until(lambda: steps and steps[-1] > 50)
    for node, number in zip(nodes, numbers, strict=True):
        node.send(number)
    for node, number in zip(nodes, numbers, strict=True):
        assert node.wait() == 128 + number, node.log
        assert f'ended by {signal.Signals(number).name} in episode 1, after ' in node.log
        assert 'Traceback' not in node.log
    graph.node.destroy_subscription(subscription)


def test_a_signal_while_it_starts_leaves_nothing_running(graph) -> None:
    """However early it comes."""
    processes = [graph.start('braitenberg', {}, '-r', '__ns:=/early') for _ in range(2)]
    for process, number in zip(processes, (signal.SIGINT, signal.SIGTERM), strict=True):
        process.send(number)
        process.wait()
