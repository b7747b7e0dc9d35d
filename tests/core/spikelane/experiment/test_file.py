"""Experiment files: what they may say, and how they are refused."""

from __future__ import annotations

from pathlib import Path
import re

import pytest

from spikelane.experiment.file import (
    ExperimentError,
    ExperimentRecord,
    read_experiment,
    with_seeds,
)
from spikelane.experiment.tasks import EvaluateOptions, TrainOptions, TransferOptions

ROOT = Path(__file__).parents[4]

WHOLE = """
name: some.thing-1
description: To be read
matrix:
  - controllers: [braitenberg, rstdp]
    scenarios: [1, scenario_3]
    seeds: [3, 5, 3]
    transport: ros
    robots: [kinematic, pybullet]
    pixels:
      noisy: {model: esim, esim: {shot_rate_hz: 1e-1}}
    cameras: {paper: {}, smooth: {antialias: true}}
    variants: {slow: {rstdp.c_r: 0.005, braitenberg.poisson.max_events: 9}}
    courses: [2]
    conditions:
      late: {simulator.link.latency_ms: 100}
    tasks:
      evaluate: {laps: 3, lanes: [outer]}
      train: {steps: 200}
  - controllers: [braitenberg]
    tasks: [evaluate]
"""


def read(folder: Path, text: str) -> ExperimentRecord:
    """Read a text as a file."""
    file = folder / 'some.yaml'
    file.write_text(text)
    return read_experiment(file)


def test_everything_that_can_be_said_is_read(tmp_path: Path) -> None:
    """Parameters under their whole names, tasks in the order in which they are done."""
    record = read(tmp_path, WHOLE)
    assert (record.name, record.description) == ('some.thing-1', 'To be read')
    first, second = record.blocks
    assert first.controllers == ('braitenberg', 'rstdp')
    assert first.scenarios == ('1', 'scenario_3')
    assert (first.seeds, first.transport, first.courses) == ((3, 5), 'ros', ('2',))
    assert first.axes == {
        'robots': {
            'kinematic': {'simulator.robot.model': 'kinematic'},
            'pybullet': {'simulator.robot.model': 'pybullet'},
        },
        'pixels': {
            'noisy': {
                'simulator.pixels.model': 'esim',
                'simulator.pixels.esim.shot_rate_hz': 0.1,
            }
        },
        'cameras': {'paper': {}, 'smooth': {'simulator.camera.antialias': True}},
        'variants': {'slow': {'rstdp.c_r': 0.005, 'braitenberg.poisson.max_events': 9}},
    }
    assert first.conditions == {'late': {'simulator.link.latency_ms': 100}}
    assert list(first.tasks.items()) == [
        ('train', TrainOptions(steps=200)),
        ('evaluate', EvaluateOptions(laps=3, lanes=('outer',))),
    ]
    assert (second.scenarios, second.seeds, second.transport) == (('1',), (0,), 'inprocess')
    assert second.axes == {}
    assert second.tasks == {'evaluate': EvaluateOptions()}


def test_one_block_needs_no_list_and_seeds_can_be_counted(tmp_path: Path) -> None:
    """As in the smallest file."""
    text = 'name: a\nmatrix: {controllers: [rstdp], seeds: 3, tasks: [train]}\n'
    (block,) = read(tmp_path, text).blocks
    assert block.seeds == (0, 1, 2)


TRANSFER = """name: a
matrix:
  controllers: [dqn, dqn_snn]
  variants: {a: {transfer: {decays: true}, gathering.random_actions: 0.2}}
  tasks: {train: {}, transfer: {states: 7, from_training: false}}
"""


def test_a_transfers_parameters_are_known_where_there_is_one(tmp_path: Path) -> None:
    """Elsewhere they would do nothing, as in conditions; 0 steps are as many as usual."""
    (block,) = read(tmp_path, TRANSFER).blocks
    assert block.axes == {
        'variants': {'a': {'transfer.decays': True, 'gathering.random_actions': 0.2}}
    }
    assert block.tasks['transfer'] == TransferOptions(states=7, steps=0, from_training=False)
    for text in (
        TRANSFER.replace('train: {}, transfer: {states: 7, from_training: false}', 'evaluate: {}'),
        TRANSFER.replace('variants', 'conditions'),
        TRANSFER.replace(', dqn_snn', ''),
    ):
        message = r":4: unknown parameter 'transfer\.decays', expected dqn\.<name>, "
        with pytest.raises(ExperimentError, match=message):
            read(tmp_path, text)


def test_seeds_can_be_counted_anew(tmp_path: Path) -> None:
    """In every block, and nothing else."""
    record = read(tmp_path, WHOLE)
    other = with_seeds(record, 2)
    assert [block.seeds for block in other.blocks] == [(0, 1), (0, 1)]
    assert [block._replace(seeds=()) for block in other.blocks] == [
        block._replace(seeds=()) for block in record.blocks
    ]


@pytest.mark.parametrize('path', sorted((ROOT / 'experiments').glob('*.yaml')), ids=str)
def test_the_files_that_come_along_can_be_read(path: Path) -> None:
    """Each is named as its experiment."""
    assert read_experiment(path).name == path.stem


