"""The standard services and action of simulation_interfaces 1.5: every result code, by number."""

from collections.abc import Callable
import math
from typing import Any

from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from event_camera_msgs.msg import EventPacket
from geometry_msgs.msg import Point, Pose, Quaternion
import pytest
from rclpy.action import ActionClient
from rosgraph_msgs.msg import Clock
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import EntityState, SimulationState
from simulation_interfaces.srv import (
    GetEntityState,
    GetSimulationState,
    GetSimulatorFeatures,
    ResetSimulation,
    SetEntityState,
    SetSimulationState,
    StepSimulation,
)
from spikelane_msgs.msg import LaneState, WheelVelocities
from spikelane_msgs.srv import Reset

from spikelane_sim.messages import to_stamp_ns
from spikelane_sim.nodes.conversions import to_time

pytestmark = pytest.mark.ros

UNSUPPORTED, OK, NOT_FOUND, INCORRECT_STATE, FAILED = range(5)
STOPPED, PLAYING, PAUSED, QUITTING = range(4)
STEP_NS = 50_000_000


class Simulation:
    """A simulator process, as a client of the standard services sees it."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.process = graph.start('simulator', {'robot.model': 'kinematic'})
        self.clocks: list[int] = []
        self.lanes: list[LaneState] = []
        self.packets: list[EventPacket] = []
        self.status: dict[str, str] = {}
        node = graph.node
        node.create_subscription(Clock, '/clock', self._on_clock, 100)
        node.create_subscription(LaneState, 'lane/state', self.lanes.append, 100)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        node.create_subscription(EventPacket, 'event_camera/events', self.packets.append, 100)
        self.clients = {
            kind: node.create_client(kind, f'simulator/{name}')
            for kind, name in (
                (GetEntityState, 'get_entity_state'),
                (GetSimulationState, 'get_simulation_state'),
                (GetSimulatorFeatures, 'get_simulator_features'),
                (Reset, 'reset'),
                (ResetSimulation, 'reset_simulation'),
                (SetEntityState, 'set_entity_state'),
                (SetSimulationState, 'set_simulation_state'),
                (StepSimulation, 'step_simulation'),
            )
        }
        self.steps = ActionClient(node, SimulateSteps, 'simulator/simulate_steps')
        self.feedback: list[tuple[int, int]] = []
        graph.until(lambda: all(each.service_is_ready() for each in self.clients.values()))
        graph.until(self.steps.server_is_ready)
        graph.until(lambda: self.packets and self.lanes and self.clocks)
        self.set_state(PAUSED)
        graph.until(self._is_fed_back, 'feedback')
        # The readers were met one after the other: begin to count with all of them.
        self.forget()
        self.set_state(PLAYING)

    def _last_stamp_ns(self) -> int | None:
        """Return the stamp of the last step that all its messages have arrived of."""
        if not (self.clocks and self.lanes and self.packets):
            return None
        stamps = {_stamp_ns(self.lanes[-1]), _stamp_ns(self.packets[-1]), self.clocks[-1]}
        return stamps.pop() if len(stamps) == 1 else None

    def _is_fed_back(self) -> bool:
        """Take a step; the feedback's reader may be met later than the services."""
        self.graph.result(self.simulate_steps(1).get_result_async())
        return bool(self.feedback)

    def _on_clock(self, message: Clock) -> None:
        self.clocks.append(to_stamp_ns(message.clock))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.status = {pair.key: pair.value for pair in message.status[0].values}

    def ask(self, kind: type, **fields: Any) -> Any:
        """Begin to call a service; return the future."""
        return self.clients[kind].call_async(kind.Request(**fields))

    def call(self, kind: type, **fields: Any) -> Any:
        """Call a service; return the response."""
        return self.graph.result(self.ask(kind, **fields))

    def code(self, kind: type, **fields: Any) -> int:
        """Call a service; return the result's code."""
        result = self.call(kind, **fields).result
        # A failure says why, a success has nothing to say.
        assert bool(result.error_message) == (result.result != OK)
        return result.result

    @property
    def state(self) -> int:
        """State of the simulation."""
        response = self.call(GetSimulationState)
        assert response.result.result == OK
        return response.state.state

    def set_state(self, state: int) -> int:
        """Ask for a state; return the result's code."""
        return self.code(SetSimulationState, state=SimulationState(state=state))

    def begin(self, state: int = PAUSED) -> None:
        """Begin at time zero, in a state, and see the first observation."""
        if self.state != state:
            assert self.set_state(state) == OK
        if state == STOPPED:
            return
        self.forget()
        assert self.code(ResetSimulation) == OK
        self.see(STEP_NS)

    def forget(self) -> None:
        """Forget what was published; all of it has arrived, as answers come after it."""
        # Not as many of each: of many steps in no time, a reader misses some.
        self.graph.until(lambda: self._last_stamp_ns() is not None or not self.packets)
        for seen in (self.clocks, self.lanes, self.packets):
            seen.clear()

    def see(self, stamp_ns: int) -> LaneState:
        """Wait for an observation; return its lane state."""
        self.graph.until(
            lambda: self._last_stamp_ns() == stamp_ns, f'the observation at {stamp_ns} ns'
        )
        return self.lanes[-1]

    def simulate_steps(self, steps: int) -> Any:
        """Send a goal; return its handle."""
        # A list of its own: what an earlier goal is told may come late.
        self.feedback = feedback = []

        def on_feedback(message: Any) -> None:
            told = message.feedback
            feedback.append((told.completed_steps, told.remaining_steps))

        goal = SimulateSteps.Goal(steps=steps)
        handle = self.graph.result(self.steps.send_goal_async(goal, on_feedback))
        assert handle.accepted
        return handle


