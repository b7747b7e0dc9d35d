"""Learnt weights: those shipped with a controller by name, others by the path of a checkpoint.

A file of weights is a checkpoint (`checkpoint.py`) that holds nothing else, with the command that
made them. Weights can be read from any checkpoint of the same controller.
"""

from __future__ import annotations

from pathlib import Path

from spikelane_controllers.checkpoint import read_checkpoint, write_checkpoint
from spikelane_controllers.registry import card
from spikelane_sim.errors import CheckpointChoiceError

_SUFFIX = '.safetensors'


def shipped_weights(controller: str) -> tuple[str, ...]:
    """Return the names of the weights that are shipped for a controller.

    Raises:
        ParameterError: There is no such controller.
    """
    folder = card(controller).weights
    return tuple(sorted(path.stem for path in folder.glob(f'*{_SUFFIX}'))) if folder else ()


def find_checkpoint(controller: str, name: str) -> Path:
    """Return where weights are.

    Args:
        controller: Name of the controller.
        name: Name of shipped weights, or path of a training's folder or of a checkpoint.

    Raises:
        CheckpointError: There is neither.
    """
    shipped = shipped_weights(controller)
    folder = card(controller).weights
    if folder and name in shipped:
        return folder / f'{name}{_SUFFIX}'
    if not Path(name).exists():
        raise CheckpointChoiceError(
            f"checkpoint: expected one of {', '.join(shipped)}, or the path of a training's "
            f'folder or of a checkpoint, got {name!r}'
        )
    return Path(name)


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
    names = card(controller).weight_arrays
    if not set(names) <= set(arrays) or 'config' not in facts:
        raise CheckpointChoiceError(f'{checkpoint}: expected the checkpoint of a training')
    about = {'command': command, 'config': facts['config'], 'steps': facts.get('steps')}
    write_checkpoint(path, controller, {name: arrays[name] for name in names}, about)
