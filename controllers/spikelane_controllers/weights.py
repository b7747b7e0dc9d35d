"""Learnt weights: those shipped in this package by name, others by the path of a checkpoint.

A file of weights is a checkpoint (`checkpoint.py`) that holds nothing else, with the command that
made them. Weights can be read from any checkpoint of the same controller.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spikelane_controllers.checkpoint import read_checkpoint, write_checkpoint
from spikelane_controllers.q_network import QNetwork
from spikelane_controllers.registry import CONTROLLERS
from spikelane_controllers.state import array
from spikelane_sim.errors import CheckpointChoiceError, CheckpointError

#: Names in a checkpoint of what a controller drives with: its network's weights.
WEIGHTS = 'controller.network.weights_pa'  # of R-STDP, in pA
Q_NETWORK = tuple(f'controller.network.{name}' for name in QNetwork._fields)
#: And of what its targets come from while it learns, a running average.
TARGET_NETWORK = tuple(f'controller.target.{name}' for name in QNetwork._fields)
_NAMES: Mapping[str, tuple[str, ...]] = {'rstdp': (WEIGHTS,), 'dqn': Q_NETWORK + TARGET_NETWORK}

_SHIPPED = Path(__file__).parent / 'weights'


def shipped_weights(controller: str) -> tuple[str, ...]:
    """Return the names of the weights that are shipped for a controller."""
    names = (path.stem for path in _SHIPPED.glob(f'{controller}_*.safetensors'))
    # Those of `dqn_snn` are not the `snn_...` of `dqn`.
    longer = tuple(f'{name}_' for name in CONTROLLERS if name.startswith(f'{controller}_'))
    own = (name for name in names if not name.startswith(longer))
    return tuple(sorted(name.removeprefix(f'{controller}_') for name in own))


def find_checkpoint(controller: str, name: str) -> Path:
    """Return where weights are.

    Args:
        controller: Name of the controller.
        name: Name of shipped weights, or path of a training's folder or of a checkpoint.

    Raises:
        CheckpointError: There is neither.
    """
    shipped = shipped_weights(controller)
    if name in shipped:
        return _SHIPPED / f'{controller}_{name}.safetensors'
    if not Path(name).exists():
        raise CheckpointChoiceError(
            f"checkpoint: expected one of {', '.join(shipped)}, or the path of a training's "
            f'folder or of a checkpoint, got {name!r}'
        )
    return Path(name)


def read_weights(
    controller: str, name: str, shape: tuple[int, int], low_pa: float, high_pa: float
) -> NDArray[np.float64]:
    """Read weights [pA].

    Args:
        controller: Name of the controller they must be of.
        name: As in `find_checkpoint`.
        shape: (n_neurons, n_inputs) that they must have.
        low_pa: Smallest allowed.
        high_pa: Largest allowed.

    Raises:
        CheckpointError: There are none, or others; the message names the file, what was expected
            and what came.
    """
    file = find_checkpoint(controller, name)
    arrays = read_checkpoint(file, controller).arrays
    try:
        weights_pa = array(arrays, WEIGHTS, np.dtype(np.float64), shape)
    except CheckpointError as error:
        raise CheckpointError(f'{file}: {error}') from None
    if weights_pa.size and not low_pa <= weights_pa.min() <= weights_pa.max() <= high_pa:
        raise CheckpointError(
            f'{file}: {WEIGHTS}: expected from {low_pa:g} to {high_pa:g} pA, '
            f'got from {weights_pa.min():g} to {weights_pa.max():g} pA'
        )
    return weights_pa


def read_network(
    controller: str, name: str, like: QNetwork, parts: tuple[str, ...] = Q_NETWORK
) -> QNetwork:
    """Read a Q-network.

    Args:
        controller: Name of the controller it must be of.
        name: As in `find_checkpoint`.
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


def export_weights(controller: str, checkpoint: Path, path: Path, command: str) -> None:
    """Write the weights alone of a training, to be shipped.

    Args:
        controller: Name of the controller.
        checkpoint: The training's folder, or its checkpoint.
        path: File to write, ending in .safetensors.
        command: The command that makes this training.

    Raises:
        CheckpointError: The checkpoint cannot be read, or is of another controller.
        FileError: The weights cannot be written.
    """
    arrays, facts = read_checkpoint(checkpoint, controller)
    names = _NAMES[controller]
    if not set(names) <= set(arrays) or 'config' not in facts:
        raise CheckpointChoiceError(f'{checkpoint}: expected the checkpoint of a training')
    about = {'command': command, 'config': facts['config'], 'steps': facts.get('steps')}
    write_checkpoint(path, controller, {name: arrays[name] for name in names}, about)
