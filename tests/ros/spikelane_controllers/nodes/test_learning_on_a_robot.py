"""R-STDP learns on a robot: the simulator in real time stands in for it, the test for the person.

The simulator's robot hears `cmd_vel` alone, its episodes never end, and the controller knows of it
no more than events and, on a topic of Float64, the distance from its lane.
"""

from collections.abc import Iterator
from pathlib import Path
import threading
import time
from typing import Any

from geometry_msgs.msg import Twist
import numpy as np
import pytest
from simulation_interfaces.msg import EntityState
from simulation_interfaces.srv import SetEntityState
from spikelane_msgs.msg import ControllerState, LaneState
from spikelane_msgs.srv import Reset
from std_msgs.msg import Bool, Float64
from std_srvs.srv import Trigger

from spikelane_controllers.checkpoint import read_checkpoint

pytestmark = pytest.mark.ros

SPACE = '/learn'
STEPS, SAVE_EVERY = 160, 20
#: Uneven weights, so that neurons spike and the robot swerves.
SWERVING = {'initial_weights.low_pa': 100.0, 'initial_weights.high_pa': 500.0}
ENDLESS = {'episode.max_distance_m': 0.0, 'episode.max_laps': 0}


class Person:
    """Who holds the dead-man switch, puts the robot back, and says so."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.is_holding = True
        self.lanes: list[LaneState] = []
        self.states: list[ControllerState] = []
        graph.node.create_subscription(LaneState, f'{SPACE}/lane/state', self.lanes.append, 1000)
        graph.node.create_subscription(
            ControllerState, f'{SPACE}/controller/state', self.states.append, 1000
        )
        self._switch = graph.node.create_publisher(Bool, f'{SPACE}/dead_man_switch', 10)
        self._has_left = threading.Event()
        self._thread = threading.Thread(target=self._hold)
        self._thread.start()

    def _hold(self) -> None:
        while not self._has_left.wait(0.05):
            self._switch.publish(Bool(data=self.is_holding))

    def leave(self) -> None:
        """Hold nothing any more."""
        self._has_left.set()
        self._thread.join()

    def say_it_is_back(self) -> Any:
        """Call the service; return its answer."""
        return self.graph.call(Trigger, f'{SPACE}/rstdp/begin_episode')

    def put_back(self) -> None:
        """Put the robot at the start of its lane."""
        assert self.graph.call(Reset, f'{SPACE}/simulator/reset', lane='outer').success

    def carry_off(self) -> None:
        """Put the robot 0.3 m to the right of its lane, on the first straight."""
        state = EntityState()
        state.pose.position.x, state.pose.position.y = 4.0, 0.25 - 0.3
        state.pose.orientation.w = 1.0
        service = f'{SPACE}/simulator/set_entity_state'
        answer = self.graph.call(SetEntityState, service, entity='pioneer', state=state)
        assert answer.result.result == 1

    def wait_for_steps(self, count: int) -> None:
        """Wait until the controller has answered so many steps more."""
        wanted = len(self.states) + count
        self.graph.until(lambda: len(self.states) >= wanted, f'{count} steps')

    def moved_m(self, seconds: float) -> float:
        """Return how far the robot drives in some time."""
        since_s, before = time.monotonic(), len(self.lanes)
        self.graph.until(lambda: time.monotonic() - since_s > seconds)
        return self.lanes[-1].progress - self.lanes[before].progress


@pytest.fixture
def person(graph: Any) -> Iterator[Person]:
    """Give a person next to a robot."""
    simulation = {'mode': 'realtime', 'robot.engine': 'kinematic', **ENDLESS}
    simulator = graph.start('simulator', simulation, '-r', f'__ns:={SPACE}')
    person = Person(graph)
    graph.until(lambda: person.lanes, 'a robot')
    yield person
    person.leave()
    simulator.kill()


def start(graph: Any, folder: Path, **others: Any) -> Any:
    """Start R-STDP on the robot; wait until it is ready."""
    parameters = {
        'learning': True,
        'use_lane_state': False,
        'lane_source': 'distance',
        'command': 'twist',
        'base.dead_man': 'bool',
        'output': folder,
        'steps': STEPS,
        'save_every': SAVE_EVERY,
        **SWERVING,
        **others,
    }
    names = ('-r', f'__ns:={SPACE}', '-r', 'wheel_velocities:=wheels_of_rstdp')
    node = graph.start('rstdp', parameters, *names)
    graph.until(lambda: 'ready: ' in node.log or node.status is not None, 'the node')
    return node


def test_it_learns_is_put_back_is_stopped_and_goes_on(
    graph: Any, person: Person, tmp_path: Path
) -> None:
    """The robot stands until a person has said that it is on its lane, and after each episode."""
    node = start(graph, tmp_path / 'training')
    graph.until(lambda: 'wheel radius 0.0975 m' in node.log, 'the size of the robot')
    assert person.moved_m(1.0) == 0.0
    answer = person.say_it_is_back()
    assert (answer.success, answer.message) == (True, 'episode 1 begins')
    person.wait_for_steps(45)
    assert person.lanes[-1].progress > 0.05
    # Nothing is learnt while the switch is released, and the robot stands.
    person.is_holding = False
    graph.until(lambda: 'dead-man switch: not held; the robot is stopped' in node.log)
    person.moved_m(0.3)
    answered = len(person.states)
    assert abs(person.moved_m(1.0)) < 1e-6
    assert len(person.states) == answered
    person.is_holding = True
    person.wait_for_steps(5)
    assert {each.episode for each in person.states} == {1}
    # A person ends an episode that runs.
    person.put_back()
    assert person.say_it_is_back().message == 'episode 2 begins'
    person.wait_for_steps(5)
    assert person.states[-1].episode == 2
    # The lane is lost: the robot stands, wherever it is, until it is back on its lane.
    person.carry_off()
    graph.until(lambda: 'episode 2 is over after' in node.log, 'the end of the episode')
    person.moved_m(0.3)
    assert abs(person.moved_m(0.5)) < 1e-6
    answer = person.say_it_is_back()
    assert not answer.success
    assert answer.message.startswith("robot: expected at most 0.2 m from the lane's centre, got 0")
    person.put_back()
    person.moved_m(0.3)
    assert person.say_it_is_back().message == 'episode 3 begins'
    person.wait_for_steps(5)
    # Stopped, it is resumed with the weights that it had, and with the next episode.
    assert node.stop() == 130
    first = read_checkpoint(tmp_path / 'training', 'rstdp')
    assert 40 <= first.facts['steps'] < STEPS
    reasons = [each[-1] for each in first.facts['terminations']]
    assert reasons == ['put_back', 'lane_lost'][: len(reasons)]
    weights = first.arrays['training.weight_history']
    assert (weights[-1] != weights[0]).any()
    person.put_back()
    node = start(graph, tmp_path / 'training', resume=True)
    answer = person.say_it_is_back()
    next_episode = first.facts['episode'] + 1
    assert answer.message == f'episode {next_episode} begins'
    graph.until(lambda: node.status is not None, 'the end of the training')
    assert node.status == 0
    last = read_checkpoint(tmp_path / 'training', 'rstdp')
    assert last.facts['steps'] == STEPS
    kept = last.arrays['training.weight_history']
    np.testing.assert_array_equal(kept[: len(weights)], weights)
    assert len(kept) == STEPS // SAVE_EVERY + 1
    person.moved_m(0.3)
    assert abs(person.moved_m(0.5)) < 1e-6


def test_the_robot_stops_soon_after_the_last_lane_distance(
    graph: Any, person: Person, tmp_path: Path
) -> None:
    """And cannot begin an episode without; the distance comes under another name here."""
    distances = graph.node.create_publisher(Float64, f'{SPACE}/measured', 10)
    twists: list[tuple[float, float]] = []
    graph.node.create_subscription(
        Twist,
        f'{SPACE}/cmd_vel',
        lambda each: twists.append((time.monotonic(), each.linear.x)),
        10,
    )
    names = ('-r', f'__ns:={SPACE}', '-r', 'wheel_velocities:=wheels_of_rstdp')
    parameters = {'learning': True, 'use_lane_state': False, 'lane_source': 'distance'}
    parameters |= {'command': 'twist', 'output': tmp_path / 'training'}
    node = graph.start('rstdp', parameters, *names, '-r', f'lane/distance:={SPACE}/measured')
    graph.until(lambda: 'wheel radius 0.0975 m' in node.log, 'the size of the robot')
    graph.until(distances.get_subscription_count, 'the node')
    answer = person.say_it_is_back()
    assert not answer.success
    assert 'lane/distance: expected one within the timeout, got none' in answer.message
    times_s = []
    for _ in range(3):
        is_silent = threading.Event()

        def measure(is_silent: threading.Event = is_silent) -> None:
            while not is_silent.wait(0.05):
                distances.publish(Float64(data=0.01))

        source = threading.Thread(target=measure)
        source.start()
        graph.until(lambda: person.say_it_is_back().success, 'an episode')
        driven = len(twists)
        graph.until(lambda driven=driven: twists[driven:] and twists[-1][1] > 0, 'a drive')
        is_silent.set()
        source.join()
        silent_s = time.monotonic()
        graph.until(lambda: twists[-1][1] == 0.0, 'a stop')
        last_s = max(heard_s for heard_s, forward in twists if forward > 0)
        stop_s = min(heard_s for heard_s, _ in twists if heard_s > last_s)
        times_s.append(stop_s - silent_s)
    print('stopped after', times_s, 's')
    assert min(times_s) <= 0.25
    graph.until(lambda: 'lane/distance: none came for 0.2 s; the robot is stopped' in node.log)
    node.kill()


@pytest.mark.parametrize(
    ('given', 'reason'),
    [
        ({'use_lane_state': True}, 'use_lane_state: expected false with lane_source distance'),
        ({'command': 'wheels'}, 'command: expected twist or twist_stamped with lane_source dist'),
        ({'lane_source': 'simulator'}, 'use_lane_state: expected true, since the reward depends'),
    ],
)
def test_parameters_that_do_not_fit_together_are_refused(
    graph: Any, tmp_path: Path, given: dict[str, Any], reason: str
) -> None:
    """With status 2 and one line."""
    node = start(graph, tmp_path / 'training', **given)
    assert node.wait() == 2
    assert node.log.startswith(f'error: {reason}')
    assert node.log.count('\n') == 1