def _stamp_ns(message: Any) -> int:
    return to_stamp_ns(message.header.stamp)


@pytest.fixture(scope='module')
def simulation(graph) -> Simulation:
    """Give a simulator that plays, without a controller."""
    return Simulation(graph)


def test_it_starts_playing(simulation: Simulation) -> None:
    """Unless told not to start by itself."""
    assert simulation.state == PLAYING


def test_the_features_are_exactly_those_served(simulation: Simulation) -> None:
    """Entity state 10, 11; reset 20, 21, 22; state 24, 25, 26; steps 31, 32, 33."""
    features = simulation.call(GetSimulatorFeatures).features
    assert sorted(features.features) == [10, 11, 20, 21, 22, 24, 25, 26, 31, 32, 33]
    assert list(features.spawn_formats) == []


@pytest.mark.parametrize('state', [PLAYING, PAUSED, STOPPED])
def test_a_state_that_is_already_there_is_told_apart(simulation: Simulation, state: int) -> None:
    """Code 101; nothing changes."""
    simulation.begin(state)
    assert simulation.set_state(state) == 101
    assert simulation.state == state


@pytest.mark.parametrize(
    ('before', 'after'),
    [
        (PLAYING, PAUSED),
        (PAUSED, PLAYING),
        (PLAYING, STOPPED),
        (STOPPED, PAUSED),
        (PAUSED, STOPPED),
        (STOPPED, PLAYING),
    ],
)
def test_every_state_leads_to_every_other(simulation: Simulation, before: int, after: int) -> None:
    """Stopped to paused too, as the message's text has it."""
    simulation.begin(before)
    assert simulation.set_state(after) == OK
    assert simulation.state == after


@pytest.mark.parametrize('target', [4, 5, 9, 255])
def test_states_that_cannot_be_asked_for(simulation: Simulation, target: int) -> None:
    """No world 4, loading 5, and numbers that are no state."""
    simulation.begin(PLAYING)
    assert simulation.set_state(target) == 103
    assert simulation.state == PLAYING


def test_play_after_stop_begins_at_time_zero(simulation: Simulation) -> None:
    """On the first lane again."""
    assert simulation.call(Reset, lane='inner', seed=5).success
    if simulation.state != STOPPED:
        assert simulation.set_state(STOPPED) == OK
    simulation.forget()
    assert simulation.set_state(PLAYING) == OK
    lane = simulation.see(STEP_NS)
    assert (lane.lane, lane.episode, lane.step) == ('outer', 1, 0)


def test_a_stopped_simulation_is_as_launched(simulation: Simulation) -> None:
    """The robot is back at once, and a reset begins at time zero."""
    simulation.begin(PAUSED)
    assert simulation.code(SetEntityState, entity='pioneer') == OK
    assert simulation.set_state(STOPPED) == OK
    state = simulation.call(GetEntityState, entity='pioneer').state
    assert to_stamp_ns(state.header.stamp) == 0
    assert (state.pose.position.x, state.pose.position.y) == pytest.approx((3.0, 0.25))
    simulation.forget()
    assert simulation.call(Reset, lane='inner', seed=5).success
    lane = simulation.see(STEP_NS)
    assert (lane.lane, lane.episode, lane.step) == ('inner', 1, 0)


