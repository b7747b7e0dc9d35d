"""Whatever is in a damaged file, its readers give a result or one error of Spikelane."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import functools
import json
import os
from pathlib import Path
import struct
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml

from spikelane.experiment.file import read_experiment
from spikelane.experiment.plan import make_plan
from spikelane.experiment.results import experiment_results
from spikelane.experiment.runner import Runner
from spikelane.experiment.worker import read_progress, read_run
from spikelane.figures.robustness import robustness_curves
from spikelane.main import run
from spikelane.report.collect import collect
from spikelane.report.naming import name_settings
from spikelane.report.origin import all_commands, made_with
from spikelane.report.tables import all_tables
from spikelane.runs.configuration import Request
from spikelane.runs.evaluate.config import EvaluateConfig
from spikelane.runs.evaluate.run import evaluate
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.metrics import lap_metrics
from spikelane.runs.lap.trajectory import read_csv
from spikelane.runs.train import run as training
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.transfer.config import TransferConfig
from spikelane_controllers.dqn.visited_states import read_states
from spikelane_controllers.registry import make_controller
from spikelane_sim.course import load_course
from spikelane_sim.errors import SpikelaneError

#: How many files are damaged; more by hand: SPIKELANE_MUTATIONS=20000 pytest ...
_MUTATIONS = int(os.environ.get('SPIKELANE_MUTATIONS', '150'))
_SEED = int(os.environ.get('SPIKELANE_SEED', '1'))

_SHORT = {'simulator.robot.model': 'kinematic', 'simulator.episode.max_steps': 20}
_FLAGS = [word for name, value in _SHORT.items() for word in ('--param', f'{name}={value}')]
_HIDDEN = {'dqn.network.hidden_1': 4, 'dqn.network.hidden_2': 4}
_SMALL = [word for name, value in _HIDDEN.items() for word in ('--param', f'{name}={value}')]
_EXPERIMENT = """
name: tiny
matrix:
  controllers: [braitenberg]
  seeds: [1, 2]
  variants: {short: {simulator.episode.max_steps: 20, simulator.robot.model: kinematic}}
  tasks: {evaluate: {lanes: [outer]}}
