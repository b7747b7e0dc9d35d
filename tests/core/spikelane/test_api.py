"""`import spikelane`: the public functions."""

from __future__ import annotations

import json
from pathlib import Path
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from safetensors.numpy import load_file

import spikelane
from spikelane.main import run as run_command
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.errors import CheckpointError, ParameterError

ROOT = Path(__file__).parents[3]
KINEMATIC = {'engine': 'kinematic'}
SHORT = {'simulator.episode.max_steps': 40}


class Steady:
    """A controller of somebody's own, registered nowhere."""

    def reset(self, rng: np.random.Generator) -> None:
        """Forget nothing."""

    def step(self, observation: Observation) -> WheelVelocities:
        """Drive straight on."""
        return WheelVelocities(1.0, 1.0)


@pytest.fixture(scope='module')
def training(tmp_path_factory: pytest.TempPathFactory) -> spikelane.Run:
    """Give a short training of R-STDP."""
    folder = tmp_path_factory.mktemp('runs') / 'training'
    return spikelane.train('rstdp', seed=2, steps=900, **KINEMATIC, out=folder)


def test_the_import_loads_nothing_that_takes_long() -> None:
    """But the environment is registered, whatever is imported first."""
    code = (
        'import sys, spikelane\n'
        'heavy = {"numba", "pandas", "matplotlib", "pybullet", "scipy", "torch", "rclpy"}\n'
        'print(heavy & set(sys.modules))\n'
        'import gymnasium\n'
        'print("spikelane/LaneKeeping-v0" in gymnasium.registry)\n'
        'print(sorted(set(spikelane.__all__) - set(dir(spikelane))))\n'
    )
    command = [sys.executable, '-c', code]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == 'set()\nTrue\n[]\n'


def test_what_is_not_public_is_no_attribute() -> None:
    """As in any module."""
    with pytest.raises(AttributeError, match="'spikelane' has no attribute 'nothing'"):
        spikelane.nothing  # noqa: B018


def test_a_lap_is_that_of_the_command(tmp_path: Path) -> None:
    """With its folder, from which all is read again; without one, nothing is written."""
    words = ['lap', '--transport', 'inprocess', '--engine', 'kinematic', '--seed', '4']
    run_command(
        [*words, '--param', 'simulator.episode.max_steps=40', '--out', str(tmp_path / 'a')]
    )
    driven = spikelane.drive('braitenberg', seed=4, **KINEMATIC, parameters=SHORT)
    assert driven.folder is None
    written = spikelane.drive(
        'braitenberg', seed=4, **KINEMATIC, parameters=SHORT, out=tmp_path / 'b'
    )
    assert written.folder == tmp_path / 'b'
    read = spikelane.load_run(tmp_path / 'a')
    for lap in (driven, written, spikelane.load_run(tmp_path / 'b')):
        pd.testing.assert_frame_equal(lap.trajectory, read.trajectory)
        assert lap.metrics['mean_abs_distance_m'] == read.metrics['mean_abs_distance_m']
    assert len(read.trajectory) == 41
    assert read.config['seed'] == driven.config['seed'] == 4
    assert {path.name for path in tmp_path.iterdir()} == {'a', 'b'}


def test_events_and_spikes_are_those_of_each_step() -> None:
    """Counted one way and the other; the controller answers to them."""
    lap = spikelane.drive('rstdp', seed=1, **KINEMATIC, parameters=SHORT)
    assert lap.events.columns.tolist() == ['stamp_ns', 't_ns', 'x_px', 'y_px', 'polarity']
    counted = lap.events.groupby('stamp_ns').size()
    seen = lap.trajectory.set_index('stamp_ns')['events']
    assert counted.reindex(seen.index, fill_value=0).tolist() == seen.tolist()
    assert set(lap.events['polarity']) == {-1, 1}
    assert lap.events['x_px'].between(0, 127).all()
    assert (lap.events['t_ns'] <= lap.events['stamp_ns']).all()
    spikes = lap.spikes.pivot_table(
        index='stamp_ns', columns='neuron', values='spikes', observed=True
    )
    assert spikes.columns.tolist() == ['left', 'right']
    assert len(spikes) == len(lap.trajectory) == 41
    faster = spikes['left'] > spikes['right']
    turned = lap.trajectory.set_index('stamp_ns')
    assert faster.any()
    assert (turned['left_rad_s'] - turned['right_rad_s'])[faster].max() > 0


