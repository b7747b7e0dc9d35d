"""`gymnasium.make_vec('spikelane/LaneKeeping-v0', ...)`: many environments in one kernel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import batch_space
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.contract import LaneState
from spikelane_sim.encoding import EncodingParameters, StateImageParameters
from spikelane_sim.env import (
    actions_space,
    check_choice,
    check_options,
    environment_parameters,
    is_success,
    outcome,
    TaskParameters,
)
from spikelane_sim.env_observations import OBSERVATIONS
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.filters import FilterParameters
from spikelane_sim.fleet.actions import (
    event_images,
    forget,
    hold,
    make_cells,
    make_places,
    state_images,
)
from spikelane_sim.fleet.generators import TEMPLATE
from spikelane_sim.fleet.simulators import SimulatorFleet
from spikelane_sim.fleet.threads import Threads
from spikelane_sim.task import action_wheels, ACTIONS, lane_centre_reward

_ID = 'spikelane/LaneKeeping-v0'


def make_vector_env(
    num_envs: int = 1,
    *,
    threads: int = 1,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    **arguments: Any,
) -> VectorEnv[Any, Any, Any]:
    """Make many environments.

    What the kernel has becomes a `LaneKeepingVectorEnv`. For the rest, as images to be shown, the
    result is a `SyncVectorEnv` of single environments, which does the same but more slowly; a
    warning then says which parameter it is.

    Args:
        num_envs: How many.
        threads: How many threads drive them.
        autoreset_mode: When an environment whose episode is over is reset; see Gymnasium.
        **arguments: Those of `LaneKeepingEnv`.

    Raises:
        SpikelaneError: Anything is unknown or not allowed.
    """
    mode = AutoresetMode(autoreset_mode)
    try:
        return LaneKeepingVectorEnv(num_envs, threads=threads, autoreset_mode=mode, **arguments)
    except NotInKernelError as reason:
        gymnasium.logger.warn(
            f'{_ID}: {num_envs} single environments are stepped one after the other. To have '
            f'them in one kernel: {reason}'
        )
    return SyncVectorEnv(
        [lambda: gymnasium.make(_ID, **arguments)] * num_envs, autoreset_mode=mode
    )


class NotInKernelError(ParameterError):
    """The kernel does not have what is asked for."""


class LaneKeepingVectorEnv(VectorEnv[Any, Any, Any]):
    """Many `LaneKeepingEnv`s, each as it would be alone.

    Observations, rewards and infos are those that `SyncVectorEnv` returns, bit for bit.
    """

    def __init__(
        self,
        num_envs: int,
        *,
        threads: int = 1,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        scenario: str | int = 1,
        observation: str = 'state_image',
        actions: str = 'discrete',
        render_mode: str | None = None,
        simulator: Mapping[str, Any] | None = None,
        task: Mapping[str, Any] | None = None,
        filters: Mapping[str, Any] | None = None,
    ) -> None:
        """Make the environments; see `LaneKeepingEnv` for what is not said here.

        Args:
            num_envs: How many.
            threads: How many threads drive them.
            autoreset_mode: When an environment whose episode is over is reset.
            scenario: The course.
            observation: What is observed.
            actions: What actions are.
            render_mode: None.
            simulator: Parameters of the simulators. The engines rigid and kinematic are many
                times as fast as all others.
            task: Parameters of the task.
            filters: Parameters of the filters; those that are not compiled are not in the kernel.

        Raises:
            NotInKernelError: The kernel does not have this; the message names the parameter.
            SpikelaneError: Anything is unknown or not allowed.
        """
        check_choice('observation', observation, tuple(OBSERVATIONS))
        check_choice('actions', actions, ('discrete', 'wheels'))
        parameters = environment_parameters(scenario, simulator or {})
        if render_mode is not None:
            raise NotInKernelError(f'render_mode: expected None, got {render_mode}')
        chain = FilterParameters.from_mapping(filters or {}, 'filters')
        try:
            self._fleet = SimulatorFleet(num_envs, parameters, filters=chain)
        except ParameterError as error:
            raise NotInKernelError(str(error)) from None
        self.num_envs = num_envs
        self.metadata = {'autoreset_mode': autoreset_mode, 'render_modes': []}
        self.render_mode = None
        self._mode = autoreset_mode
        self._task = TaskParameters.from_mapping(task or {}, 'task')
        self._kind = observation
        self.single_observation_space = OBSERVATIONS[observation](parameters).space
        self.single_action_space = actions_space(actions, parameters)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        camera = parameters.camera
        window = StateImageParameters(width=camera.width, height=camera.height)
        coarse = EncodingParameters(width=camera.width, height=camera.height)
        frames = parameters.steps_of(window.frames, window.frame_ms)
        self._steps_per_action = parameters.steps_of(
            self._task.steps_per_action, self._task.step_ms
        )
        has_image = observation in ('event_image', 'sensors')
        encoding = coarse if observation == 'spike_counts' else window
        self._cells = make_cells(num_envs, encoding, frames)
        pixels = camera.width * camera.height if has_image else 0
        self._places = make_places(num_envs, frames, pixels)
        self._image_shape = (2, camera.height, camera.width)
        self._threads = Threads(threads, num_envs, self._fleet.world)
        self._wheels_of_actions = np.array(
            [action_wheels(action, self._task) for action in range(len(ACTIONS))]
        )
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._actions_taken = np.zeros(num_envs, np.int64)
        self._is_over: NDArray[np.bool_] = np.zeros(num_envs, np.bool_)

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in each environment, or in those of `options['reset_mask']`.

        Args:
            seed: The first environment's, the others' follow it; or one for each.
            options: `lane` and `reset_mask`.

        Raises:
            SpikelaneError: There is no such option or lane, the environments are closed, or
                there is not a seed for each.
        """
        self._check_open('reset')
        options = dict(options or {})
        mask = options.pop('reset_mask', None)
        check_options(options)
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else seed
        if seeds is not None and len(seeds) != self.num_envs:
            raise SpikelaneError(f'seed: expected {self.num_envs} seeds, got {len(seeds)}')
        chosen = np.ones(self.num_envs, np.bool_) if mask is None else self._mask(mask)
        for i in np.flatnonzero(chosen).tolist():
            self._begin(i, None if seeds is None else seeds[i], options.get('lane'))
        return self._observe(), self._infos(chosen, np.zeros(self.num_envs, np.bool_))

    def step(
        self, actions: Any
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Hold an action in each environment; see `LaneKeepingEnv.step`.

        Raises:
            SpikelaneError: Not actions, an episode is over, or the environments are closed.
        """
        self._check_open('step')
        wheels = self._wheels(actions)
        is_driving = ~self._is_over
        if self._mode == AutoresetMode.DISABLED and not is_driving.all():
            raise SpikelaneError('step: expected environments whose episodes are not over')
        for i in np.flatnonzero(self._is_over).tolist():
            self._begin(i, None, None)
        steps = self._steps_per_action
        self._threads.run(
            lambda first, last, scratch: hold(
                self._fleet.world,
                self._fleet.robots,
                scratch,
                TEMPLATE,
                self._cells,
                self._places,
                wheels,
                is_driving,
                steps,
                first,
                last,
            )
        )
        self._actions_taken += is_driving
        rewards = self._rewards(is_driving)
        lost = np.zeros(self.num_envs, np.bool_)
        truncated = np.zeros(self.num_envs, np.bool_)
        for i, reason in enumerate(self._fleet.reasons()):
            if is_driving[i]:
                taken = int(self._actions_taken[i])
                lost[i], truncated[i] = outcome(reason, taken, self._task)
        self._is_over = np.logical_or(lost, truncated)
        infos = self._infos(np.ones(self.num_envs, np.bool_), is_driving, rewards)
        if self._mode == AutoresetMode.SAME_STEP and self._is_over.any():
            infos = self._begin_ended(infos)
        return self._observe(), rewards, lost, truncated, infos

    def close_extras(self, **_: Any) -> None:
        """End the threads, and release the physics engines."""
        self._threads.close()
        self._fleet.close()

    def _begin(self, i: int, seed: int | None, lane: str | None) -> None:
        """Begin an episode in environment i, as `LaneKeepingEnv.reset` does."""
        if seed is not None or self._generators[i] is None:
            self._generators[i] = gymnasium.utils.seeding.np_random(seed)[0]
        if seed is None and not self._fleet.has_begun(i):
            rng = self._generators[i]
            assert rng is not None
            seed = int(rng.integers(2**31))
        self._fleet.reset(i, lane, seed)
        forget(self._cells, self._places, i)
        self._actions_taken[i] = 0
        self._is_over[i] = False

    def _begin_ended(self, infos: dict[str, Any]) -> dict[str, Any]:
        """Reset what is over within the step; return infos with what was there before."""
        ended = np.flatnonzero(self._is_over).tolist()
        seen = self._observe()
        results: dict[str, Any] = {}
        for i in range(self.num_envs):
            mine = _info_of(infos, i)
            if i in ended:
                final = {'final_obs': _row(seen, i), 'final_info': mine}
                results = self._add_info(results, final, i)
                self._begin(i, None, None)
                mine = _info(self._fleet.lane_state(i))
            results = self._add_info(results, mine, i)
        return results

    def _observe(self) -> Any:
        """Return what is observed now, of all environments."""
        if self._kind == 'state_image':
            return state_images(self._cells)
        if self._kind == 'spike_counts':
            return self._cells.counts.copy()
        images = event_images(self._places, self._image_shape)
        if self._kind == 'event_image':
            return images
        space = self.single_observation_space
        assert isinstance(space, gymnasium.spaces.Dict)
        limits = space['wheels']
        assert isinstance(limits, gymnasium.spaces.Box)
        wheels = self._fleet.wheel_velocities().astype(np.float32)
        return {'events': images, 'wheels': wheels.clip(limits.low, limits.high)}

    def _rewards(self, is_driving: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the rewards; 0 where no action was taken."""
        sigma_m = self._task.reward_sigma_m
        distances_m = self._fleet.robots.known['distance_m'].tolist()
        rewards = [
            lane_centre_reward(distance_m, sigma_m) if driving else 0.0
            for distance_m, driving in zip(distances_m, is_driving.tolist(), strict=True)
        ]
        return np.array(rewards)

    def _infos(
        self,
        chosen: NDArray[np.bool_],
        is_driving: NDArray[np.bool_],
        rewards: NDArray[np.float64] | None = None,
    ) -> dict[str, Any]:
        """Return infos as `VectorEnv._add_info` puts them together."""
        lanes = np.full(self.num_envs, None, object)
        successes = np.zeros(self.num_envs, np.bool_)
        states = self._fleet.lane_states()
        for i in np.flatnonzero(chosen).tolist():
            lanes[i], successes[i] = states[i], is_success(states[i])
        infos: dict[str, Any] = {
            'lane_state': lanes,
            '_lane_state': chosen.copy(),
            'is_success': successes,
            '_is_success': chosen.copy(),
        }
        if rewards is not None and is_driving.any():
            terms = {'lane_centre': rewards.copy(), '_lane_centre': is_driving.copy()}
            infos |= {'reward_terms': terms, '_reward_terms': is_driving.copy()}
        return infos

    def _wheels(self, actions: Any) -> NDArray[np.float64]:
        """Return the wheel velocities of actions [rad/s], (num_envs, 2)."""
        space = self.action_space
        if isinstance(self.single_action_space, gymnasium.spaces.Box):
            actions = np.asarray(actions, np.float32)
        else:
            actions = np.asarray(actions)
            if np.issubdtype(actions.dtype, np.integer):
                actions = actions.astype(np.int64)
        if not space.contains(actions):
            raise SpikelaneError(f'actions: expected one of {space}, got {actions!r:.300}')
        if isinstance(self.single_action_space, gymnasium.spaces.Box):
            return actions.astype(np.float64)  # type: ignore[no-any-return]
        wheels: NDArray[np.float64] = self._wheels_of_actions[actions]
        return wheels

    def _mask(self, mask: Any) -> NDArray[np.bool_]:
        if not (isinstance(mask, np.ndarray) and mask.dtype == np.bool_):
            raise SpikelaneError(f'reset_mask: expected an array of bool, got {mask!r:.100}')
        if mask.shape != (self.num_envs,) or not mask.any():
            raise SpikelaneError(
                f'reset_mask: expected {self.num_envs} values of which at least one is true, '
                f'got {mask!r:.100}'
            )
        return mask

    def _check_open(self, call: str) -> None:
        if self.closed:
            raise SpikelaneError(f'environment: expected no call after close, got {call}')


def _info(lane: LaneState) -> dict[str, Any]:
    return {'lane_state': lane, 'is_success': is_success(lane)}


def _info_of(infos: Mapping[str, Any], i: int) -> dict[str, Any]:
    """Return the info of environment i out of those of all."""
    mine = {}
    for name, values in infos.items():
        if not name.startswith('_') and infos[f'_{name}'][i]:
            # Python's own numbers, as a single environment gives them.
            mine[name] = _info_of(values, i) if isinstance(values, Mapping) else values.tolist()[i]
    return mine


def _row(observations: Any, i: int) -> Any:
    """Return the observation of environment i."""
    if isinstance(observations, dict):
        return {name: values[i] for name, values in observations.items()}
    return observations[i]
