"""How a run's parameters, and those its weights were learnt with, differ from the paper's."""

from __future__ import annotations

from collections.abc import Mapping
import functools
import json
from pathlib import Path
from typing import Any

from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.gathering import GatheringParameters
from spikelane_controllers.registry import controller_class, controller_names
from spikelane_controllers.transfer import TransferParameters
from spikelane_controllers.weights import find_checkpoint
from spikelane_sim.errors import CheckpointError
from spikelane_sim.parameters import Parameters
from spikelane_sim.simulator import SimulatorParameters

#: Settings that say what is done, not how: a run is no variant for them.
_NO_VARIANT = ('course', 'learning', 'checkpoint', 'q_learning.device')
_NO_VARIANT_GROUP = 'episode.'


def scenario_name(config: Mapping[str, Any]) -> str:
    """Return the scenario of the paper, or the name of another course."""
    return Path(str(config['scenario'])).stem.removeprefix('scenario_')


def setting_in_words(config: Mapping[str, Any]) -> str:
    """Say how a run differs from the paper's, the weights it drove with included."""
    own = _variant(config)
    parts = [f'{name} {value}' for name, value in own.items()]
    controller = str(config.get('controller', 'dqn'))
    values = config.get(controller)
    weights = values.get('checkpoint') if isinstance(values, Mapping) else None
    if weights:
        learnt = _learnt_with(controller, str(weights))
        if learnt is None:
            parts.append(f'weights of {weights}')
        else:
            where, variant = learnt
            other = [f'{name} {value}' for name, value in variant if own.get(name) != value]
            parts.extend(['learnt with ' + ', '.join(other)] if other else [])
            if where and where != scenario_name(config):
                parts.append(f'learnt in scenario {where}')
    return '; '.join(parts)


@functools.lru_cache(maxsize=1000)
def _learnt_with(
    controller: str, checkpoint: str
) -> tuple[str, tuple[tuple[str, Any], ...]] | None:
    """Return the scenario and variant that weights were learnt in, None where they are gone."""
    try:
        facts = read_checkpoint(find_checkpoint(controller, checkpoint), controller).facts
    except CheckpointError:
        return None
    config = facts.get('config', {})
    return scenario_name(config) if 'scenario' in config else '', tuple(_variant(config).items())


def _variant(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters that differ from their defaults, the paper's.

    Parameters that one of both lacks are of another version, and no difference.
    """
    found: dict[str, Any] = {}
    for group, values in config.items():
        if isinstance(values, Mapping) and (usual := _defaults(group)) is not None:
            for name, value in usual.items():
                counts = name not in _NO_VARIANT and not name.startswith(_NO_VARIANT_GROUP)
                if counts and name in values and values[name] != value:
                    found[name] = values[name]
    return found


@functools.lru_cache(maxsize=20)
def _defaults(group: str) -> dict[str, Any] | None:
    """Return the defaults of a group of parameters as YAML gives them, None for no such group."""
    others: dict[str, type[Parameters]] = {
        'simulator': SimulatorParameters,
        'gathering': GatheringParameters,
        'transfer': TransferParameters,
    }
    is_controller = group in controller_names()
    cls = controller_class(group).parameters_class if is_controller else others.get(group)
    if cls is None:
        return None
    plain: dict[str, Any] = json.loads(json.dumps(cls().to_dict(), default=list))
    return plain
