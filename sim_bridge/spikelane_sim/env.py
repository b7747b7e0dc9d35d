"""Gymnasium environment `spikelane/LaneKeeping-v0`: the paper's task with its reward."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from dataclasses import dataclass
from typing import Any

import gymnasium
from gymnasium import spaces
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.contract import (
    LaneState,
    Observation,
    TERMINATED_LANE_LOST,
    TERMINATED_NO_PROGRESS,
    WheelVelocities,
)
from spikelane_sim.course import scenario_course
from spikelane_sim.env_observations import OBSERVATIONS
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.filters import FilterParameters, FilterStage
from spikelane_sim.parameters import MOST_STEPS, parameter
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters
from spikelane_sim.task import action_wheels, ACTIONS, DecisionParameters, lane_centre_reward

#: Reasons of an episode's end for which it counts as no success.
_FAILURES = (TERMINATED_LANE_LOST, TERMINATED_NO_PROGRESS)


@dataclass(frozen=True, kw_only=True)
class TaskParameters(DecisionParameters):
    """The task around the simulator: actions, reward and length."""

    max_actions: int = parameter(
        1000,
        'Number of actions after which an episode is truncated.',
        low=1,
        high=MOST_STEPS,
        source='paper section 3.4',
    )


class LaneKeepingEnv(gymnasium.Env[Any, Any]):
    """Keep a robot with an event camera on its lane.

    ## Observation space
    `observation='state_image'`: Box(0, 1, (16, 32), uint8), 1 where a cell of 4 x 4 pixels had an
    event in the last 0.5 s (the deep Q-network's state). `observation='spike_counts'`:
    Box(0, 256, (4, 8), int64), events of the last step in cells of 16 x 16 pixels (the spiking
    networks' input). `observation='event_image'`: Box(0, 255, (2, 128, 128), uint8), the numbers
    of ON and OFF events of each pixel in the last 0.5 s, at most 255, for convolutional
    networks. `observation='sensors'`: Dict of `events`, the event image, and `wheels`,
    Box((2,), float32), the velocities that the wheels' encoders measure [rad/s], left and right.
    Row 0 of an image is the top one. No events after a reset.

    ## Action space
    `actions='discrete'`: Discrete(3), 0 left, 1 straight, 2 right. `actions='wheels'`: Box of two
    target velocities [rad/s], left and right, up to the robot's limit. An action holds for
    `task.steps_per_action` times `task.step_ms`, 10 times 50 ms by default, whatever
    `simulator.period_ms` is.

    ## Reward
    After each action the sum of the terms in `info['reward_terms']`: `lane_centre`, the normal
    density of the lane distance (paper section 3.3), 2.66 at the centre.

    ## Episode
    Begins at a lane's start: the lane in `reset(options={'lane': ...})`, otherwise the course's
    first after a reset with a seed and then the next in turn. Terminated when the robot is
    farther than `simulator.episode.max_distance_m` from the lane's centre; truncated after
    `task.max_actions` actions. Laps do not end it. It can also be truncated where the robot
    makes no progress: `simulator={'episode.no_progress_steps': 600}`. `info['lane_state'].reason`
    says why the simulator ended an episode.

    ## Copies
    `copy.deepcopy` and `pickle` give an environment with the same future, bit for bit. With the
    engine pybullet this takes as long as its physics took since the last reset.
    """

    metadata: dict[str, Any] = {'render_modes': ['rgb_array'], 'render_fps': 2}  # noqa: RUF012

    def __init__(
        self,
        scenario: str | int = 1,
        observation: str = 'state_image',
        actions: str = 'discrete',
        render_mode: str | None = None,
        simulator: dict[str, Any] | None = None,
        task: dict[str, Any] | None = None,
        filters: dict[str, Any] | None = None,
    ) -> None:
        """Build the environment.

        Args:
            scenario: The paper's 1, 2 or 3, or the name or path of a course file.
            observation: 'state_image', 'spike_counts', 'event_image' or 'sensors'.
            actions: 'discrete' or 'wheels'.
            render_mode: None, or 'rgb_array': the events of the last step.
            simulator: Parameters of `SimulatorParameters`, as `{'robot.engine': 'kinematic'}`.
            task: Parameters of `TaskParameters`.
            filters: Parameters of `FilterParameters`, as `{'chain': 'correlation'}`; what
                events go through before they are observed.

        Raises:
            SpikelaneError: Anything is unknown or not allowed.
        """
        check_choice('observation', observation, tuple(OBSERVATIONS))
        check_choice('actions', actions, ('discrete', 'wheels'))
        if render_mode is not None:
            check_choice('render_mode', render_mode, ('rgb_array',))
        self.render_mode = render_mode
        self._task = TaskParameters.from_mapping(task or {}, 'task')
        parameters = environment_parameters(scenario, simulator or {})
        camera = parameters.camera
        self._stage = FilterStage(
            FilterParameters.from_mapping(filters or {}, 'filters'), camera.width, camera.height
        )
        width, height = self._stage.size
        seen = dataclasses.replace(camera, width=width, height=height)
        self._observed = OBSERVATIONS[observation](dataclasses.replace(parameters, camera=seen))
        self._steps_per_action = parameters.steps_of(
            self._task.steps_per_action, self._task.step_ms
        )
        self._simulator = Simulator(parameters, sensors=self._observed.sensors)
        self.observation_space = self._observed.space
        self.action_space = actions_space(actions, parameters)
        self._is_discrete = actions == 'discrete'
        self._last: Observation | None = None
        self._actions_taken = 0
        self._is_closed = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; see the class.

        Raises:
            SpikelaneError: There is no such option or lane, or the environment is closed.
        """
        self._check_open('reset')
        check_options(options or {})
        super().reset(seed=seed)
        if seed is None and self._last is None:
            seed = int(self.np_random.integers(2**31))
        lane = (options or {}).get('lane')
        self._last = self._stage.observe(self._simulator.reset(lane, seed))
        self._actions_taken = 0
        self._observed.begin(self._last)
        return self._observed.value(), self._info(_lane(self._last))

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Hold an action for some steps; see the class.

        Raises:
            SpikelaneError: Not an action, the episode is over, or the environment is closed.
        """
        self._check_open('step')
        wheels = self._wheels(action)
        for _ in range(self._steps_per_action):
            self._last = self._stage.observe(self._simulator.step(wheels))
            self._observed.add(self._last)
            if _lane(self._last).terminated:
                break
        assert self._last is not None
        self._actions_taken += 1
        lane = _lane(self._last)
        info = self._info(lane)
        terms = {'lane_centre': self.lane_centre_reward(lane.distance_m)}
        info['reward_terms'] = terms
        is_lost, is_truncated = outcome(lane.reason, self._actions_taken, self._task)
        return self._observed.value(), sum(terms.values()), is_lost, is_truncated, info

    def lane_centre_reward(self, distance_m: float) -> float:
        """Return the normal density of the lane distance [m] (paper section 3.3)."""
        reward: float = lane_centre_reward(distance_m, self._task.reward_sigma_m)
        return reward

    def render(self) -> NDArray[np.uint8]:
        """Return the events of the last step, ON blue and OFF red on black, (H, W, 3)."""
        width, height = self._stage.size
        image = np.zeros((height, width, 3), np.uint8)
        if self._last is not None:
            events = self._last.events
            image[events['y'], events['x']] = np.where(
                events['polarity'][:, None] > 0, (0, 64, 255), (255, 64, 0)
            )
        return image

    def close(self) -> None:
        """Release the physics engine; a second call does nothing."""
        self._is_closed = True
        self._simulator.close()

    def _check_open(self, call: str) -> None:
        if self._is_closed:
            raise SpikelaneError(f'environment: expected no call after close, got {call}')

    def _wheels(self, action: Any) -> WheelVelocities:
        if not self._is_discrete:
            action = np.asarray(action, np.float32)
        if not self.action_space.contains(action):
            raise SpikelaneError(f'action: expected one of {self.action_space}, got {action!r}')
        if not self._is_discrete:
            return WheelVelocities(*action.tolist())
        return action_wheels(int(action), self._task)

    def _info(self, lane: LaneState) -> dict[str, Any]:
        return {'lane_state': lane, 'is_success': is_success(lane)}


def environment_parameters(
    scenario: str | int, simulator: Mapping[str, Any]
) -> SimulatorParameters:
    """Return the simulator's parameters of an environment.

    Args:
        scenario: As in `LaneKeepingEnv`.
        simulator: The same.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    values = {'course': scenario_course(scenario), 'episode.max_laps': 0, **simulator}
    return SimulatorParameters.from_mapping(values, 'simulator')


def actions_space(actions: str, parameters: SimulatorParameters) -> spaces.Space[Any]:
    """Return where actions are: 'discrete' ones, or velocities of the 'wheels'."""
    if actions == 'discrete':
        return spaces.Discrete(len(ACTIONS))
    limit = parameters.robot.max_wheel_velocity_rad_s
    return spaces.Box(-limit, limit, (2,), np.float32)


def outcome(reason: str, actions_taken: int, task: TaskParameters) -> tuple[bool, bool]:
    """Return whether an episode is terminated, and whether it is truncated.

    Args:
        reason: Why the simulator ended it, '' where it has not.
        actions_taken: In the episode.
        task: The task.
    """
    is_lost = reason == TERMINATED_LANE_LOST
    is_ended = bool(reason) and not is_lost
    return is_lost, is_ended or actions_taken >= task.max_actions


def is_success(lane: LaneState) -> bool:
    """Return whether the episode has not failed, so far or in the end."""
    return lane.reason not in _FAILURES


def _lane(observation: Observation) -> LaneState:
    assert observation.lane is not None  # the simulator always knows it
    return observation.lane


def check_options(options: Mapping[str, Any]) -> None:
    """Check the options of a reset.

    Raises:
        SpikelaneError: There is one that is unknown, or not a lane's name.
    """
    for name, value in options.items():
        if name != 'lane':
            raise SpikelaneError(f'options: expected lane alone, got {name!r:.80}')
        if value is not None and not isinstance(value, str):
            raise SpikelaneError(f"options: lane: expected a lane's name, got {value!r:.80}")


def check_choice(name: str, value: str, allowed: tuple[str, ...]) -> None:
    """Check an argument that is one of some words.

    Raises:
        SpikelaneError: It is not.
    """
    if value not in allowed:
        raise SpikelaneError(f'{name}: expected {" or ".join(allowed)}, got {value!r}')
