"""How a run's parameters, and those its weights were learnt with, differ from the paper's."""

from __future__ import annotations

from collections.abc import Mapping
import functools
import json
from pathlib import Path
from typing import Any, NamedTuple

from spikelane.experiment.plan import RUN_FILE
from spikelane.report.kinds import LearntFacts
from spikelane.runs.configuration import step_limits
from spikelane.runs.input_files import transferred_controller
from spikelane.runs.lap.config import LIMITS
from spikelane.runs.train.config import training_defaults
from spikelane.runs.transfer.config import source_of
from spikelane_controllers.checkpoint import read_checkpoint
from spikelane_controllers.learning.training import INPUTS
from spikelane_controllers.registry import (
    controller_class,
    controller_names,
    transfer_class,
    transfer_names,
)
from spikelane_controllers.weights import find_checkpoint
from spikelane_sim.errors import CheckpointError
from spikelane_sim.filters import FilterParameters
from spikelane_sim.kinds import check_kind
from spikelane_sim.parameters import grouped, Parameters
from spikelane_sim.simulator_parameters import (
    current_config,
    period_ms_of,
    SimulatorParameters,
)

#: Settings that say what is done, not how: a run is no variant for them.
_NO_VARIANT = ('course', 'checkpoint', 'q_learning.device')

#: Between the name of a file and the first digits of its digest.
_DIGEST, _DIGITS = ' (SHA-256 ', 8


def scenario_name(config: Mapping[str, Any]) -> str:
    """Return the scenario of the paper, or the name or path of another course."""
    name = str(config['scenario'])
    return name if Path(name).suffix or Path(name).parent.name else name.removeprefix('scenario_')


class Setting(NamedTuple):
    """How a run differs from the paper's.

    Attributes:
        setting: What differs in words, the weights it drove with included; '' where nothing does.
        learnt_steps: Steps of the training that its weights are of, None where there is none or
            it is not known.
    """

    setting: str
    learnt_steps: int | None


def setting_of(config: Mapping[str, Any], folder: Path) -> Setting:
    """Describe a run.

    Args:
        config: What determined it.
        folder: Where it is.
    """
    own = _variant(config)
    parts = [f'{name} {value}' for name, value in own.items()]
    weights = _weights_of(config)
    if weights is None:
        return Setting('; '.join(parts), None)
    learnt = _learnt_with(*weights, folder)
    if learnt is None:
        return Setting('; '.join([*parts, f'weights of {weights.checkpoint}']), None)
    other = [
        f'{name} {value}' for name, value in learnt.variant if _is_other(own.get(name), value)
    ]
    parts.extend(['learnt with ' + ', '.join(other)] if other else [])
    if learnt.scenario and learnt.scenario != scenario_name(config):
        parts.append(f'learnt in scenario {learnt.scenario}')
    return Setting('; '.join(parts), learnt.steps)


class _Weights(NamedTuple):
    controller: str
    checkpoint: str


def _weights_of(config: Mapping[str, Any]) -> _Weights | None:
    """Return what a run drove with, or a transfer began with, None for nothing learnt."""
    if 'transfer' in config:
        return _Weights(source_of(transferred_controller(config)), str(config['checkpoint']))
    checkpoint = checkpoint_of(config)
    return _Weights(str(config.get('controller', '')), checkpoint) if checkpoint else None


def checkpoint_of(config: Mapping[str, Any]) -> str:
    """Return the checkpoint that a controller drove with, '' for none given."""
    values = config.get(str(config.get('controller', '')))
    return str(values.get('checkpoint') or '') if isinstance(values, Mapping) else ''


class _Learnt(NamedTuple):
    """What weights come of."""

    scenario: str  # '' where it is not known
    variant: tuple[tuple[str, Any], ...]
    steps: int | None


