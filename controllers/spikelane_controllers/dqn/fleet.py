"""The deep Q-network in a fleet: many robots that drive with it, learning or not, compiled."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.dqn.controller import Dqn, EndedAction
from spikelane_controllers.dqn.experience_buffer import Replay
from spikelane_controllers.dqn.fleet_kernel import (
    advance,
    Agent,
    Ended,
    make_ended,
    NUMBERS_DTYPE,
    repeat,
    Setting,
)
from spikelane_controllers.dqn.parameters import DqnParameters
from spikelane_controllers.dqn.q_learning import rates_of
from spikelane_controllers.dqn.q_network import flat_weights, network_operations
from spikelane_controllers.dqn.update_kernel import make_learnt, shape_of
from spikelane_controllers.fleet import check_made_for, Journey
from spikelane_controllers.operations import Operations
from spikelane_sim.errors import ParameterError
from spikelane_sim.fleet.generators import Generators, TEMPLATE
from spikelane_sim.fleet.simulators import SimulatorFleet
from spikelane_sim.task import action_wheels, ACTIONS


class DqnFleet:
    """The deep Q-networks of a fleet; see `fleet.ControllerFleet`.

    Attributes:
        controllers: One for each robot, all with the same parameters.
    """

    @staticmethod
    def check(parameters: Any) -> None:
        """Check that the kernel has what controllers with these parameters do.

        Raises:
            ParameterError: They learn on a GPU, where the kernel does not see their weights.
        """
        if parameters.learning and parameters.q_learning.device != 'cpu':
            raise ParameterError(
                f'q_learning.device: expected cpu in a fleet, got {parameters.q_learning.device}'
            )

    def __init__(self, parameters: DqnParameters, simulators: SimulatorFleet) -> None:
        """Make a controller for each robot.

        Raises:
            SpikelaneError: They learn on a GPU, the image is not the camera's, or
                weights cannot be read.
        """
        self.check(parameters)
        check_made_for(parameters, 'image', parameters.image, simulators)
        number, image = len(simulators), parameters.image
        self.controllers = [Dqn(parameters) for _ in range(number)]
        self._parameters = parameters
        self._simulators = simulators
        self._setting = _make_setting(self.controllers[0])
        self._chance = Generators(number)
        self._numbers = np.zeros(number, NUMBERS_DTYPE)
        self._seen = np.zeros((number, image.rows, image.columns), np.int64)
        self._ended: list[Ended] = [make_ended(0, image.rows, image.columns)] * number
        self._agents: dict[int, Agent] = {}
        for robot in range(number):
            self.load(robot)

    def load(self, robot: int) -> None:
        """Take over what a controller is now.

        Raises:
            ParameterError: It has other parameters than the kernel was made with. Only `learning`,
                `checkpoint` and `averaged` may differ.
        """
        controller = self.controllers[robot]
        if _shared(controller.parameters) != _shared(self._parameters):
            raise ParameterError('fleet: expected controllers with the same parameters')
        self.check(controller.parameters)
        self._chance[robot] = controller.rng
        own = self._numbers[robot]
        own['held'], own['action'] = controller.held, controller.action
        own['actions'], own['reward'] = controller.actions, controller.reward
        own['oldest'] = own['decisions'] = own['active'] = 0
        own['n_ended'] = own['is_due'] = 0
        if controller.is_learning:
            learner = controller.learner
            own['steps'], own['updates'] = learner.steps, learner.updates
            own['loss'] = learner.loss
        self._agents[robot] = _make_agent(controller)

    def store(self, robot: int) -> None:
        """Bring a controller up to date; its weights and experience always are."""
        controller, own, agent = self.controllers[robot], self._numbers[robot], self._agents[robot]
        controller.held, controller.action = int(own['held']), int(own['action'])
        controller.actions, controller.reward = int(own['actions']), float(own['reward'])
        controller.image.frames = np.roll(agent.frames, -int(own['oldest']), axis=0)
        controller.counts, controller.inputs = agent.counts.copy(), agent.state.copy()
        if own['decisions']:  # else it shows what it did when it was loaded
            active = int(own['last_active'])
            controller.operations = (
                Operations() if active < 0 else network_operations(controller.network, 1, active)
            )
        if controller.is_learning:
            controller.learner.go_on(int(own['steps']), int(own['updates']), float(own['loss']))

    def operations(self, robot: int) -> Operations:
        """Return the operations since the robot was loaded."""
        own = self._numbers[robot]
        network = self.controllers[robot].network
        return network_operations(network, int(own['decisions']), int(own['active']))

    def taken_in(self, robot: int) -> list[EndedAction]:
        """Return the actions that ended in the last call of `advance`."""
        ended, n = self._ended[robot], int(self._numbers[robot]['n_ended'])
        columns = (each[:n].tolist() for each in (ended.rewards, ended.updates, ended.losses))
        return [EndedAction(*row) for row in zip(*columns, ended.counts[:n], strict=True)]

    def look(self, robot: int) -> None:
        """Let a controller see no events."""
        self._seen[robot] = 0

    def repeat(self, robot: int, answers: NDArray[np.float64], scratch: Any) -> None:
        """Drive a robot with answers that were given before."""
        world, robots = self._simulators.world, self._simulators.robots
        repeat(world, robots, scratch, TEMPLATE, self._setting, self._seen, robot, answers)

    def advance(self, first: int, last: int, journey: Journey, scratch: Any) -> None:
        """Let robots drive; see `fleet.ControllerFleet`."""
        world, robots = self._simulators.world, self._simulators.robots
        # The first action may be about to end, and the observation that ends an episode ends one.
        room = journey.answers.shape[1] // self._setting.steps_per_action + 2
        for robot in range(first, last):
            agent, own = self._agents[robot], self._numbers[robot]
            ended = make_ended(room if agent.is_learning else 0, *agent.counts.shape)
            self._ended[robot] = ended
            own['n_ended'], journey.taken[robot], journey.has_ended[robot] = 0, 0, False
            is_done = False
            while not is_done:
                advance(
                    world,
                    robots,
                    scratch,
                    TEMPLATE,
                    self._setting,
                    agent,
                    self._numbers,
                    self._seen,
                    ended,
                    self._chance.addresses,
                    journey,
                    robot,
                )
                is_done = not own['is_due']
                if not is_done:
                    self._update(robot)

    def _update(self, robot: int) -> None:
        """Make an update that is not compiled."""
        own, learner = self._numbers[robot], self.controllers[robot].learner
        learner.go_on(int(own['steps']), int(own['updates']), float(own['loss']))
        learner.update(self._chance[robot])
        own['updates'], own['loss'] = learner.updates, learner.loss


def _shared(parameters: DqnParameters) -> dict[str, Any]:
    """Return the parameters that all controllers of a fleet have in common."""
    own = ('learning', 'checkpoint', 'averaged')
    return {name: value for name, value in parameters.to_dict().items() if name not in own}


def _make_setting(controller: Dqn) -> Setting:
    parameters = controller.parameters
    image, task, learning = parameters.image, parameters.task, parameters.q_learning
    wheels = [action_wheels(action, task) for action in range(len(ACTIONS))]
    return Setting(
        image.crop_top,
        image.cell,
        controller.steps_per_action,
        task.reward_sigma_m,
        np.array(wheels, np.float64),
        shape_of(controller.network),
        rates_of(learning),
        learning.exploration,
        learning.batch_size,
        learning.update_every,
    )


def _make_agent(controller: Dqn) -> Agent:
    """Return what is in the kernel of a controller as it is now."""
    network, is_learning = controller.network, controller.is_learning
    none = make_learnt(0, 0)
    if is_learning:
        learner = controller.learner
        learnt, replay = learner.learnt or none._replace(weights=learner.weights), learner.replay
    else:
        learnt, replay = none._replace(weights=flat_weights(network)), Replay(0, 0)
    return Agent(
        is_learning,
        is_learning and controller.learner.learnt is not None,
        learnt,
        replay.transitions,
        controller.image.frames,
        controller.counts.copy(),
        controller.inputs.copy(),
    )
