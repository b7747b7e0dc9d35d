"""The files that a configuration names: what is in them determines a run, as the names do not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import hashlib
from pathlib import Path
from typing import Any

from spikelane_controllers.checkpoint import checkpoint_file
from spikelane_controllers.registry import card, transfer_names
from spikelane_controllers.weights import find_checkpoint
from spikelane_sim.errors import CheckpointError
from spikelane_sim.robots.own import ENDING


def input_digests(configuration: Mapping[str, Any]) -> dict[str, str]:
    """Return the SHA-256 of the files that a configuration names, by these names.

    These are course files, URDFs, weights, masks of hot pixels and calibrations of cameras.

    Names of shipped courses and of what is not there yet are left out.

    Args:
        configuration: As a run's `to_dict` gives it.
    """
    return {
        name: hashlib.sha256(file.read_bytes()).hexdigest()
        for name, file in _inputs(configuration)
        if file.is_file()
    }


def _inputs(configuration: Mapping[str, Any]) -> Iterator[tuple[str, Path]]:
    for group in ('simulator', 'evaluation'):
        values = configuration.get(group, {})
        for course in (values.get('course'), *values.get('courses', ())):
            if course:
                yield course, Path(course)
    model = str(configuration.get('simulator', {}).get('robot.model', ''))
    if model.endswith(ENDING):
        yield model, Path(model)
    for name, value in configuration.get('filter', {}).items():
        if name.endswith('file') and value:
            yield value, Path(value)
    weights = {
        name: values['checkpoint']
        for name, values in configuration.items()
        if isinstance(values, Mapping) and values.get('checkpoint')
    }
    if 'transfer' in configuration:
        taken = card(transferred_controller(configuration)).transfer
        if taken is not None:
            weights[taken.source] = configuration['checkpoint']
    for controller, name in weights.items():
        try:
            yield name, checkpoint_file(find_checkpoint(controller, name))
        except CheckpointError:
            continue


def transferred_controller(configuration: Mapping[str, Any]) -> str:
    """Return the controller of a transfer's configuration; the first versions had but one."""
    return str(configuration.get('controller') or transfer_names()[0])
