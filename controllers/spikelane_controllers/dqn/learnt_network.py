"""Reads the Q-networks that a training has learnt."""

from __future__ import annotations

from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.dqn.q_network import QNetwork
from spikelane_controllers.saved_state import array
from spikelane_controllers.weights import find_checkpoint
from spikelane_sim.errors import CheckpointError

#: Names in a checkpoint of the arrays of the network that acts.
Q_NETWORK = tuple(f'controller.network.{name}' for name in QNetwork._fields)
#: Names of those of the target network, a running average of it.
TARGET_NETWORK = tuple(f'controller.target.{name}' for name in QNetwork._fields)


def read_network(
    controller: str, name: str, like: QNetwork, parts: tuple[str, ...] = Q_NETWORK
) -> QNetwork:
    """Read a Q-network.

    Args:
        controller: Name of the controller it must be of.
        name: As in `weights.find_checkpoint`.
        like: A network of the shapes that it must have.
        parts: Names of its arrays, Q_NETWORK or TARGET_NETWORK.

    Raises:
        CheckpointError: There is none, or another; the message names the file, what was expected
            and what came.
    """
    file = find_checkpoint(controller, name)
    arrays = read_checkpoint(file, controller).arrays
    try:
        return QNetwork(
            *(
                array(arrays, part, example.dtype, example.shape)
                for part, example in zip(parts, like, strict=True)
            )
        )
    except CheckpointError as error:
        raise CheckpointError(f'{file}: {error}') from None
