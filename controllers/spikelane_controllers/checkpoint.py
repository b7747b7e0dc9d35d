"""Checkpoints: everything a learning controller is, in a form that any program can read.

A checkpoint is one safetensors file; the values that are not arrays are JSON in its header. A
`.json` file next to it repeats them for people. Only the safetensors file is ever read
back, so that the two cannot disagree. It contains no pickle.
"""

from __future__ import annotations

from collections.abc import Mapping
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.errors import CheckpointChoiceError, CheckpointError
from spikelane_sim.files import write_bytes_atomically, write_text_atomically
from spikelane_sim.parsing import parse_json, ParseError

Arrays = Mapping[str, NDArray[Any]]

FORMAT = 'spikelane-checkpoint'
VERSION = 1
_HEADER = 'spikelane'


class Checkpoint(NamedTuple):
    """What a checkpoint holds."""

    arrays: dict[str, NDArray[Any]]
    facts: dict[str, Any]  # JSON-compatible


def write_checkpoint(
    path: Path, controller: str, arrays: Arrays, facts: Mapping[str, Any], *, sync: bool = True
) -> None:
    """Write a checkpoint, whole or not at all.

    Args:
        path: Ending in .safetensors; the .json is written next to it.
        controller: Name of the controller it is of.
        arrays: By name, of plain numbers.
        facts: Everything else, as a JSON-compatible dict.
        sync: As in `files.write_bytes_atomically`.

    Raises:
        FileError: It cannot be written.
    """
    from safetensors.numpy import save

    head = {'format': FORMAT, 'version': VERSION, 'controller': controller, 'facts': dict(facts)}
    contiguous = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    content = save(contiguous, metadata={_HEADER: json.dumps(head, allow_nan=False)})
    write_bytes_atomically(path, content, sync=sync)
    if sync:  # for people, who look when it is over
        write_text_atomically(path.with_suffix('.json'), json.dumps(head, indent=2) + '\n')


def checkpoint_file(path: Path) -> Path:
    """Return the file of a checkpoint that is named by it or by the folder it is in."""
    return path / 'checkpoint.safetensors' if path.is_dir() else path


def read_checkpoint(path: Path, controller: str) -> Checkpoint:
    """Read a checkpoint.

    Args:
        path: The safetensors file, or a folder that has `checkpoint.safetensors`.
        controller: Name of the controller it must be of.

    Raises:
        CheckpointError: It is not there, truncated, of another program, controller or version,
            or has numbers that are not finite; the message says which.
    """
    file = checkpoint_file(path)
    arrays, metadata = _read_safetensors(file)
    head = _head(file, metadata)
    for name, expected in (
        ('format', FORMAT),
        ('version', VERSION),
        ('controller', controller),
    ):
        if head.get(name) != expected:
            raise CheckpointChoiceError(
                f'{file}: expected {name} {expected}, got {head.get(name)!s:.80}'
            )
    for name, array in arrays.items():
        if array.dtype.kind == 'f' and not np.isfinite(array).all():
            raise CheckpointError(f'{file}: {name}: expected finite numbers, got NaN or infinity')
    facts = head.get('facts', {})
    if not isinstance(facts, dict):
        raise CheckpointError(f'{file}: facts: expected a mapping, got {facts!r:.80}')
    return Checkpoint(arrays, facts)


def _read_safetensors(file: Path) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    from safetensors import safe_open, SafetensorError

    try:
        with safe_open(file, framework='numpy') as opened:
            arrays = {name: opened.get_tensor(name) for name in opened.keys()}  # noqa: SIM118
            return arrays, opened.metadata() or {}
    except FileNotFoundError:
        raise CheckpointChoiceError(
            f'{file}: expected a checkpoint, got none: no such file'
        ) from None
    except (SafetensorError, OSError) as error:
        raise CheckpointError(
            f'{file}: expected a whole safetensors file, got one that cannot be read: {error}'
        ) from None


def _head(file: Path, metadata: Mapping[str, str]) -> dict[str, Any]:
    try:
        head = parse_json(metadata.get(_HEADER, '{}'))
    except ParseError as error:
        raise CheckpointError(f'{file}: header: {error}') from None
    if not isinstance(head, dict) or not head:
        raise CheckpointChoiceError(
            f'{file}: expected a checkpoint of Spikelane, got another file'
        )
    return head