def test_a_controller_of_ones_own_drives(tmp_path: Path) -> None:
    """It needs no name, no parameters and no spikes; it leaves no folder."""
    lap = spikelane.drive(Steady(), scenario=2, lane='inner', seed=1, **KINEMATIC)
    assert lap.metrics['reason'] == 'lane_lost'
    assert lap.trajectory['left_rad_s'].eq(1.0).all()
    assert (lap.config['controller'], lap.config['lane']) == ('Steady', 'inner')
    assert len(lap.spikes) == 0
    assert len(lap.events) == lap.trajectory['events'].sum() > 0
    with pytest.raises(ParameterError, match='out, checkpoint: expected the name of a controller'):
        spikelane.drive(Steady(), out=tmp_path / 'lap')
    with pytest.raises(spikelane.RunError, match=r'a run that wrote nothing: expected checkpoint'):
        lap.weights  # noqa: B018


def test_a_training_can_be_read_and_driven(training: spikelane.Run) -> None:
    """By its name with the weights, as by a controller that is made with them."""
    assert training.folder is not None
    arrays = load_file(training.folder / 'checkpoint.safetensors')
    expected = arrays['controller.network.weights_pa']
    weights = training.weights
    assert set(weights['array']) == {'controller.network.weights_pa'}
    table = weights.pivot_table(index='row', columns='column', values='weight').to_numpy()
    np.testing.assert_array_equal(table, expected)
    assert table.shape == (2, 32)
    assert training.episodes['reason'].tolist() == ['lane_lost'] * len(training.episodes)
    assert training.metrics['steps'] == 900
    named = spikelane.drive('rstdp', checkpoint=training, seed=1, **KINEMATIC)
    made = spikelane.make_controller('rstdp', checkpoint=training.folder)
    driven = spikelane.drive(made, seed=1, **KINEMATIC)
    pd.testing.assert_frame_equal(named.trajectory, driven.trajectory)
    pd.testing.assert_frame_equal(named.weights, weights)


def test_an_evaluation_has_its_laps(tmp_path: Path, training: spikelane.Run) -> None:
    """One row for each lane and seed."""
    options = {'parameters': SHORT, 'out': tmp_path / 'evaluation'}
    found = spikelane.evaluate('rstdp', seeds=2, checkpoint=training, **KINEMATIC, **options)
    assert found.laps[['lane', 'seed', 'steps']].to_numpy().tolist() == [
        ['outer', 0, 40],
        ['outer', 1, 40],
        ['inner', 0, 40],
        ['inner', 1, 40],
    ]
    assert found.metrics['summary']['all']['completed']['n'] == 4
    metrics = json.loads((tmp_path / 'evaluation/metrics.json').read_text())
    assert found.metrics == metrics


def test_what_a_run_does_not_have_is_told(training: spikelane.Run, tmp_path: Path) -> None:
    """With the file that was expected, and what leaves one."""
    for name, expected in {
        'trajectory': r'expected trajectory\.csv, which a lap leaves, got none',
        'events': 'expected bag, which a lap that was recorded over ROS leaves, got none',
        'laps': 'expected laps, which an evaluation leaves, got none',
    }.items():
        with pytest.raises(spikelane.RunError, match=f'^{training.folder}: {expected}$'):
            getattr(training, name)
    with pytest.raises(
        spikelane.RunError, match=r"expected a run's folder, got none: config\.yaml"
    ):
        spikelane.load_run(tmp_path)
    (tmp_path / 'config.yaml').write_text('seed: 1\n')
    with pytest.raises(spikelane.RunError, match=r'that is over, got one without metrics\.json'):
        spikelane.load_run(tmp_path)
    lap = spikelane.drive('braitenberg', **KINEMATIC, parameters=SHORT)
    with pytest.raises(ParameterError, match=r'checkpoint: expected a training, got Run\('):
        spikelane.drive('rstdp', checkpoint=lap)
    with pytest.raises(CheckpointError, match='expected one of scenario_1'):
        spikelane.make_controller('rstdp', checkpoint='nowhere').reset(np.random.default_rng(0))


def test_the_lines_in_the_readme_learn_and_drive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lap with the weights learnt, and its picture."""
    monkeypatch.chdir(tmp_path)
    [code] = re.findall(r'^```python\n(.*?)^```', (ROOT / 'README.md').read_text(), re.M | re.S)
    assert len(code.splitlines()) <= 10
    names: dict[str, object] = {}
    exec(compile(code, 'README.md', 'exec'), names)
    lap = names['lap']
    assert isinstance(lap, spikelane.Run)
    assert lap.metrics['completed'] is True
    assert lap.metrics['mean_abs_distance_m'] < 0.01
    assert (tmp_path / 'lap.png').read_bytes().startswith(b'\x89PNG')
    assert (tmp_path / 'runs/train-rstdp-1-seed1/checkpoint.safetensors').exists()
