"""Trainings of the deep Q-network whose checkpoints an earlier version wrote."""

from __future__ import annotations

from pathlib import Path

import pytest

from spikelane_controllers.checkpoint import read_checkpoint, write_checkpoint
from spikelane_controllers.dqn.controller import Dqn
from spikelane_controllers.dqn.parameters import DqnParameters
from spikelane_controllers.dqn.training import DqnTraining, DqnTrainingParameters
from spikelane_sim.errors import CheckpointError


def training_of(folder: Path, backend: str) -> DqnTraining:
    """Return a training that has not begun."""
    values = {'learning': True, 'checkpoint': '', 'q_learning.backend': backend}
    parameters = DqnParameters.from_mapping({**values, 'q_learning.buffer_size': 40})
    config = {'dqn': parameters.to_dict()}
    file = folder / 'checkpoint.safetensors'
    return DqnTraining('dqn', Dqn(parameters), DqnTrainingParameters(), config, file)


def test_what_an_earlier_version_did_not_have_is_the_default(tmp_path: Path) -> None:
    """A training without a backend is one with PyTorch, and is not resumed with Numba."""
    training_of(tmp_path, 'torch').begin(0)
    file = tmp_path / 'checkpoint.safetensors'
    arrays, facts = read_checkpoint(file, 'dqn')
    config = {'dqn': {k: v for k, v in facts['config']['dqn'].items() if 'backend' not in k}}
    write_checkpoint(file, 'dqn', arrays, {**facts, 'config': config}, sync=False)
    training_of(tmp_path, 'torch').resume()
    with pytest.raises(CheckpointError, match=r'dqn.q_learning.backend numba, got .* torch'):
        training_of(tmp_path, 'numba').resume()
