"""The experience buffer: the last transitions, their binary states packed eight to a byte."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.saved_state import array, SavedState
from spikelane_sim.compiled import inner


class Batch(NamedTuple):
    """Transitions."""

    states: NDArray[np.uint8]  # binary, (n, n_inputs)
    actions: NDArray[np.int64]  # (n,)
    rewards: NDArray[np.float32]  # (n,)
    next_states: NDArray[np.uint8]  # binary, (n, n_inputs)
    is_final: NDArray[np.bool_]  # nothing is to be gained after next_state, (n,)


class Transitions(NamedTuple):
    """Where a buffer keeps its transitions; rows are transitions.

    Attributes:
        states: Binary, eight inputs to a byte, (size, ceil(n_inputs / 8)).
        next_states: The same.
        actions: (size,).
        rewards: (size,).
        is_final: 1 where nothing is to be gained after next_state, (size,).
    """

    states: NDArray[np.uint8]
    next_states: NDArray[np.uint8]
    actions: NDArray[np.uint8]
    rewards: NDArray[np.float32]
    is_final: NDArray[np.uint8]


@numba.njit(cache=True)
def put(  # type: ignore[no-untyped-def]
    transitions, added, state, action, reward, next_state, is_final
):
    """Add a transition to those added before; see `Replay.add`."""
    place = added % len(transitions.actions)
    _pack(state, transitions.states[place])
    _pack(next_state, transitions.next_states[place])
    transitions.actions[place] = action
    transitions.rewards[place] = reward
    transitions.is_final[place] = is_final


@inner
def _pack(state, packed):  # type: ignore[no-untyped-def]
    """Pack eight inputs to a byte, the first one highest, as `np.packbits` does."""
    for k in range(len(packed)):
        byte = 0
        for bit in range(8 * k, min(8 * k + 8, len(state))):
            if state[bit]:
                byte |= 128 >> (bit - 8 * k)
        packed[k] = byte


class Replay:
    """A ring of transitions; the oldest makes place for the newest.

    Args:
        size: How many it keeps.
        n_inputs: Number of inputs in a state.

    Attributes:
        added: How many were added, those that made place included.
        transitions: What it keeps; not to be written to.
    """

    def __init__(self, size: int, n_inputs: int) -> None:
        packed = -(-n_inputs // 8)
        self._n_inputs = n_inputs
        self.added = 0
        self.transitions = Transitions(
            states=np.zeros((size, packed), np.uint8),
            next_states=np.zeros((size, packed), np.uint8),
            actions=np.zeros(size, np.uint8),
            rewards=np.zeros(size, np.float32),
            is_final=np.zeros(size, np.uint8),
        )

    def __len__(self) -> int:
        """Return how many transitions there are."""
        return min(self.added, len(self.transitions.actions))

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
        put(self.transitions, self.added, state, action, reward, next_state, is_final)
        self.added += 1

    def draw(self, size: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Draw rows of transitions, each equally likely, perhaps more than once."""
        return rng.integers(len(self), size=size)

    def sample(self, size: int, rng: np.random.Generator) -> Batch:
        """Return the transitions that `draw` draws."""
        drawn, kept = self.draw(size, rng), self.transitions
        return Batch(
            self._unpacked(kept.states[drawn]),
            kept.actions[drawn].astype(np.int64),
            kept.rewards[drawn],
            self._unpacked(kept.next_states[drawn]),
            kept.is_final[drawn].astype(np.bool_),
        )

    def state(self) -> SavedState:
        """Return a copy of all of it but how many were added, which is given to `restore`."""
        return {f'replay.{name}': kept.copy() for name, kept in self.transitions._asdict().items()}

    def restore(self, state: Mapping[str, Any], added: int) -> None:
        """Become what `state` returned.

        Raises:
            CheckpointError: An array is missing, or of another shape or type.
        """
        arrays = {
            name: array(state, name, like.dtype, like.shape) for name, like in self.state().items()
        }
        for name, kept in self.transitions._asdict().items():
            kept[:] = arrays[f'replay.{name}']
        self.added = added

    def _unpacked(self, packed: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return np.unpackbits(packed, axis=1, count=self._n_inputs)
