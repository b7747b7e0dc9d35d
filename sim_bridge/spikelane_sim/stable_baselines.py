"""Gymnasium's vectors of environments for Stable-Baselines3.

Stable-Baselines3 takes vectors of its own kind, `VecEnv`, alone, and neither it nor Gymnasium has
an adapter (DLR-RM/stable-baselines3#1745). The differences: observations of ended episodes are in
`terminal_observation`, truncation in `TimeLimit.truncated`, and infos are a list of dicts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.wrappers.vector import DictInfoToList
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.errors import ParameterError

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError:
    raise ImportError(
        'spikelane_sim.stable_baselines: expected Stable-Baselines3, which is not installed: '
        "pip install 'spikelane[sb3]'"
    ) from None


class VectorEnvAdapter(VecEnv):
    """A vector of Gymnasium's, as `gymnasium.make_vec` returns it, as one of Stable-Baselines3.

    Attributes:
        environments: The vector.
    """

    def __init__(self, environments: VectorEnv[Any, Any, Any]) -> None:
        """Take over a vector.

        Args:
            environments: It must reset an environment in the step that ends its episode:
                `autoreset_mode='SameStep'`.

        Raises:
            ParameterError: It resets at another time.
        """
        mode = environments.metadata.get('autoreset_mode')
        if mode != AutoresetMode.SAME_STEP:
            raise ParameterError(
                f'autoreset_mode: expected {AutoresetMode.SAME_STEP.value}, as Stable-Baselines3 '
                f'has it, got {getattr(mode, "value", mode)}'
            )
        super().__init__(
            environments.num_envs,
            environments.single_observation_space,
            environments.single_action_space,
        )
        self.environments = environments
        self._listed = DictInfoToList(environments)
        self._actions: NDArray[Any] | None = None

    def reset(self) -> Any:
        """Begin an episode in every environment; see `VecEnv`.

        Raises:
            ParameterError: The environments are given different options.
        """
        first, *others = self._options
        if any(options != first for options in others):
            raise ParameterError('options: expected the same for all environments, got several')
        # Gymnasium's vectors take a seed for each environment, which its wrappers do not say.
        seeds: Any = None if self._seeds[0] is None else list(self._seeds)
        observations, self.reset_infos = self._listed.reset(seed=seeds, options=first or None)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take over the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Take the step; return observations, rewards, whether episodes ended, and infos."""
        observations, rewards, terminated, truncated, found = self._listed.step(self._actions)
        dones = np.logical_or(terminated, truncated)
        infos: list[dict[str, Any]] = [dict(info) for info in found]
        for number in np.flatnonzero(dones).tolist():
            info = infos[number]
            # An info after a reset is that of the reset; what ended the episode is in it.
            info.update(info.pop('final_info', {}))
            info['terminal_observation'] = info.pop('final_obs')
        for info, is_truncated, is_terminated in zip(infos, truncated, terminated, strict=True):
            info['TimeLimit.truncated'] = bool(is_truncated and not is_terminated)
        return observations, np.asarray(rewards, np.float32), dones, infos

    def close(self) -> None:
        """End the environments."""
        self.environments.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the vector, once for each environment."""
        # The base asks for `render_mode` while it is made: there is none.
        is_made = 'environments' in vars(self)
        value = getattr(self.environments, attr_name) if is_made else None
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: the environments have no attributes of their own.

        Raises:
            ParameterError: Always.
        """
        del value, indices
        raise ParameterError(f'{attr_name}: expected single environments, got those of a kernel')

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Refuse: the environments have no methods of their own.

        Raises:
            ParameterError: Always.
        """
        del method_args, indices, method_kwargs
        raise ParameterError(f'{method_name}: expected single environments, got those of a kernel')

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """Return that no environment is wrapped."""
        del wrapper_class
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return no images."""
        return [None] * self.num_envs
