"""What a transfer leaves: a network that has learnt a policy, and itself normalised to spike.

A checkpoint (`../checkpoint.py`) with the weights of both and the scale of the inputs. With the
weights that are shipped, the command that made them is told.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from spikelane_controllers.checkpoint import read_checkpoint, write_checkpoint
from spikelane_controllers.dqn_snn.feedforward import FeedForward
from spikelane_controllers.dqn_snn.normalisation import largest_input
from spikelane_controllers.saved_state import array, mapping, number
from spikelane_controllers.weights import find_checkpoint
from spikelane_sim.errors import CheckpointChoiceError, CheckpointError
from spikelane_sim.period import PERIOD_MS

CONTROLLER = 'dqn_snn'

#: Prefixes of a checkpoint's arrays: the weights as trained, and those of the spiking network.
_TRAINED, _SPIKING = 'ann', 'network'


class InputScale(NamedTuple):
    """How counts of events became the values of the inputs that the network was trained on."""

    frames: int  # frames that a count is over
    maximum: int  # count that makes a value of 1; more makes no more
    frame_ms: int = PERIOD_MS  # length of a frame; older checkpoints do not have it


class Transferred(NamedTuple):
    """A policy that can spike."""

    network: FeedForward  # normalised
    scale: InputScale


def write_transferred(
    path: Path, ann: FeedForward, transferred: Transferred, facts: Mapping[str, Any]
) -> None:
    """Write a transfer's networks.

    Args:
        path: Ending in .safetensors; a .json is written next to it.
        ann: As it was trained.
        transferred: The same, normalised.
        facts: More about it, as a JSON-compatible dict.

    Raises:
        FileError: It cannot be written.
    """
    arrays = {
        f'{prefix}.{name}': values
        for prefix, network in ((_TRAINED, ann), (_SPIKING, transferred.network))
        for name, values in network._asdict().items()
    }
    write_checkpoint(path, CONTROLLER, arrays, {**transferred.scale._asdict(), **facts})


def read_transferred(name: str, inputs: int, outputs: int) -> Transferred:
    """Read the network of a transfer that spikes.

    Args:
        name: Name of shipped ones, or path of a transfer's folder or of a checkpoint.
        inputs: How many the network must have.
        outputs: How many it must have.

    Raises:
        CheckpointError: There are none, or others; the message names the file, what was expected
            and what came.
    """
    file = find_checkpoint(CONTROLLER, name)
    arrays, facts = read_checkpoint(file, CONTROLLER)
    try:
        network = _network(arrays, inputs, outputs)
        facts = {**InputScale._field_defaults, **facts}
        scale = InputScale(*(_count(facts, field) for field in InputScale._fields))
        if facts.get('normalisation', 'model') == 'model':
            _check_normalised(network)
    except CheckpointError as error:
        raise CheckpointError(f'{file}: {error}') from None
    return Transferred(network, scale)


def export_transferred(checkpoint: Path, path: Path, command: str) -> None:
    """Write the spiking network alone of a transfer, to be shipped.

    Args:
        checkpoint: The transfer's folder, or its checkpoint.
        path: File to write, ending in .safetensors.
        command: The command that makes this transfer.

    Raises:
        CheckpointError: The checkpoint cannot be read, or is of another controller.
        FileError: The network cannot be written.
    """
    arrays, facts = read_checkpoint(checkpoint, CONTROLLER)
    config = mapping(facts, 'config')
    if not isinstance(config.get('checkpoint'), str):
        raise CheckpointChoiceError(f'{checkpoint}: expected the checkpoint of a transfer')
    spiking = {name: each for name, each in arrays.items() if name.startswith(f'{_SPIKING}.')}
    # The path on the machine that made it is of no use elsewhere: only the folder's name is kept.
    config |= {'checkpoint': Path(config['checkpoint']).name}
    write_checkpoint(path, CONTROLLER, spiking, {**facts, 'config': config, 'command': command})


def _network(arrays: Mapping[str, Any], inputs: int, outputs: int) -> FeedForward:
    single = np.dtype(np.float32)
    bias = array(arrays, f'{_SPIKING}.hidden_bias', single)
    hidden = len(bias)
    return FeedForward(
        array(arrays, f'{_SPIKING}.hidden_weights', single, (hidden, inputs)),
        bias,
        array(arrays, f'{_SPIKING}.output_weights', single, (outputs, hidden)),
    )


def _count(facts: Mapping[str, Any], name: str) -> int:
    value: int = number(facts, name, int)
    if value < 1:
        raise CheckpointError(f'{name}: expected a whole number of at least 1, got {value}')
    return value


def _check_normalised(network: FeedForward) -> None:
    """A neuron must not need to fire twice in a time step."""
    for name, weights, bias in (
        ('hidden_weights', network.hidden_weights, network.hidden_bias),
        ('output_weights', network.output_weights, None),
    ):
        largest = largest_input(weights, bias)
        if largest > 1:
            raise CheckpointError(
                f'{_SPIKING}.{name}: expected normalised weights, got a sum of {largest:g}'
            )