def test_steps_are_refused_unless_paused(simulation: Simulation) -> None:
    """Code 4; zero steps are none."""
    simulation.begin(PLAYING)
    assert simulation.code(StepSimulation, steps=1) == FAILED
    simulation.begin(STOPPED)
    assert simulation.code(StepSimulation, steps=1) == FAILED
    simulation.begin(PAUSED)
    assert simulation.code(StepSimulation, steps=0) == FAILED
    assert simulation.lanes[-1].step == 0


def test_without_a_controller_the_last_command_holds(simulation: Simulation) -> None:
    """At first a standstill; the answer comes when all steps are taken."""
    simulation.begin()
    assert simulation.code(StepSimulation, steps=3) == OK
    lane = simulation.see(4 * STEP_NS)
    assert (lane.step, lane.progress) == (3, 0.0)
    assert simulation.clocks == [n * STEP_NS for n in (1, 2, 3, 4)]
    assert simulation.state == PAUSED


def test_stopped_then_paused_has_not_begun(simulation: Simulation) -> None:
    """The first step asked for begins at time zero."""
    simulation.begin(STOPPED)
    assert simulation.set_state(PAUSED) == OK
    simulation.forget()
    assert simulation.code(StepSimulation, steps=1) == OK
    simulation.see(2 * STEP_NS)
    assert [lane.step for lane in simulation.lanes] == [0, 1]


def test_the_action_tells_of_every_step(simulation: Simulation) -> None:
    """In order, and succeeds; rclpy's client drops what comes after it knows of the success."""
    simulation.begin()
    answer = simulation.graph.result(simulation.simulate_steps(8).get_result_async())
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert answer.result.result.result == OK
    told = simulation.feedback
    assert told
    assert told == [(step, 8 - step) for step in range(1, len(told) + 1)]
    assert simulation.see(9 * STEP_NS).step == 8


def test_the_action_is_aborted_while_playing(simulation: Simulation) -> None:
    """With the service's code."""
    simulation.begin(PLAYING)
    answer = simulation.graph.result(simulation.simulate_steps(4).get_result_async())
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert answer.result.result.result == FAILED


def test_the_action_can_be_cancelled(simulation: Simulation) -> None:
    """Meanwhile no other steps can be asked for; after it, they can."""
    simulation.begin()
    handle = simulation.simulate_steps(10**6)
    simulation.graph.until(lambda: simulation.feedback)
    assert simulation.code(StepSimulation, steps=1) == FAILED
    result = handle.get_result_async()
    cancelled = simulation.graph.result(handle.cancel_goal_async())
    assert len(cancelled.goals_canceling) == 1
    answer = simulation.graph.result(result)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert answer.result.result.result == FAILED
    assert 'of 1000000 steps' in answer.result.result.error_message
    assert simulation.code(StepSimulation, steps=1) == OK


def test_the_robot_is_found_by_its_name(simulation: Simulation) -> None:
    """At the lane's start, at rest, in the world's frame."""
    simulation.begin()
    response = simulation.call(GetEntityState, entity='pioneer')
    assert response.result.result == OK
    state = response.state
    assert state.header.frame_id == 'odom'
    assert to_stamp_ns(state.header.stamp) == STEP_NS
    assert (state.pose.position.x, state.pose.position.y) == pytest.approx((3.0, 0.25))
    assert state.pose.orientation == Quaternion(w=1.0)
    assert state.twist.linear.x == 0.0


def test_unknown_entities_are_not_found(simulation: Simulation) -> None:
    """Neither to get nor to set."""
    assert simulation.code(GetEntityState, entity='lamp') == NOT_FOUND
    assert simulation.code(SetEntityState, entity='lamp') == NOT_FOUND


def test_the_robot_is_put_where_asked(simulation: Simulation) -> None:
    """At rest, within the episode; the next observation is from there."""
    simulation.begin()
    pose = Pose(position=Point(x=4.0, y=0.35), orientation=Quaternion(z=1.0, w=1.0))
    assert simulation.code(SetEntityState, entity='pioneer', state=EntityState(pose=pose)) == OK
    got = simulation.call(GetEntityState, entity='pioneer').state.pose
    assert (got.position.x, got.position.y) == pytest.approx((4.0, 0.35))
    assert got.orientation.z == pytest.approx(math.sqrt(0.5))
    assert simulation.code(StepSimulation, steps=1) == OK
    lane = simulation.see(2 * STEP_NS)
    assert (lane.episode, lane.step) == (1, 1)
    assert lane.distance == pytest.approx(-0.1)