def test_the_file_in_the_tutorial_can_be_read(tmp_path: Path) -> None:
    """The only YAML there."""
    (text,) = re.findall(r'```yaml\n(.*?)```', (ROOT / 'docs/tutorial.md').read_text(), re.DOTALL)
    (block,) = read(tmp_path, text).blocks
    assert (block.controllers, len(block.seeds)) == (('rstdp', 'braitenberg'), 10)


BLOCK = """name: a
matrix:
  - controllers: [rstdp]
    scenarios: [1]
    cameras: {smooth: {antialias: true}}
    tasks:
      train: {steps: 200}
"""


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        (BLOCK, '', ': expected an experiment, got an empty file'),
        ('name: a', 'name: ]', r':1: not YAML: '),
        ('name: a', 'name: a b', r":1: name: expected a name of letters, digits, .*, got 'a b'"),
        ('name: a', 'name: a\nseed: 3', ":2: unknown key 'seed', expected name, matrix, descr"),
        ('name: a\n', '', ":1: expected the key 'name', got a mapping"),
        (
            '[rstdp]',
            '[rstdp, dqm]',
            r':3: matrix\[0\]\.controllers\[1\]: expected braitenberg or dqn or '
            r"dqn_snn or rstdp, got 'dqm'",
        ),
        ('[rstdp]', 'rstdp', r":3: matrix\[0\]\.controllers: expected a list, got 'rstdp'"),
        ('[rstdp]', '[]', r':3: matrix\[0\]\.controllers: expected a list of at least one'),
        (
            'scenarios',
            'scenario',
            r":4: unknown key 'scenario' of matrix\[0\], expected controllers, tasks, scenarios, ",
        ),
        ('[1]', '[7]', r':4: matrix\[0\]\.scenarios\[0\]: course: expected scenario_1, .* got'),
        ('[1]', '[1]\n    seeds: 0', r':5: .*\.seeds: expected a whole number from 1 to'),
        ('[1]', '[1]\n    seeds: [-1]', r':5: .*\.seeds\[0\]: expected a whole number from 0'),
        (
            '[1]',
            '[1]\n    robots: [tank]',
            r":5: .*: expected p3dx or turtlebot4 or kinematic or pybullet or rigid, got 'tank'",
        ),
        (
            'antialias: true',
            'antialias: soft',
            ":5: simulator.camera.antialias: expected true or false, got 'soft'",
        ),
        (
            'antialias: true',
            'fov: 90',
            r":5: unknown parameter 'simulator.camera.fov', expected simulator.camera.width, ",
        ),
        (
            'antialias: true',
            'fov_deg: 900',
            ':5: simulator.camera.fov_deg: expected a number from .*, got 900',
        ),
        ('smooth: {', 'smooth/er: {', ':5: .*: expected a name of letters, .*, got .smooth/er'),
        (
            'cameras',
            'variants',
            ":5: unknown parameter 'antialias', expected filter.<name>, rstdp.<name>, simul",
        ),
        (
            'cameras: {smooth: {antialias: true}}',
            'variants: {a: {braitenberg.poisson.max_events: 9}}',
            ":5: unknown parameter 'braitenberg.poisson.max_events', expected filter.<name>, ",
        ),
        ('train:', 'drain:', ":7: unknown task 'drain', expected train, transfer, evaluate"),
        (
            'steps: 200',
            'steps: -2',
            ':7: steps: expected a whole number from 0 to 1000000000, got -2',
        ),
        (
            '    cameras',
            '    courses: [random:9-2]\n    cameras',
            r':5: matrix\[0\]\.courses\[0\]: course: expected 1 to 100000 random',
        ),
        (
            'steps: 200',
            'step: 200',
            ":7: unknown parameter 'step', expected record, steps",
        ),
        ('steps: 200', 'steps: 200, steps: 3', r':7: matrix\[0\].tasks.train.steps: given twice'),
        ('{steps: 200}', '', r':7: matrix\[0\].tasks.train: expected a mapping, got nothing'),
    ],
)
def test_a_wrong_file_is_refused_with_line_key_and_what_is_allowed(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    """One line."""
    text = BLOCK.replace(old, new, 1)
    assert text != BLOCK
    with pytest.raises(ExperimentError, match=f'some.yaml{message}') as error:
        read(tmp_path, text)
    assert '\n' not in str(error.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    """With the reason."""
    with pytest.raises(ExperimentError, match=r'/some\.yaml: cannot be read: No such file'):
        read_experiment(tmp_path / 'some.yaml')


def test_a_training_can_be_saved_more_often_in_a_variant(tmp_path: Path) -> None:
    """Its parameters are a group like any other, where there is a training."""
    text = (
        'name: a\nmatrix:\n  controllers: [rstdp]\n'
        '  variants: {often: {training.save_every: 50}}\n  tasks: {TASK: {}}\n'
    )
    (block,) = read(tmp_path, text.replace('TASK', 'train')).blocks
    assert block.axes == {'variants': {'often': {'training.save_every': 50}}}
    with pytest.raises(ExperimentError, match=r'training\.save_every'):
        read(tmp_path, text.replace('TASK', 'evaluate'))
