"""Trainings of the deep Q-network: checkpoints of an earlier version, episodes of states."""

from __future__ import annotations

from pathlib import Path

import pytest

from spikelane_controllers.checkpoint import read_checkpoint, write_checkpoint
from spikelane_controllers.dqn.controller import Dqn
from spikelane_controllers.dqn.parameters import DqnParameters
from spikelane_controllers.dqn.training import (
    DqnTraining,
    DqnTrainingParameters,
    visited_episodes,
)
from spikelane_sim.errors import CheckpointError


def training_of(folder: Path, backend: str) -> DqnTraining:
    """Return a training that has not begun."""
    values = {'learning': True, 'checkpoint': '', 'q_learning.backend': backend}
    parameters = DqnParameters.from_mapping({**values, 'q_learning.buffer_size': 40})
    config = {'dqn': parameters.to_dict()}
    file = folder / 'checkpoint.safetensors'
    return DqnTraining('dqn', Dqn(parameters), DqnTrainingParameters(), config, file)


def test_an_earlier_version_without_a_backend_computed_with_pytorch(tmp_path: Path) -> None:
    """Though it is no longer the default: such a training is not resumed with Numba."""
    training_of(tmp_path, 'torch').begin(0)
    file = tmp_path / 'checkpoint.safetensors'
    arrays, facts = read_checkpoint(file, 'dqn')
    config = {'dqn': {k: v for k, v in facts['config']['dqn'].items() if 'backend' not in k}}
    write_checkpoint(file, 'dqn', arrays, {**facts, 'config': config}, sync=False)
    training_of(tmp_path, 'torch').resume()
    with pytest.raises(CheckpointError, match=r'dqn.q_learning.backend numba, got .* torch'):
        training_of(tmp_path, 'numba').resume()


def test_states_belong_to_the_episodes_that_they_were_met_in(tmp_path: Path) -> None:
    """Those after the last whole episode to one that has not ended."""
    outcomes = [[actions, 0.0, 1.0, None, 0] for actions in (2, 3)]
    write_checkpoint(tmp_path / 'checkpoint.safetensors', 'dqn', {}, {'outcomes': outcomes})
    assert visited_episodes(tmp_path, 7).tolist() == [0, 0, 1, 1, 1, 2, 2]
    with pytest.raises(CheckpointError, match='expected at least 5 states, got 4'):
        visited_episodes(tmp_path, 4)
