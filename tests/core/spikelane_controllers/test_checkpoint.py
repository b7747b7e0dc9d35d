"""Checkpoints and files of weights: what is refused, and how it is said."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from spikelane_controllers.checkpoint import read_checkpoint, write_checkpoint
from spikelane_controllers.dqn_snn.transferred import read_transferred
from spikelane_controllers.learning.training import Training, TrainingParameters
from spikelane_controllers.registry import make_controller
from spikelane_controllers.rstdp.controller import RStdp, RStdpParameters
from spikelane_controllers.rstdp.learnt_weights import read_weights, WEIGHTS
from spikelane_controllers.weights import export_weights, shipped_weights
from spikelane_sim.errors import CheckpointError

GOOD = np.linspace(100.0, 2900.0, 64).reshape(2, 32)


def _head(name: str, value: object) -> str:
    """Return the header of a transfer's checkpoint in which one value is another."""
    head = {'format': 'spikelane-checkpoint', 'version': 1, 'controller': 'dqn_snn', 'facts': {}}
    return json.dumps(head | {name: value})


def weights_of(file: Path | str) -> np.ndarray:
    """Return the weights that a controller has with a checkpoint."""
    return RStdp(RStdpParameters(checkpoint=str(file))).weights_pa


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    """Arrays of every kind with their types, and facts; by file or by folder."""
    arrays = {
        'a': np.array([[1.5, -0.0], [2.0**-1074, 3.0]]),
        'words': np.array([2**64 - 1, 0], np.uint64),
        'empty': np.zeros(0, np.int64),
        'transposed': np.arange(6, dtype=np.int8).reshape(2, 3).T,
    }
    facts = {'text': 'é', 'list': [1, 0.1, None, True]}
    file = tmp_path / 'new' / 'checkpoint.safetensors'
    write_checkpoint(file, 'rstdp', arrays, facts)
    for path in (file, file.parent):
        got = read_checkpoint(path, 'rstdp')
        assert got.facts == facts
        assert {name: (a.dtype, a.tolist()) for name, a in got.arrays.items()} == {
            name: (a.dtype, a.tolist()) for name, a in arrays.items()
        }
    assert json.loads(file.with_suffix('.json').read_text())['facts'] == facts
    assert {path.name for path in file.parent.iterdir()} == {file.name, 'checkpoint.json'}


def test_a_controller_drives_with_the_weights_of_a_checkpoint(tmp_path: Path) -> None:
    """Not those drawn from a generator, also when it forgets all; it does not learn."""
    file = tmp_path / 'weights.safetensors'
    write_checkpoint(file, 'rstdp', {WEIGHTS: GOOD}, {})
    controller = RStdp(RStdpParameters(checkpoint=str(file)))
    assert (controller.weights_pa == GOOD).all()
    assert controller.learning is False
    controller.initialise(np.random.default_rng(1))
    assert (controller.weights_pa == GOOD).all()


def test_weights_are_shipped_for_every_scenario() -> None:
    """They have been learnt, and the file says by which command."""
    names = ('scenario_1', 'scenario_2', 'scenario_3')
    assert shipped_weights('rstdp') == names
    assert shipped_weights('braitenberg') == ()
    learnt = [weights_of(name) for name in names]
    assert all(weights.min() < 100.0 and weights.max() > 300.0 for weights in learnt)
    assert make_controller('rstdp').weights_pa.tolist() == learnt[0].tolist()
    folder = Path(__file__).parents[3] / 'controllers/spikelane_controllers/rstdp/weights'
    for number, name in enumerate(names, 1):
        file = folder / f'{name}.safetensors'
        assert file.stat().st_size < 10_000
        command = read_checkpoint(file, 'rstdp').facts['command']
        assert command.startswith(f'spikelane train rstdp --scenario {number} ')


def test_the_weights_of_a_training_are_exported_with_their_command(tmp_path: Path) -> None:
    """Without the rest of its checkpoint."""
    training, file = tmp_path / 'checkpoint.safetensors', tmp_path / 'w.safetensors'
    write_checkpoint(training, 'rstdp', {WEIGHTS: GOOD, 'b': GOOD}, {'config': {}, 'steps': 7})
    export_weights('rstdp', tmp_path, file, 'spikelane train rstdp')
    arrays, facts = read_checkpoint(file, 'rstdp')
    assert list(arrays) == [WEIGHTS]
    assert facts == {'command': 'spikelane train rstdp', 'config': {}, 'steps': 7}
    assert (weights_of(file) == GOOD).all()


@pytest.mark.parametrize(
    ('weights', 'message'),
    [
        (GOOD[:, :30], r'expected shape \(2, 32\), got shape \(2, 30\)'),
        (np.where(GOOD == 100.0, np.nan, GOOD), 'expected finite numbers, got NaN'),
        (GOOD + 200.0, 'expected from 0 to 3000 pA, got from 300 to 3100 pA'),
        (GOOD.astype(np.float32), 'expected an array of float64, got float32'),
    ],
)
def test_other_weights_are_refused(tmp_path: Path, weights: np.ndarray, message: str) -> None:
    """In one line that names the file and the array."""
    file = tmp_path / 'w.safetensors'
    write_checkpoint(file, 'rstdp', {WEIGHTS: weights}, {})
    with pytest.raises(CheckpointError, match=message) as caught:
        weights_of(file)
    assert str(caught.value).startswith(f'{file}: {WEIGHTS}: expected ')
    assert '\n' not in str(caught.value)