def entity_state(**fields: float) -> EntityState:
    """Return the robot's state at its start but for some fields, their dots as __."""
    state = EntityState(pose=Pose(position=Point(x=3.0, y=0.25)))
    for name, value in fields.items():
        *path, field = name.split('__')
        message: Any = state
        for part in path:
            message = getattr(message, part)
        setattr(message, field, value)
    return state


@pytest.mark.parametrize(
    'fields',
    [
        {'pose__position__x': math.nan},
        {'pose__position__y': math.inf},
        {'pose__position__x': 1.7e308},
        {'pose__position__y': -30.0},  # 10 m from the road are allowed
        {'pose__position__z': math.nan},
        {'pose__position__z': 2.0},  # in the air
        {'pose__orientation__w': 0.0},
        {'pose__orientation__z': math.nan},
        {'pose__orientation__w': 1e200},  # its square is not finite
        {'pose__orientation__x': 1.0},  # on its side
        {'twist__linear__x': math.nan},
        {'twist__angular__z': -math.inf},
        {'header__stamp__nanosec': 1_000_000_000},
    ],
)
def test_invalid_poses_are_refused(simulation: Simulation, fields: dict[str, float]) -> None:
    """With the code for it; the robot stays where it is."""
    simulation.begin()
    state = entity_state(**fields)
    assert simulation.code(SetEntityState, entity='pioneer', state=state) == 101
    got = simulation.call(GetEntityState, entity='pioneer').state.pose.position
    assert (got.x, got.y) == pytest.approx((3.0, 0.25))


def test_the_state_that_was_got_can_be_set(simulation: Simulation) -> None:
    """With the twist of a robot in motion, which is then at rest."""
    simulation.begin()
    state = simulation.call(GetEntityState, entity='pioneer').state
    state.twist.linear.x = 0.1
    assert simulation.code(SetEntityState, entity='pioneer', state=state) == OK
    assert simulation.call(GetEntityState, entity='pioneer').state.twist.linear.x == 0.0


def test_a_robot_within_the_area_beyond_the_lane_loses_the_lane(simulation: Simulation) -> None:
    """9 m from the road at the next step."""
    simulation.begin()
    state = entity_state(pose__position__y=-9.0)
    assert simulation.code(SetEntityState, entity='pioneer', state=state) == OK
    assert simulation.code(StepSimulation, steps=1) == OK
    lane = simulation.see(2 * STEP_NS)
    assert (lane.terminated, lane.reason) == (True, 'lane_lost')


def test_as_many_steps_as_the_message_can_name_can_be_asked_for(simulation: Simulation) -> None:
    """2^64 - 1; a reset ends them, and the node serves on."""
    simulation.begin()
    answer = simulation.ask(StepSimulation, steps=2**64 - 1)
    # Not one step in particular: of many steps in no time, a reader misses some.
    simulation.graph.until(lambda: simulation.clocks and simulation.clocks[-1] >= 9 * STEP_NS)
    assert simulation.code(ResetSimulation) == OK
    result = simulation.graph.result(answer).result
    assert (result.result, 'of 18446744073709551615 steps' in result.error_message) == (
        FAILED,
        True,
    )


@pytest.mark.parametrize('seed', [-(2**63), 2**63 - 1])
def test_every_seed_of_the_message_begins_an_episode(simulation: Simulation, seed: int) -> None:
    """A negative one keeps the seed."""
    simulation.begin()
    assert simulation.call(Reset, lane='outer', seed=seed).success


def test_after_the_last_number_of_an_episode_none_begins(simulation: Simulation) -> None:
    """2^32 - 1, as the messages have it; the node refuses, and lives."""
    simulation.begin()
    last = simulation.call(Reset, lane='outer', seed=1, episode=2**32 - 1)
    assert (last.success, last.episode) == (True, 4294967295)
    refused = simulation.call(Reset, lane='outer', seed=-1)
    assert (refused.success, refused.message) == (
        False,
        'episode: expected a number from 1 to 4294967295, got 4294967296',
    )
    assert simulation.call(Reset, lane='outer', seed=1).episode == 1