@functools.lru_cache(maxsize=1000)
def _learnt_with(controller: str, checkpoint: str, folder: Path) -> _Learnt | None:
    """Return what a run's weights come of, None where they are gone.

    For transferred weights the training before the transfer counts, too.
    """
    place = checkpoint if Path(checkpoint).exists() else _moved(checkpoint, folder)
    try:
        facts = read_checkpoint(find_checkpoint(controller, place), controller).facts
    except CheckpointError:
        return None
    check_kind(facts, LearntFacts)
    config = current_config(facts.get('config', {}))
    scenario = scenario_name(config) if 'scenario' in config else ''
    variant, steps = _variant(config), facts.get('steps')
    if 'transfer' in config:
        steps = None
        source = source_of(transferred_controller(config))
        before = _learnt_with(source, str(config['checkpoint']), folder)
        if before is not None:
            variant, steps = {**dict(before.variant), **variant}, before.steps
    return _Learnt(scenario, tuple(variant.items()), steps)


def _moved(checkpoint: str, folder: Path) -> str:
    """Return where a checkpoint is whose experiment's folder was moved, or what was given."""
    name = Path(checkpoint).name
    # A lap of an evaluation is in a folder of the evaluation's.
    neighbours = (parent / name for parent in folder.parents[:3])
    return next((str(path) for path in neighbours if (path / RUN_FILE).exists()), checkpoint)


def _is_other(own: Any, learnt: Any) -> bool:
    """Return whether weights were learnt with another value than a run's own.

    A file without a digest is of a version that kept none, and no difference.
    """
    return bool(own != learnt) and str(own).partition(_DIGEST)[0] != learnt


def _variant(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters that differ from their defaults, the paper's.

    Parameters that one of both lacks are of another version, and no difference. A file has the
    digest of its content, so that runs before and after a change of the file are told apart.
    """
    found: dict[str, Any] = {}
    digests = config.get(INPUTS)
    if not isinstance(digests, Mapping):
        digests = {}
    for group, values in config.items():
        if isinstance(values, Mapping) and (usual := _defaults(group)) is not None:
            usual = {**usual, **_chosen(group, values), **_usual_in(config, group)}
            for name, value in usual.items():
                if name not in _NO_VARIANT and name in values and values[name] != value:
                    value = values[name]
                    if isinstance(value, str) and value in digests:
                        value = f'{value}{_DIGEST}{str(digests[value])[:_DIGITS]})'
                    found[f'filter.{name}' if group == 'filter' else name] = value
    if config.get('from_training') is False:
        found['from_training'] = False
    return found


def _chosen(group: str, values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the defaults of a group that depend on other values, as on which robot it is."""
    return SimulatorParameters.chosen_defaults(values) if group == 'simulator' else {}


def _usual_in(config: Mapping[str, Any], group: str) -> dict[str, Any]:
    """Return what is usual for a group in this kind of run, where that is not the default."""
    usual: Mapping[str, Any]
    if 'transfer' in config:
        usual = transfer_class(transferred_controller(config)).defaults
    elif 'training' in config or 'save_every' in config:  # a checkpoint's has its length aside
        usual = training_defaults(str(config['controller']))
        usual = {**usual, **step_limits(usual, period_ms_of(config))}
    elif group == 'simulator' and isinstance(given := config.get('given'), Mapping):
        # Laps and evaluations have limits of their own unless the user gives others. Runs of
        # earlier versions do not say what was given.
        values = config['simulator']
        return {
            name: values[name]
            for name in LIMITS
            if name in values and f'simulator.{name}' not in given
        }
    else:
        return {}
    return grouped(usual).get(group, {})


@functools.lru_cache(maxsize=20)
def _defaults(group: str) -> dict[str, Any] | None:
    """Return the defaults of a group of parameters as YAML gives them, None for no such group."""
    others: dict[str, type[Parameters]] = {
        'simulator': SimulatorParameters,
        'filter': FilterParameters,
    }
    for name in transfer_names():
        others |= transfer_class(name).parameters_classes
    is_controller = group in controller_names()
    cls = controller_class(group).parameters_class if is_controller else others.get(group)
    if cls is None:
        return None
    plain: dict[str, Any] = json.loads(json.dumps(cls().to_dict(), default=list))
    return plain
