"""The simulator's services: the seeded reset, and the standard set of simulation_interfaces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import Result, SimulationState, SimulatorFeatures
from simulation_interfaces.srv import (
    GetEntityState,
    GetSimulationState,
    GetSimulatorFeatures,
    ResetSimulation,
    SetEntityState,
    SetSimulationState,
    StepSimulation,
)
from spikelane_msgs.srv import Reset

from spikelane_sim.contract import Observation
from spikelane_sim.errors import MessageError, PoseError, SpikelaneError
from spikelane_sim.nodes import conversions
from spikelane_sim.nodes.awaiting import Awaitable
from spikelane_sim.robots.registry import robot_model
from spikelane_sim.run_state import RunState
from spikelane_sim.simulator import Simulator
from spikelane_sim.stepper import Stepper

_FEATURES = [
    SimulatorFeatures.ENTITY_STATE_GETTING,
    SimulatorFeatures.ENTITY_STATE_SETTING,
    SimulatorFeatures.SIMULATION_RESET,
    SimulatorFeatures.SIMULATION_RESET_TIME,
    SimulatorFeatures.SIMULATION_RESET_STATE,
    SimulatorFeatures.SIMULATION_STATE_GETTING,
    SimulatorFeatures.SIMULATION_STATE_SETTING,
    SimulatorFeatures.SIMULATION_STATE_PAUSE,
    SimulatorFeatures.STEP_SIMULATION_SINGLE,
    SimulatorFeatures.STEP_SIMULATION_MULTIPLE,
    SimulatorFeatures.STEP_SIMULATION_ACTION,
]
_SCOPES = (
    ResetSimulation.Request.SCOPE_TIME
    | ResetSimulation.Request.SCOPE_STATE
    | ResetSimulation.Request.SCOPE_SPAWNED
)
_OK = Result(result=Result.RESULT_OK)
#: Time for an answer to arrive before the node ends.
_ANSWER_S = 0.5
_SUPERSEDED = 'another reset or a stop came before the first observation was published'


def _failed(code: int, message: str) -> Result:
    return Result(result=code, error_message=message)


class SimulatorServices:
    """Serves requests about the simulation; each answer comes when it has taken effect."""

    def __init__(
        self, node: Node, simulator: Simulator, stepper: Stepper, end: Callable[[], None]
    ) -> None:
        """Create the services under the node's name.

        Args:
            node: Whose services they are.
            simulator: What is simulated.
            stepper: Takes its steps.
            end: Called when the node is to end, as somebody has asked it to.
        """
        self._node = node
        self._end = end
        self._simulator = simulator
        self._stepper = stepper
        self._entity = robot_model(simulator.parameters.robot.model).entity
        # A request that waits to take effect must not keep the node from anything else.
        group = ReentrantCallbackGroup()
        for kind, name, handle in (
            (Reset, 'reset', self._reset),
            (ResetSimulation, 'reset_simulation', self._reset_simulation),
            (StepSimulation, 'step_simulation', self._step_simulation),
            (GetSimulationState, 'get_simulation_state', self._get_state),
            (SetSimulationState, 'set_simulation_state', self._set_state),
            (GetSimulatorFeatures, 'get_simulator_features', self._get_features),
            (GetEntityState, 'get_entity_state', self._get_entity_state),
            (SetEntityState, 'set_entity_state', self._set_entity_state),
        ):
            node.create_service(kind, f'~/{name}', handle, callback_group=group)
        self._steps_action = ActionServer(
            node,
            SimulateSteps,
            '~/simulate_steps',
            self._simulate_steps,
            cancel_callback=self._cancel_steps,
            callback_group=group,
        )
        # A controller may leave amid the steps asked for.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(0.5, self._take_held_steps, callback_group=group, clock=steady)

    async def _reset(self, request: Reset.Request, response: Reset.Response) -> Reset.Response:
        seed = None if request.seed < 0 else request.seed
        if seed is None and request.episode:
            response.success = False
            response.message = (
                f'episode: expected 0 without a seed, got {request.episode} with seed '
                f'{request.seed}'
            )
            return response
        published = Awaitable(self._node)
        try:
            self._stepper.begin(
                request.lane or None,
                seed,
                episode=request.episode or 1,
                on_published=published.complete,
            )
        except SpikelaneError as error:
            response.success, response.message = False, str(error)
            return response
        seed = self._simulator.seed
        first: Observation | None = await published.result()
        if first is None:
            response.success, response.message = False, _SUPERSEDED
            return response
        lane = first.lane
        assert lane is not None  # a simulator always knows it
        response.success = True
        response.stamp = conversions.to_time(first.stamp_ns)
        response.lane, response.episode = lane.lane, lane.episode
        response.seed = seed
        return response

    async def _reset_simulation(
        self, request: ResetSimulation.Request, response: ResetSimulation.Response
    ) -> ResetSimulation.Response:
        is_all = request.scope in (
            ResetSimulation.Request.SCOPE_DEFAULT,
            ResetSimulation.Request.SCOPE_ALL,
        )
        scope = _SCOPES if is_all else request.scope
        if scope & ~_SCOPES:
            response.result = _failed(
                Result.RESULT_FEATURE_UNSUPPORTED,
                f'scope: expected a combination of time 1, state 2, spawned 4, got {scope}',
            )
            return response
        response.result = _OK
        if self._stepper.state is RunState.STOPPED:
            return response
        published = Awaitable(self._node)
        is_time = bool(scope & ResetSimulation.Request.SCOPE_TIME)
        if scope & ResetSimulation.Request.SCOPE_STATE:
            self._begin_again(is_time, published)
        elif is_time and self._stepper.observation is not None:
            self._stepper.reset_time(published.complete)
        else:  # nothing can be spawned, so nothing is left to despawn
            return response
        if await published.result() is None:
            response.result = _failed(Result.RESULT_OPERATION_FAILED, _SUPERSEDED)
        return response

    def _begin_again(self, is_time: bool, published: Awaitable) -> None:
        # With time reset all begins as at the start; without, another episode on the same lane.
        last = self._simulator.lane_state
        lane = None if is_time or last is None else last.lane
        self._stepper.begin(lane, from_time_zero=is_time, on_published=published.complete)

    async def _step_simulation(
        self, request: StepSimulation.Request, response: StepSimulation.Response
    ) -> StepSimulation.Response:
        response.result = await self._advance(request.steps, None)
        return response

    async def _simulate_steps(self, goal: ServerGoalHandle) -> SimulateSteps.Result:
        result = await self._advance(goal.request.steps, goal)
        if goal.is_cancel_requested:
            goal.canceled()
        elif result.result == Result.RESULT_OK:
            goal.succeed()
        else:
            goal.abort()
        return SimulateSteps.Result(result=result)

    def _cancel_steps(self, goal: ServerGoalHandle) -> CancelResponse:
        del goal  # only one at a time takes steps
        # Here and not after the next step, which nobody may ever answer.
        self._stepper.cancel_advance()
        return CancelResponse.ACCEPT

    async def _advance(self, steps: int, goal: ServerGoalHandle | None) -> Result:
        """Take steps of the paused simulation, and tell the goal, if there is one, of each."""
        if steps < 1:
            return _failed(Result.RESULT_OPERATION_FAILED, 'steps: expected at least 1, got 0')
        over = Awaitable(self._node)

        def on_step(completed: int, is_over: bool) -> None:
            if goal is not None:
                goal.publish_feedback(
                    SimulateSteps.Feedback(
                        completed_steps=completed, remaining_steps=steps - completed
                    )
                )
            if is_over:
                over.complete(completed)

        try:
            self._stepper.advance(steps, on_step)
        except SpikelaneError as error:
            return _failed(Result.RESULT_OPERATION_FAILED, str(error))
        await self._take_held_steps()
        completed = await over.result()
        if completed < steps:
            return _failed(
                Result.RESULT_OPERATION_FAILED, f'stopped after {completed} of {steps} steps'
            )
        return _OK

    async def _take_held_steps(self) -> None:
        """Take the steps asked for, as long as nobody is there to answer."""
        while self._stepper.advance_held():
            await self._next_spin()

    async def _next_spin(self) -> None:
        """Let the executor handle what else is waiting, a cancel request say."""
        turn = Awaitable(self._node)
        self._node.executor.create_task(turn.complete)
        await turn.result()

    def _get_state(
        self, request: GetSimulationState.Request, response: GetSimulationState.Response
    ) -> GetSimulationState.Response:
        del request
        response.state.state = self._stepper.state.value
        response.result = _OK
        return response

    def _set_state(
        self, request: SetSimulationState.Request, response: SetSimulationState.Response
    ) -> SetSimulationState.Response:
        target = request.state.state
        if target == self._stepper.state.value:
            response.result = _failed(
                SetSimulationState.Response.ALREADY_IN_TARGET_STATE,
                f'the simulation is already {self._stepper.state.name.lower()}',
            )
            return response
        actions = {
            SimulationState.STATE_STOPPED: self._stepper.stop,
            SimulationState.STATE_PLAYING: self._stepper.play,
            SimulationState.STATE_PAUSED: self._stepper.pause,
            SimulationState.STATE_QUITTING: self._quit,
        }
        if target not in actions:
            response.result = _failed(
                SetSimulationState.Response.INCORRECT_TRANSITION,
                f'state: expected stopped 0, playing 1, paused 2 or quitting 3, got {target}',
            )
            return response
        actions[target]()
        response.result = _OK
        return response

    def _quit(self) -> None:
        self._stepper.stop()

        def end() -> None:
            timer.cancel()
            self._end()

        # The middleware does not tell when an answer has arrived.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        timer = self._node.create_timer(_ANSWER_S, end, clock=steady)

    def _get_features(
        self, request: GetSimulatorFeatures.Request, response: GetSimulatorFeatures.Response
    ) -> GetSimulatorFeatures.Response:
        del request
        response.features.features = _FEATURES
        response.features.custom_info = 'Spikelane: one robot, lockstep or real time.'
        return response

    def _get_entity_state(
        self, request: GetEntityState.Request, response: GetEntityState.Response
    ) -> GetEntityState.Response:
        response.result = self._known_entity(request.entity)
        if response.result.result == Result.RESULT_OK:
            stamp_ns, robot = self._stepper.robot()
            response.state.header.frame_id = conversions.WORLD_FRAME
            response.state.header.stamp = conversions.to_time(stamp_ns)
            conversions.fill_pose(response.state.pose, robot)
            conversions.fill_world_twist(response.state.twist, robot)
        return response

    def _set_entity_state(
        self, request: SetEntityState.Request, response: SetEntityState.Response
    ) -> SetEntityState.Response:
        response.result = self._known_entity(request.entity)
        if response.result.result == Result.RESULT_OK:
            response.result = self._place(request.state)
        return response

    def _place(self, state: Any) -> Result:
        frame = state.header.frame_id
        if frame not in ('', conversions.WORLD_FRAME):
            return _failed(
                Result.RESULT_FEATURE_UNSUPPORTED,
                f'frame_id: expected {conversions.WORLD_FRAME}, got {frame!r}',
            )
        try:
            conversions.check_entity_state(state)
            position = state.pose.position
            heading_rad = conversions.heading_of(state.pose.orientation)
            self._stepper.place(position.x, position.y, heading_rad)
        except (MessageError, PoseError) as error:
            return _failed(SetEntityState.Response.INVALID_POSE, str(error))
        except SpikelaneError as error:
            return _failed(Result.RESULT_INCORRECT_STATE, str(error))
        return _OK

    def _known_entity(self, name: str) -> Result:
        if name == self._entity:
            return _OK
        message = f'entity: expected {self._entity!r}, got {name!r}'
        return _failed(Result.RESULT_NOT_FOUND, message)