def test_a_pose_in_another_frame_is_not_supported(simulation: Simulation) -> None:
    """Nothing is transformed; the world's own name is fine."""
    simulation.begin()
    state = EntityState()
    state.pose.position.x, state.pose.position.y = 3.0, 0.25
    state.header.frame_id = 'base_link'
    assert simulation.code(SetEntityState, entity='pioneer', state=state) == UNSUPPORTED
    state.header.frame_id = 'odom'
    assert simulation.code(SetEntityState, entity='pioneer', state=state) == OK


def test_a_stopped_robot_cannot_be_moved(simulation: Simulation) -> None:
    """The next episode would put it back."""
    simulation.begin(STOPPED)
    assert simulation.code(SetEntityState, entity='pioneer') == INCORRECT_STATE


def moved(simulation: Simulation) -> LaneState:
    """Play the second episode, away from the start, three steps in."""
    simulation.begin()
    assert simulation.call(Reset, lane='inner', seed=-1).success
    pose = Pose(position=Point(x=9.3, y=5.0), orientation=Quaternion(z=-1.0, w=1.0))
    assert simulation.code(SetEntityState, entity='pioneer', state=EntityState(pose=pose)) == OK
    assert simulation.code(StepSimulation, steps=3) == OK
    lane = simulation.see(5 * STEP_NS)
    assert (lane.episode, lane.step, lane.lane) == (2, 3, 'inner')
    simulation.forget()
    return lane


@pytest.mark.parametrize('scope', [0, 255, 3, 7])
def test_a_full_reset_begins_all_again(simulation: Simulation, scope: int) -> None:
    """Time, episode and lane."""
    moved(simulation)
    assert simulation.code(ResetSimulation, scope=scope) == OK
    lane = simulation.see(STEP_NS)
    assert (lane.lane, lane.episode, lane.step, lane.progress) == ('outer', 1, 0, 0.0)
    assert simulation.state == PAUSED


def test_a_reset_of_time_changes_nothing_else(simulation: Simulation) -> None:
    """The robot stays where it is; only this and a full reset let time go back."""
    before = moved(simulation)
    assert simulation.code(ResetSimulation, scope=1) == OK
    lane = simulation.see(STEP_NS)
    assert (lane.lane, lane.episode, lane.step) == ('inner', 2, 3)
    assert (lane.distance, lane.position) == (before.distance, before.position)
    assert simulation.clocks == [STEP_NS]


def test_a_reset_of_state_lets_time_go_on(simulation: Simulation) -> None:
    """Another episode on the same lane."""
    moved(simulation)
    assert simulation.code(ResetSimulation, scope=2) == OK
    lane = simulation.see(6 * STEP_NS)
    assert (lane.lane, lane.episode, lane.step, lane.progress) == ('inner', 3, 0, 0.0)


def test_nothing_spawned_means_nothing_to_reset(simulation: Simulation) -> None:
    """It is fine, and publishes nothing."""
    moved(simulation)
    assert simulation.code(ResetSimulation, scope=4) == OK
    assert simulation.code(StepSimulation, steps=1) == OK
    simulation.see(6 * STEP_NS)
    assert simulation.clocks == [6 * STEP_NS]


@pytest.mark.parametrize('scope', [8, 9, 128])
def test_unknown_scopes_are_not_supported(simulation: Simulation, scope: int) -> None:
    """This also holds together with known scopes; nothing is reset."""
    moved(simulation)
    assert simulation.code(ResetSimulation, scope=scope) == UNSUPPORTED
    assert simulation.clocks == []


def test_steps_stop_where_the_episode_does(simulation: Simulation) -> None:
    """Code 4 and how many were taken; more need a reset."""
    simulation.begin()
    pose = Pose(position=Point(x=3.0, y=-0.3))
    assert simulation.code(SetEntityState, entity='pioneer', state=EntityState(pose=pose)) == OK
    result = simulation.call(StepSimulation, steps=5).result
    assert (result.result, result.error_message) == (FAILED, 'stopped after 1 of 5 steps')
    assert simulation.code(StepSimulation, steps=1) == FAILED
    assert simulation.code(ResetSimulation) == OK
    assert simulation.code(StepSimulation, steps=1) == OK