"""
_COURSES = Path(__file__).parents[3] / 'sim_bridge/spikelane_sim/courses'

#: What takes the place of a value, as JSON and, where that is another text, as YAML.
_VALUES = (
    ('null', 'null'),
    ('[]', '[]'),
    ('{}', '{}'),
    ('{"a": [1, {"b": null}]}', '{"a": [1, {"b": null}]}'),
    ('"text"', '"text"'),
    ('""', '""'),
    ('"\\u0000/.."', '"\\u0000/.."'),
    (f'"{"a" * 5000}"', f'"{"a" * 5000}"'),
    ('true', 'true'),
    ('0', '0'),
    ('-1', '-1'),
    ('0.5', '0.5'),
    ('1e308', '1.0e+308'),
    (str(2**62), str(2**62)),
    (str(10**30), str(10**30)),
    (str(10**400), str(10**400)),
    ('NaN', '.nan'),
    ('-Infinity', '-.inf'),
    ('1e999', '2001-01-01'),
    ('[' * 10_000 + ']' * 10_000, '[' * 10_000 + ']' * 10_000),
)
_CELLS = ('', 'text', 'nan', '-inf', '1e308', '0.5', '-1', str(2**62), str(10**400), '"', ',')


class Target(NamedTuple):
    """A file, and what reads it."""

    path: Path
    read: Callable[[], object]


def _quiet(*progress: object) -> None:
    del progress


def _report(folder: Path) -> None:
    found = collect([folder])
    name_settings(found)
    all_tables(found)
    all_commands(found)
    made_with(found)
    for conditions in found.conditions:
        with contextlib.suppress(SpikelaneError):
            robustness_curves(conditions.results)


def _resume_training(controller: str, folder: Path) -> None:
    config = TrainConfig.make(Request('1', controller, 1, 'inprocess', _options(controller)), 60)
    training.make_training(config, RunFolder(folder), resume=True)


def _options(controller: str) -> dict[str, Any]:
    return _SHORT | (_HIDDEN if controller == 'dqn' else {})


def _resume_evaluation(folder: Path) -> None:
    config = EvaluateConfig.make(Request('1', 'braitenberg', 1, 'inprocess', _SHORT), {'seeds': 2})
    RunFolder(folder).check_config(config.to_dict())
    evaluate(config, RunFolder(folder), _quiet)


def _resume_experiment(root: Path) -> None:
    plan = make_plan(read_experiment(root.parent / 'tiny.yaml'))
    statuses = list(Runner(plan, root, 0).statuses.values())
    experiment_results(plan.name, statuses)


def _transfer_states(folder: Path) -> None:
    TransferConfig.make(Request('1', 'dqn_snn', 1, parameters={}), str(folder), True)


@pytest.fixture(scope='module')
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of small runs of every kind."""
    folder = tmp_path_factory.mktemp('runs')
    usual = ['--seed', '1', '--json', *_FLAGS]
    (folder / 'tiny.yaml').write_text(_EXPERIMENT)
    (folder / 'course.yaml').write_text((_COURSES / 'scenario_1.yaml').read_text())
    run(['lap', *usual, '--transport', 'inprocess', '--out', f'{folder}/lap'])
    for arguments in (
        ['evaluate', *usual, '--seeds', '2', '--out', f'{folder}/evaluation'],
        ['train', 'rstdp', *usual, '--steps', '60', '--out', f'{folder}/rstdp'],
        ['train', 'dqn', *usual, *_SMALL, '--steps', '60', '--out', f'{folder}/dqn'],
        ['transfer', '--robot', 'kinematic', '--seed', '1', '--json', '--states', '50']
        + ['--steps', '5', '--checkpoint', f'{folder}/dqn', '--out', f'{folder}/transfer'],
        ['experiment', f'{folder}/tiny.yaml', '--json', '--out', f'{folder}/tiny'],
    ):
        assert run(arguments) == 0
    return folder


