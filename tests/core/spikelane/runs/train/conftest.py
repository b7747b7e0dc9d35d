"""What tests of trainings share: training in a folder, and a training that was never stopped."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import pytest

from spikelane.runs.folder import RunFolder
from spikelane.runs.train.config import TrainConfig
from spikelane.runs.train.run import train
from spikelane_controllers.learning.training import Training


class TrainIn(Protocol):
    """Trains in a folder."""

    def __call__(self, path: Path, config: TrainConfig, *, resume: bool = False) -> Training:
        """Train, or resume a training; return it as it is at its end."""


@pytest.fixture(scope='session')
def train_in() -> TrainIn:
    """Give what trains in a folder."""

    def train_in(path: Path, config: TrainConfig, *, resume: bool = False) -> Training:
        return train(config, RunFolder(path), lambda steps, progress_m: None, resume=resume)

    return train_in


@pytest.fixture(scope='module')
def whole(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, train_in: TrainIn
) -> Path:
    """Give the folder of a training of the module's configuration that was never stopped."""
    folder = tmp_path_factory.mktemp('whole')
    train_in(folder, request.module.config_of())
    return folder