class Answers:
    """A controller that answers observations when told to."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        node = simulation.graph.node
        self._publisher = node.create_publisher(WheelVelocities, 'wheel_velocities', 10)
        simulation.graph.until(self._publisher.get_subscription_count)
        # Once a command was noticed, the simulator knows that there is a controller.
        ignored = simulation.status.get('commands_ignored')
        self.answer(0)
        simulation.graph.until(lambda: simulation.status.get('commands_ignored') != ignored)

    def answer(self, stamp_ns: int, velocity: float = 1.0) -> None:
        """Answer an observation."""
        message = WheelVelocities(left=velocity, right=velocity)
        message.header.stamp = to_time(stamp_ns)
        self._publisher.publish(message)

    def leave(self) -> None:
        """End."""
        self._simulation.graph.node.destroy_publisher(self._publisher)


@pytest.fixture
def answers(simulation: Simulation) -> Any:
    """Give a controller that answers when told to."""
    simulation.graph.until(lambda: simulation.status)
    answers = Answers(simulation)
    yield answers
    answers.leave()


def test_with_a_controller_each_step_is_answered(simulation: Simulation, answers: Answers) -> None:
    """As in lockstep: nothing moves before the answer, which drives."""
    simulation.begin()
    response = simulation.ask(StepSimulation, steps=2)
    assert simulation.state == PAUSED
    assert not response.done()
    answers.answer(STEP_NS)
    assert simulation.see(2 * STEP_NS).step == 1
    assert not response.done()
    answers.answer(2 * STEP_NS, 2.0)
    assert simulation.graph.result(response).result.result == OK
    lane = simulation.see(3 * STEP_NS)
    assert lane.step == 2
    assert lane.progress == pytest.approx((1.0 + 2.0) * 0.0975 * 0.05)


def test_an_answer_given_before_is_not_asked_for_again(
    simulation: Simulation, answers: Answers
) -> None:
    """A controller answers a paused simulation too; the next step takes that answer."""
    simulation.begin(PLAYING)
    answers.answer(STEP_NS, 3.0)
    simulation.see(2 * STEP_NS)
    simulation.begin(PAUSED)
    answers.answer(STEP_NS, 3.0)
    assert simulation.code(StepSimulation, steps=1) == OK
    assert simulation.see(2 * STEP_NS).progress == pytest.approx(3.0 * 0.0975 * 0.05)


def test_steps_can_be_cancelled_while_a_controller_is_silent(
    simulation: Simulation, answers: Answers
) -> None:
    """And everything else is served meanwhile."""
    simulation.begin()
    handle = simulation.simulate_steps(5)
    result = handle.get_result_async()
    assert simulation.call(GetEntityState, entity='pioneer').result.result == OK
    assert not result.done()
    simulation.graph.result(handle.cancel_goal_async())
    answer = simulation.graph.result(result)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert answer.result.result.error_message == 'stopped after 0 of 5 steps'


def test_a_controller_that_leaves_is_not_waited_for(simulation: Simulation) -> None:
    """The steps it was asked for are taken with its last command."""
    simulation.graph.until(lambda: simulation.status)
    controller = Answers(simulation)
    simulation.begin()
    response = simulation.ask(StepSimulation, steps=3)
    controller.answer(STEP_NS, 2.0)
    simulation.see(2 * STEP_NS)
    assert not response.done()
    controller.leave()
    assert simulation.graph.result(response).result.result == OK
    assert simulation.see(4 * STEP_NS).progress == pytest.approx(3 * 2.0 * 0.0975 * 0.05)


@pytest.mark.parametrize(
    'end',
    [
        lambda simulation: simulation.set_state(STOPPED),
        lambda simulation: simulation.code(ResetSimulation),
    ],
)
def test_stop_and_reset_end_the_steps_being_taken(
    simulation: Simulation, answers: Answers, end: Callable[[Simulation], int]
) -> None:
    """Whoever asked for them is told."""
    simulation.begin()
    response = simulation.ask(StepSimulation, steps=5)
    assert simulation.state == PAUSED
    assert end(simulation) == OK
    assert simulation.graph.result(response).result.result == FAILED


def test_quitting_is_answered_and_ends_the_process(simulation: Simulation) -> None:
    """Exit status 0, nothing on the way."""
    assert simulation.set_state(QUITTING) == OK
    assert simulation.process.wait() == 0
    assert 'Traceback' not in simulation.process.log
