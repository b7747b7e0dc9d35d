"""`spikelane transfer` and `spikelane export`: what they leave, and what they refuse."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
import sys
from typing import Any

import numpy as np
import pytest
import yaml

from spikelane.main import run
from spikelane_controllers.checkpoint import read_checkpoint, write_checkpoint
from spikelane_controllers.dqn.learnt_network import Q_NETWORK
from spikelane_controllers.dqn.q_network import initial_network, QNetworkParameters
from spikelane_controllers.dqn.visited_states import StateStore
from spikelane_controllers.dqn_snn import policy_transfer
from spikelane_controllers.dqn_snn.controller import DqnSnn, DqnSnnParameters
from spikelane_controllers.dqn_snn.normalisation import normalise
from spikelane_controllers.dqn_snn.transferred import read_transferred

QUICK = ('--states', '60', '--steps', '40', '--robot', 'kinematic', '--seed', '3')


@pytest.fixture(scope='module')
def dqn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the folder of a DQN's training, with 30 states; its network is drawn."""
    folder = tmp_path_factory.mktemp('dqn')
    rng = np.random.default_rng(0)
    network = initial_network(rng, 512, 3, QNetworkParameters(initial_bound=0.3))
    arrays = dict(zip(Q_NETWORK, network, strict=True))
    outcomes = [[number, 0.0, 1.0, None, 0] for number in (8, 9, 10)]
    facts = {'config': {'dqn': {}}, 'outcomes': outcomes}
    write_checkpoint(folder / 'checkpoint.safetensors', 'dqn', arrays, facts)
    store = StateStore(folder / 'states.zst', (16, 32))
    store.begin()
    for _ in range(30):
        store.append(rng.integers(0, 20, (16, 32)))
    store.flush()
    return folder


def printed(*arguments: str) -> dict[str, Any]:
    """Run a command that prints JSON."""
    with contextlib.redirect_stdout(io.StringIO()) as text:
        assert run([*arguments, '--json']) == 0
    return dict(json.loads(text.getvalue()))