def test_a_checkpoint_of_something_else_is_refused(tmp_path: Path) -> None:
    """Another controller or version, without weights, not a checkpoint, not even safetensors."""
    from safetensors.numpy import save_file

    file = tmp_path / 'w.safetensors'
    write_checkpoint(file, 'dqn', {WEIGHTS: GOOD}, {})
    with pytest.raises(CheckpointError, match='expected controller rstdp, got dqn'):
        weights_of(file)
    write_checkpoint(file, 'rstdp', {'other': GOOD}, {})
    with pytest.raises(CheckpointError, match=f'{WEIGHTS}: expected .*, but it is missing'):
        weights_of(file)
    head = {'format': 'spikelane-checkpoint', 'version': 2, 'controller': 'rstdp', 'facts': {}}
    save_file({WEIGHTS: GOOD}, file, metadata={'spikelane': json.dumps(head)})
    with pytest.raises(CheckpointError, match='expected version 1, got 2'):
        weights_of(file)
    save_file({WEIGHTS: GOOD}, file)
    with pytest.raises(CheckpointError, match='expected a checkpoint of Spikelane'):
        weights_of(file)
    file.write_text('text')
    with pytest.raises(CheckpointError, match='expected a whole safetensors file'):
        weights_of(file)


@pytest.mark.parametrize(
    ('head', 'reason'),
    [
        ('[' * 5000, 'header: expected lists and mappings nested 32 deep at most'),
        ('{"format": 1', 'header: not JSON'),
        (_head('facts', 1e-300), 'facts: expected a mapping, got 1e-300'),
        (_head('controller', [1] * 500), r'expected controller dqn_snn, got [\[1, ]{80}$'),
        (_head('facts', {'frames': True}), 'frames: expected a whole number, got True'),
        (_head('facts', {'frames': 1, 'maximum': 2**63}), f'maximum: .* whole .*, got {2**63}'),
        (_head('facts', {'frames': 2**70}), 'header: expected whole numbers of at most 64 bits'),
    ],
)
def test_a_header_of_another_kind_is_refused(tmp_path: Path, head: str, reason: str) -> None:
    """In one line that names the file, whatever the header holds."""
    from safetensors.numpy import save_file

    file = tmp_path / 'w.safetensors'
    single = np.float32
    network = {
        'network.hidden_weights': np.zeros((2, 3), single),
        'network.hidden_bias': np.zeros(2, single),
        'network.output_weights': np.zeros((4, 2), single),
    }
    save_file(network, file, metadata={'spikelane': head})
    with pytest.raises(CheckpointError, match=reason) as caught:
        read_transferred(str(file), 3, 4)
    assert str(caught.value).startswith(f'{file}: ')
    assert '\n' not in str(caught.value)
    assert caught.value.exit_status == (2 if 'controller' in reason else 1)


@pytest.mark.parametrize(
    ('name', 'value', 'reason'),
    [
        ('steps', '5', "steps: expected a whole number, got '5'"),
        ('terminations', 3, 'terminations: expected a list, got 3'),
        ('terminations', [[1, 2]], r'terminations\[0\]: expected step, episode, lane, .*'),
        ('config', [], r'config: expected a mapping, got \[\]'),
        ('controller', 0, 'controller: expected a mapping, got 0'),
        ('lane', 1, r'start\[0\]: expected lane, episode, got \[1, 1\]'),
        ('distance_m', None, 'distance_m: expected a number, got None'),
    ],
)
def test_a_training_is_not_resumed_from_facts_of_another_kind(
    tmp_path: Path, name: str, value: object, reason: str
) -> None:
    """Each fact that it needs is checked."""
    file = tmp_path / 'checkpoint.safetensors'
    controller = RStdp(RStdpParameters(learning=True, checkpoint=''))
    Training('rstdp', controller, TrainingParameters(), {}, file).begin(1)
    arrays, facts = read_checkpoint(file, 'rstdp')
    write_checkpoint(file, 'rstdp', arrays, facts | {name: value})
    training = Training('rstdp', controller, TrainingParameters(), {}, file)
    with pytest.raises(CheckpointError, match=reason):
        training.resume()


@pytest.mark.parametrize('missing', [1, 100, 600, None])
def test_a_truncated_checkpoint_is_refused(tmp_path: Path, missing: int | None) -> None:
    """Wherever it ends."""
    file = tmp_path / 'w.safetensors'
    write_checkpoint(file, 'rstdp', {WEIGHTS: GOOD}, {})
    file.write_bytes(file.read_bytes()[: None if missing is None else -missing])
    if missing is None:
        file.write_bytes(b'')
    with pytest.raises(CheckpointError, match=f'{file}: expected a whole safetensors file'):
        weights_of(file)


def test_weights_that_are_not_there_are_answered_with_those_that_are(tmp_path: Path) -> None:
    """By name, by path, and in a folder without a checkpoint."""
    with pytest.raises(CheckpointError, match=r"one of scenario_1, .*folder.*got 'scenario_9'"):
        weights_of('scenario_9')
    with pytest.raises(CheckpointError, match='expected one of scenario_1'):
        weights_of(tmp_path / 'none')
    with pytest.raises(CheckpointError, match='expected a checkpoint, got none'):
        read_weights('rstdp', str(tmp_path), (2, 32), 0.0, 3000.0)
