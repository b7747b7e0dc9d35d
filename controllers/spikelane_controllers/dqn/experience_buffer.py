"""The experience buffer: the last transitions, their binary states packed eight to a byte."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.saved_state import array, SavedState


class Batch(NamedTuple):
    """Transitions."""

    states: NDArray[np.uint8]  # binary, (n, n_inputs)
    actions: NDArray[np.int64]  # (n,)
    rewards: NDArray[np.float32]  # (n,)
    next_states: NDArray[np.uint8]  # binary, (n, n_inputs)
    is_final: NDArray[np.bool_]  # nothing is to be gained after next_state, (n,)


class Replay:
    """A ring of transitions; the oldest makes place for the newest.

    Args:
        size: How many it keeps.
        n_inputs: Number of inputs in a state.
    """

    def __init__(self, size: int, n_inputs: int) -> None:
        packed = -(-n_inputs // 8)
        self._n_inputs = n_inputs
        self._added = 0
        self._states: NDArray[np.uint8] = np.zeros((size, packed), np.uint8)
        self._next_states: NDArray[np.uint8] = np.zeros((size, packed), np.uint8)
        self._actions: NDArray[np.uint8] = np.zeros(size, np.uint8)
        self._rewards: NDArray[np.float32] = np.zeros(size, np.float32)
        self._is_final: NDArray[np.uint8] = np.zeros(size, np.uint8)

    def __len__(self) -> int:
        """Return how many transitions there are."""
        return min(self._added, len(self._actions))

    def add(
        self,
        state: NDArray[np.uint8],
        action: int,
        reward: float,
        next_state: NDArray[np.uint8],
        *,
        is_final: bool,
    ) -> None:
        """Add a transition between binary states (n_inputs,)."""
        place = self._added % len(self._actions)
        self._states[place] = np.packbits(state)
        self._next_states[place] = np.packbits(next_state)
        self._actions[place] = action
        self._rewards[place] = reward
        self._is_final[place] = is_final
        self._added += 1

    def sample(self, size: int, rng: np.random.Generator) -> Batch:
        """Draw transitions, each equally likely, perhaps more than once."""
        drawn = rng.integers(len(self), size=size)
        return Batch(
            self._unpacked(self._states[drawn]),
            self._actions[drawn].astype(np.int64),
            self._rewards[drawn],
            self._unpacked(self._next_states[drawn]),
            self._is_final[drawn].astype(np.bool_),
        )

    def state(self) -> SavedState:
        """Return a copy of all of it but how many were added, which is given to `restore`."""
        return {
            'replay.states': self._states.copy(),
            'replay.next_states': self._next_states.copy(),
            'replay.actions': self._actions.copy(),
            'replay.rewards': self._rewards.copy(),
            'replay.is_final': self._is_final.copy(),
        }

    def restore(self, state: Mapping[str, Any], added: int) -> None:
        """Become what `state` returned.

        Raises:
            CheckpointError: An array is missing, or of another shape or type.
        """
        arrays = {
            name: array(state, name, like.dtype, like.shape) for name, like in self.state().items()
        }
        self._states = arrays['replay.states']
        self._next_states = arrays['replay.next_states']
        self._actions = arrays['replay.actions']
        self._rewards = arrays['replay.rewards']
        self._is_final = arrays['replay.is_final']
        self._added = added

    def _unpacked(self, packed: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return np.unpackbits(packed, axis=1, count=self._n_inputs)