def targets(runs: Path) -> list[Target]:
    """Return the files that commands read, with their readers."""
    found = []

    def add(name: str, *readers: Callable[[], object]) -> None:
        for path in sorted(runs.glob(name)):
            found.extend(Target(path, read) for read in readers)

    of = functools.partial
    for folder in ('lap', 'evaluation', 'rstdp', 'dqn', 'transfer'):
        for file in ('config.yaml', 'metrics.json', 'laps/*/metrics.json'):
            add(f'{folder}/{file}', of(_report, runs / folder))
    for controller, folder in (('rstdp', 'rstdp'), ('dqn', 'dqn'), ('dqn_snn', 'transfer')):
        place = str(runs / folder)
        readers = [
            of(make_controller, controller, {'checkpoint': place}),
            of(_report, Path(place)),
        ]
        if controller != 'dqn_snn':
            readers.append(of(_resume_training, controller, runs / folder))
        add(f'{folder}/checkpoint.safetensors', *readers)
    evaluation = of(_resume_evaluation, runs / 'evaluation')
    add('evaluation/config.yaml', evaluation)
    add('evaluation/laps/*/metrics.json', evaluation)
    add('lap/trajectory.csv', lambda: lap_metrics(read_csv(runs / 'lap/trajectory.csv'), 0.05))
    add('dqn/states.zst', of(read_states, runs / 'dqn'), of(_resume_training, 'dqn', runs / 'dqn'))
    add('dqn/checkpoint.safetensors', of(_transfer_states, runs / 'dqn'))
    experiment = of(_resume_experiment, runs / 'tiny')
    add('tiny.yaml', experiment)
    add('course.yaml', of(load_course, str(runs / 'course.yaml')))
    add('tiny/results.json', of(_report, runs / 'tiny'))
    for folder in sorted(runs.glob('tiny/*-seed?')):
        name = f'tiny/{folder.name}'
        add(f'{name}/run.json', of(read_run, RunFolder(folder)), of(_report, runs / 'tiny'))
        add(f'{name}/run.json', experiment)
        add(f'{name}/metrics.json', experiment)
        add(f'{name}/progress.json', of(read_progress, RunFolder(folder)))
    return found


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every container with each of its keys."""
    if isinstance(value, (dict, list)):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield value, key
            yield from _places(value[key])


def _replaced(value: Any, rng: np.random.Generator, *, is_yaml: bool) -> str:
    """Return a document, as JSON or YAML in its style, with a value replaced or left out."""
    places = list(_places(value))
    container, key = places[rng.integers(len(places))]
    if rng.random() < 0.15:
        del container[key]
        return json.dumps(value)
    container[key] = '@@'
    text = _VALUES[rng.integers(len(_VALUES))][is_yaml]
    return json.dumps(value).replace('"@@"', text)


def _damaged_bytes(content: bytes, rng: np.random.Generator) -> bytes:
    if rng.random() < 0.3 or not content:
        return content[: rng.integers(len(content) + 1)]
    damaged = bytearray(content)
    for _ in range(rng.integers(1, 9)):
        # Half of them in the head, where a byte means most.
        most = len(damaged) if rng.random() < 0.5 else min(len(damaged), 300)
        damaged[rng.integers(most)] = rng.integers(256)
    return bytes(damaged)


def _damaged_checkpoint(content: bytes, rng: np.random.Generator) -> bytes:
    """Replace a value in the head of a safetensors file, or in Spikelane's own in that."""
    (length,) = struct.unpack_from('<Q', content)
    head = json.loads(content[8 : 8 + length])
    if rng.random() < 0.8:
        own = json.loads(head['__metadata__']['spikelane'])
        head['__metadata__']['spikelane'] = _replaced(own, rng, is_yaml=False)
        text = json.dumps(head)
    else:
        text = _replaced(head, rng, is_yaml=False)
    encoded = text.encode()
    return struct.pack('<Q', len(encoded)) + encoded + content[8 + length :]


def _damaged_csv(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.decode().splitlines()
    if rng.random() < 0.2:
        return '\n'.join(lines[: rng.integers(3)]).encode()
    line = rng.integers(len(lines))
    cells = lines[line].split(',')
    cells[rng.integers(len(cells))] = _CELLS[rng.integers(len(_CELLS))]
    lines[line] = ','.join(cells)
    return '\n'.join(lines).encode()


def damaged(path: Path, content: bytes, rng: np.random.Generator) -> bytes:
    """Return a file's content with something wrong in it."""
    if rng.random() < 0.3 or path.suffix == '.zst':
        return _damaged_bytes(content, rng)
    if path.suffix == '.safetensors':
        return _damaged_checkpoint(content, rng)
    if path.suffix == '.csv':
        return _damaged_csv(content, rng)
    if path.suffix == '.yaml':
        return _replaced(yaml.safe_load(content), rng, is_yaml=True).encode()
    return _replaced(json.loads(content), rng, is_yaml=False).encode()


@pytest.mark.timeout(max(120, _MUTATIONS))
def test_a_damaged_file_gives_a_result_or_one_error(runs: Path, tmp_path: Path) -> None:
    """Truncated, with other bytes, or with values of other kinds, from a fixed seed."""
    rng = np.random.default_rng(_SEED)
    all_targets = targets(runs)
    refused, others = 0, {}
    for number in range(_MUTATIONS):
        path, read = all_targets[rng.integers(len(all_targets))]
        whole = path.read_bytes()
        content = damaged(path, whole, rng)
        path.write_bytes(content)
        try:
            read()
        except SpikelaneError as error:
            refused += str(error).isprintable()
        except Exception as error:
            kept = tmp_path / f'{number}{path.suffix}'
            kept.write_bytes(content)
            others[f'{path.relative_to(runs)}: {error!r:.200}'] = f'{read} {kept}'
        finally:
            path.write_bytes(whole)
    assert others == {}
    assert _MUTATIONS * 0.3 < refused < _MUTATIONS
