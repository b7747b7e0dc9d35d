"""The command that makes a run, told from what determined it: its `config.yaml`.

The parameters that the user gave are named, whatever made the run: somebody at a terminal, an
experiment, or a script. Versions before `given` was recorded did not say which these were: then
every parameter is named that is not the default of this version.
"""

from __future__ import annotations

from collections.abc import Mapping
import functools
import json
import shlex
from typing import Any

from spikelane.report.runs import Lap, TrainingRun, TransferRun
from spikelane.runs.configuration import Request, RunConfig
from spikelane.runs.input_files import transferred_controller
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.transfer.config import TransferConfig
from spikelane_controllers.registry import transfer_class
from spikelane_sim.parameters import flatten
from spikelane_sim.parsing import parse_yaml
from spikelane_sim.simulator_parameters import SimulatorParameters

#: Parameters that a command has options for, which are always given.
_TOLD = ('simulator.course', 'training.steps')

_FLAGS = {
    'simulator.robot.model': '--robot',
    'simulator.robot.engine': '--engine',
    'simulator.pixels.model': '--pixels',
}


def command_of(run: Lap | TrainingRun | TransferRun) -> str:
    """Return the command that makes a run; of an evaluation's lap, that of the evaluation.

    Raises:
        SpikelaneError: The configuration is one that this version does not allow.
        KeyError: It is of another version, without something that determines a run.
    """
    config = run.config
    if isinstance(run, TrainingRun):
        words = _training(run)
    elif isinstance(run, TransferRun):
        words = _transfer(run)
    else:
        words = _lap(config)
    lacking = sorted(set(_parameters(config)) - set(_usual(_kind(run), *_key(config))))
    note = f'  # of another version, which had {", ".join(lacking)}' if lacking else ''
    return shlex.join(['./spikelane', *words]) + note


def _lap(config: Mapping[str, Any]) -> list[str]:
    driven = config.get('evaluation')
    words = ['lap' if driven is None else 'evaluate', *_what(config)]
    words += ['--controller', config['controller']]
    if driven is None:
        words += ['--lane', config['lane']]
    else:
        words += ['--seeds', str(driven['seeds'])]
        words += ['--lanes', *driven['lanes']] if driven['lanes'] else []
        words += ['--courses', *driven['courses']] if driven['courses'] else []
    return [*words, '--transport', config['transport'], *_others('lap', config)]


def _training(run: TrainingRun) -> list[str]:
    config = run.config
    words = ['train', run.controller, *_what(config)]
    words += ['--steps', str(config.get('training', {}).get('steps', run.results.steps))]
    words += ['--transport', config.get('transport', 'inprocess')]
    return [*words, *_others('training', config), '--out', str(run.folder)]


def _transfer(run: TransferRun) -> list[str]:
    config = run.config
    words = ['transfer', *_what(config), '--controller', run.controller]
    words += ['--checkpoint', config['checkpoint']]
    words.append('--from-training' if config['from_training'] else '--no-from-training')
    return [*words, *_others('transfer', config), '--out', str(run.folder)]


def _what(config: Mapping[str, Any]) -> list[str]:
    # Each lap of an evaluation has its own course; the evaluation has the one it is for.
    scenario = config.get('evaluated_for', config['scenario'])
    return ['--scenario', str(scenario), '--seed', str(config['seed'])]


def _others(kind: str, config: Mapping[str, Any]) -> list[str]:
    """Return the arguments for the parameters that were given."""
    given = config['given'] if 'given' in config else _differing(kind, config)
    words = []
    for name, value in given.items():
        if name in _TOLD:
            continue
        if kind == 'lap' and name == f'{config["controller"]}.checkpoint':
            words += ['--checkpoint', str(value)]
        elif name == 'simulator.camera.antialias':
            words.append('--antialias' if value else '--no-antialias')
        elif name in _FLAGS:
            words += [_FLAGS[name], str(value)]
        else:
            words += ['--param', f'{name}={_text(value)}']
    return words


def _differing(kind: str, config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters that are not the command's defaults."""
    chosen = SimulatorParameters.chosen_defaults(config.get('simulator', {}))
    usual = {**_usual(kind, *_key(config)), **flatten({'simulator': chosen})}
    return {
        name: value
        for name, value in _parameters(config).items()
        if name in usual and value != usual[name]
    }


def _text(value: Any) -> str:
    """Return what is read as this value."""
    plain = str(value)
    is_plain = isinstance(value, str) and parse_yaml(plain) == value
    return plain if is_plain else json.dumps(value)


def _kind(run: Lap | TrainingRun | TransferRun) -> str:
    return {Lap: 'lap', TrainingRun: 'training', TransferRun: 'transfer'}[type(run)]


def _key(config: Mapping[str, Any]) -> tuple[str, str]:
    scenario = str(config.get('evaluated_for', config['scenario']))
    controller = (
        transferred_controller(config) if 'transfer' in config else config.get('controller', '')
    )
    return scenario, str(controller)


def _parameters(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return all parameters under their names; those of a run are in its groups."""
    groups = ['simulator', str(config.get('controller', '')), 'training']
    if 'transfer' in config:
        groups += transfer_class(transferred_controller(config)).parameters_classes
    values = flatten({group: config.get(group, {}) for group in groups})
    return {name: value for name, value in values.items() if name not in _TOLD}


@functools.lru_cache(maxsize=100)
def _usual(kind: str, scenario: str, controller: str) -> dict[str, Any]:
    """Return the parameters that a command has by itself, as YAML gives them."""
    if kind == 'lap':
        config: RunConfig = LapConfig.make(Request(scenario, controller))
    elif kind == 'training':
        config = TrainConfig.make(Request(scenario, controller))
    else:
        config = TransferConfig.plan(Request(scenario, controller), '', False)
    return _parameters(json.loads(json.dumps(config.to_dict(), default=list)))