@pytest.fixture(scope='module')
def done(dqn: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Give the result of a transfer."""
    out = tmp_path_factory.mktemp('transfer') / 'run'
    return printed('transfer', '--checkpoint', str(dqn), *QUICK, '--out', str(out))


def test_the_states_of_the_training_and_others_are_learnt(done: dict[str, Any]) -> None:
    """As many as asked for; a tenth is held out."""
    assert done['states_from'] == {'training': 30, 'gathered': 60}
    assert (done['states'], done['held_out_states']) == (90, 9)
    assert sum(done['class_shares'].values()) == pytest.approx(1.0)
    assert list(done['class_shares']) == ['left', 'straight', 'right']
    assert done['accuracy'] * 9 == pytest.approx(round(done['accuracy'] * 9))
    assert done['paper_accuracy'] == 0.9305
    assert done['maximum'] >= 19


def test_states_are_gathered_behind_filters(dqn: Path, tmp_path: Path) -> None:
    """They are written down; where there are none, the configuration is as it was before."""
    filtered = (
        '--param',
        'filter.chain=correlation',
        '--param',
        'filter.correlation.supporters=3',
    )
    configs = []
    for name, given in (('none', ()), ('three', filtered)):
        out = tmp_path / name
        printed('transfer', '--checkpoint', str(dqn), *QUICK, *given, '--out', str(out))
        configs.append(yaml.safe_load((out / 'config.yaml').read_text('utf-8')))
    assert 'filter' not in configs[0]
    assert configs[1]['filter']['chain'] == 'correlation'
    assert configs[1]['filter']['correlation.supporters'] == 3


def test_the_folder_has_all_files_of_a_run(done: dict[str, Any]) -> None:
    """And no others."""
    folder = Path(done['folder'])
    files = {str(path.relative_to(folder)) for path in folder.rglob('*') if path.is_file()}
    drawn = {f'figures/{name}.{kind}' for name in ('accuracy', 'rates') for kind in ('svg', 'png')}
    assert files == drawn | {
        'checkpoint.json',
        'checkpoint.safetensors',
        'config.yaml',
        'metrics.json',
    }
    assert json.loads((folder / 'metrics.json').read_text()) == done
    config = yaml.safe_load((folder / 'config.yaml').read_text())
    assert (config['gathering']['states'], config['transfer']['steps']) == (60, 40)
    assert config['simulator']['episode.max_steps'] == 10_000
    assert (config['seed'], config['from_training']) == (3, True)


def test_the_checkpoint_has_the_network_before_and_after(done: dict[str, Any]) -> None:
    """The second is the first, normalised."""
    arrays, facts = read_checkpoint(Path(done['folder']), 'dqn_snn')
    transferred = read_transferred(done['folder'], 512, 3)
    ann = [arrays[f'ann.{name}'] for name in transferred.network._fields]
    again = normalise(type(transferred.network)(*ann))
    assert all((a == b).all() for a, b in zip(again.network, transferred.network, strict=True))
    assert transferred.scale == (10, done['maximum'], 50)
    assert facts['accuracy'] == done['accuracy']
    assert again.hidden_divisor == done['hidden_divisor']


def test_a_seed_gives_the_same_networks(dqn: Path, done: dict[str, Any], tmp_path: Path) -> None:
    """Another one others; so do other states."""
    command = ('transfer', '--checkpoint', str(dqn), *QUICK)
    same, other, fewer = (
        printed(*command, *more, '--out', str(tmp_path / name))
        for name, more in {
            'same': (),
            'other': ('--seed', '4'),
            'fewer': ('--no-from-training',),
        }.items()
    )
    networks = [
        b''.join(each.tobytes() for each in read_transferred(run['folder'], 512, 3).network)
        for run in (done, same, other, fewer)
    ]
    assert networks[0] == networks[1]
    assert len(set(networks)) == 3
    assert fewer['states_from'] == {'gathered': 60}


def test_the_spiking_network_drives_and_learns_of_where_it_goes(dqn: Path, tmp_path: Path) -> None:
    """As many states in each round as before; whole episodes are held out."""
    command = ('transfer', '--checkpoint', str(dqn), *QUICK)
    limit = ('--param', 'simulator.episode.max_steps=100')  # ten states in an episode
    parameters = ('transfer.rounds=2', 'transfer.held_out_by=episode')
    asked = [word for each in parameters for word in ('--param', each)]
    learnt = printed(*command, *limit, *asked, '--out', str(tmp_path / 'rounds'))
    gathered = {'gathered': 60, 'round 1': 60, 'round 2': 60}
    assert learnt['states_from'] == {'training': 30, **gathered}
    assert learnt['held_out_states'] in range(21, 31)  # of 210 states in 22 episodes
    again = printed(*command, *limit, *asked, '--out', str(tmp_path / 'again'))
    assert again['accuracy'] == learnt['accuracy']


def test_in_rounds_it_drives_with_the_parameters_asked_for(dqn: Path, tmp_path: Path) -> None:
    """It goes elsewhere with other neurons, so that it learns from other states."""
    command = ('transfer', '--checkpoint', str(dqn), *QUICK)
    command += ('--param', 'simulator.episode.max_steps=100', '--param', 'transfer.rounds=1')
    asked = {
        'default': (),
        'stated': ('trace_decay=0.8', 'neurons.simulated_ms=10'),
        'other': ('trace_decay=0.0', 'neurons.threshold_mv=0.1'),
    }
    networks = {}
    for name, values in asked.items():
        options = [word for each in values for word in ('--param', f'transfer.driving.{each}')]
        run_folder = printed(*command, *options, '--out', str(tmp_path / name))['folder']
        network = read_transferred(run_folder, 512, 3).network
        networks[name] = b''.join(each.tobytes() for each in network)
    assert networks['default'] == networks['stated'] != networks['other']


def test_in_rounds_it_drives_with_the_control_period(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a Q-network was trained with 25 ms, so does the network that learns from it."""
    made: list[DqnSnnParameters] = []

    class Noted(DqnSnn):
        def __init__(self, parameters: DqnSnnParameters) -> None:
            made.append(parameters)
            super().__init__(parameters)

    monkeypatch.setattr(policy_transfer, 'DqnSnn', Noted)
    short = ('--param', 'simulator.period_ms=25')
    train = ('train', 'dqn', '--robot', 'kinematic', '--steps', '60', '--seed', '3', *short)
    learnt = printed(*train, '--out', str(tmp_path / 'dqn'))['folder']
    command = ('transfer', '--checkpoint', learnt, *QUICK, *short, '--no-from-training')
    rounds = ('--param', 'transfer.rounds=1', '--out', str(tmp_path / 'rounds'))
    assert printed(*command, *rounds)['states_from'] == {'gathered': 60, 'round 1': 60}
    assert [each.period_ms for each in made] == [25]


def test_a_period_that_the_spiking_network_cannot_drive_with_is_refused_at_once(
    dqn: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In 12 ms its neurons would be simulated for 2.4 steps of 1 ms."""
    command = ['transfer', '--checkpoint', str(dqn), '--param', 'simulator.period_ms=12']
    assert run([*command, '--out', str(tmp_path / 'none'), '--param', 'transfer.rounds=1']) == 2
    told = capsys.readouterr().err
    assert 'transfer.driving: ' in told
    assert 'simulated_ms: expected a multiple of step_ms = 1 ms, got 2.4' in told


def test_the_robot_drives_with_it(done: dict[str, Any], tmp_path: Path) -> None:
    """By the folder; the same bytes for the same seed."""
    drives = []
    for name in 'ab':
        command = ['lap', '--controller', 'dqn_snn', '--checkpoint', done['folder']]
        command += ['--transport', 'inprocess', '--robot', 'kinematic', '--seed', '2']
        command += ['--param', 'simulator.episode.max_steps=60', '--out', str(tmp_path / name)]
        with contextlib.redirect_stdout(io.StringIO()):
            assert run(command) == 1
        drives.append((tmp_path / name / 'trajectory.csv').read_bytes())
    assert drives[0] == drives[1]
    assert drives[0].count(b'\n') == 62


def test_it_is_exported_to_nir(
    done: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """People are told what NIR cannot say; with other neurons there is nothing to tell."""
    import nir

    file = tmp_path / 'lane.nir'
    assert run(['export', 'nir', done['folder'], str(file)]) == 0
    out, _ = capsys.readouterr()
    assert out.startswith(f'{file}: Input -> Affine -> IF -> Affine -> IF -> Output\n')
    assert 'must raise them after each time step' in out
    weights = read_transferred(done['folder'], 512, 3).network.hidden_weights
    assert (nir.read(file).nodes['to_hidden'].weight == weights).all()
    unclamped = ('--param', 'dqn_snn.neurons.clamped=false')
    result = printed('export', 'nir', done['folder'], str(file), *unclamped)
    assert 'v_min' not in result['metadata']
    assert result['metadata']['scale_maximum'] == done['maximum']


def test_what_cannot_be_done_is_refused(
    dqn: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one line each, with exit status 2, before anything is made."""
    bare = tmp_path / 'bare'
    bare.mkdir()
    (bare / 'checkpoint.safetensors').write_bytes((dqn / 'checkpoint.safetensors').read_bytes())
    out = tmp_path / 'out'
    cases = {
        (
            'transfer',
            '--checkpoint',
            str(bare),
            '--from-training',
        ): 'expected the states of the training n',
        ('transfer', '--checkpoint', str(tmp_path / 'none')): 'checkpoint: expected one of ',
        ('transfer', '--checkpoint', str(dqn), '--states', '0'): 'gathering: states: expected a w',
        (
            'transfer',
            '--checkpoint',
            str(dqn),
            '--param',
            'dqn.x=1',
        ): 'expected simulator.<name> o',
        ('transfer', '--checkpoint', str(dqn), '--seed', '-1'): 'seed: expected a whole number',
        ('export', 'nir', str(dqn), 'x.nir'): 'expected controller dqn_snn, got dqn',
        ('export', 'nir', str(tmp_path / 'none'), 'x.nir'): 'checkpoint: expected one of',
    }
    for arguments, message in cases.items():
        more = ('--out', str(out)) if arguments[0] == 'transfer' else ()
        assert run([*arguments, *more]) == 2, arguments
        err = capsys.readouterr().err
        assert message in err
        assert err.count('\n') == 1
        assert not out.exists()


def test_a_transfer_that_cannot_begin_leaves_no_folder(
    dqn: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The same command can go there once PyTorch is installed, or with a policy that is whole."""
    out, damaged = tmp_path / 'out', tmp_path / 'damaged'
    damaged.write_bytes((dqn / 'checkpoint.safetensors').read_bytes()[:-1])
    assert run(['transfer', '--checkpoint', str(damaged), '--out', str(out)]) == 1
    assert f'{damaged}: expected a whole safetensors file' in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, 'torch', None)
    assert run(['transfer', '--checkpoint', str(dqn), '--out', str(out)]) == 1
    assert 'learning: expected PyTorch, found none' in capsys.readouterr().err
    assert not out.exists()
