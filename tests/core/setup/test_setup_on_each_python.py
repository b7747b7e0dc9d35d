"""A real set-up on each further Python of this machine, to the same laps and trainings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import shutil

import numpy as np
import pytest
from safetensors.numpy import load_file

ROOT = Path(__file__).resolve().parents[3]
#: Not copied: what is built, what git keeps, and what other tests may be writing meanwhile.
BUILT = shutil.ignore_patterns(
    *('.git', '.venv*', 'build', 'install', 'log', '.*_cache', '.hypothesis', '__pycache__')
)
#: What is driven: the whole lap in one process and over ROS, and the beginning of a training.
LAP = ('lap', '--seed', '1', '--lane', 'outer')
TRAINING = ('train', 'rstdp', '--scenario', '1', '--seed', '1', '--steps', '1500')

Run = Callable[..., str]


def drive(run: Run, root: Path, folder: Path, **variables: str) -> Path:
    """Drive the lap and learn with a repository's command; return the folder of the runs."""
    command = root / 'spikelane'
    run(command, *LAP, '--transport', 'inprocess', '--out', folder / 'lap', **variables)
    run(command, *LAP, '--out', folder / 'ros', **variables)
    training = [*TRAINING, '--transport', 'inprocess', '--out', folder / 'training']
    run(command, *training, **variables)
    return folder


def not_copied(folder: str, names: list[str]) -> set[str]:
    """Return what is left out of a copy of the repository; what runs left is in its root alone."""
    return BUILT(folder, names) | ({'runs'} if Path(folder) == ROOT else set())


@pytest.fixture(scope='module')
def driven(run_anew: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give what the Python that runs this drives."""
    return drive(run_anew, ROOT, tmp_path_factory.mktemp('driven'))


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_another_python_is_set_up_and_drives_the_same(
    further_python: str, driven: Path, run_anew: Run, tmp_path: Path
) -> None:
    """Nothing is compiled but the messages; trajectories and weights are the same to the bit."""
    root = tmp_path / 'a repository'
    shutil.copytree(ROOT, root, symlinks=True, ignore=not_copied)
    run_anew(root / 'setup/bootstrap', 'run', PYTHON=further_python)
    there = drive(run_anew, root, tmp_path / 'driven', PYTHON=further_python)
    first = (driven / 'lap/trajectory.csv').read_bytes()
    for lap in (driven / 'ros', there / 'lap', there / 'ros'):
        assert (lap / 'trajectory.csv').read_bytes() == first
    assert len(first.splitlines()) > 4000
    checkpoint = 'training/checkpoint.safetensors'
    expected, learnt = load_file(driven / checkpoint), load_file(there / checkpoint)
    assert learnt.keys() == expected.keys()
    for name in expected:
        np.testing.assert_array_equal(learnt[name], expected[name])
