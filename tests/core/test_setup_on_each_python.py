"""A real set-up on each further Python of this machine, to the same laps and trainings."""

from __future__ import annotations

from collections.abc import Iterator
import os
from pathlib import Path
import shutil
import subprocess
import sys

import numpy as np
import pytest
from safetensors.numpy import load_file

ROOT = Path(__file__).resolve().parents[2]
#: Not copied: what is built, what git keeps, what runs left.
BUILT = shutil.ignore_patterns('.git', '.venv*', 'build', 'install', 'log', 'runs', '.*_cache')
PROBE = 'import sys, ensurepip; print(sys.version_info[1], sys.base_prefix)'
#: What is driven: the whole lap in one process and over ROS, and the beginning of a training.
LAP = ('lap', '--seed', '1', '--lane', 'outer')
TRAINING = ('train', 'rstdp', '--scenario', '1', '--seed', '1', '--steps', '1500')


def further_pythons() -> Iterator[str]:
    """Yield one Python of each version that is supported, except for the one that runs this."""
    pyenv = Path(os.environ.get('PYENV_ROOT', Path.home() / '.pyenv'))
    for minor in (10, 11, 12, 13):
        name = f'python3.{minor}'
        found = [str(path) for path in sorted(pyenv.glob(f'versions/3.{minor}.*/bin/{name}'))]
        for python in [*found, shutil.which(name) or '']:
            if minor != sys.version_info[1] and python and _runs(python, minor):
                yield python
                break


def _runs(python: str, minor: int) -> bool:
    done = subprocess.run([python, '-c', PROBE], capture_output=True, text=True, check=False)
    return done.returncode == 0 and done.stdout.startswith(f'{minor} ')


PYTHONS = [pytest.param(python, id=Path(python).name) for python in further_pythons()]
NONE = pytest.param('', marks=pytest.mark.skip(reason='no other Python that is supported'))


def drive(root: Path, folder: Path, **variables: str) -> Path:
    """Drive the lap and learn with a repository's command; return the folder of the runs."""
    command = [str(root / 'spikelane')]
    run([*command, *LAP, '--transport', 'inprocess', '--out', str(folder / 'lap')], variables)
    run([*command, *LAP, '--out', str(folder / 'ros')], variables)
    train = [*command, *TRAINING, '--transport', 'inprocess', '--out', str(folder / 'training')]
    run(train, variables)
    return folder


def run(command: list[str], variables: dict[str, str]) -> str:
    """Run a command, which must succeed, as from a new shell; return its standard error."""
    kept = ('PATH', 'HOME', 'LANG', 'TMPDIR', 'SSL_CERT_FILE')
    environment = {
        name: value
        for name, value in os.environ.items()
        if name in kept or name.startswith(('PIP_', 'OPENBLAS_', 'http', 'HTTP', 'REQUESTS_'))
    }
    venv = str(ROOT / '.venv')
    path = environment['PATH'].split(os.pathsep)
    environment['PATH'] = os.pathsep.join(each for each in path if not each.startswith(venv))
    done = subprocess.run(
        command, env=environment | variables, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert 'pybullet build time' not in done.stdout + done.stderr
    return done.stderr


@pytest.fixture(scope='module')
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give what the Python that runs this drives."""
    return drive(ROOT, tmp_path_factory.mktemp('driven'))


@pytest.mark.slow
@pytest.mark.timeout(1500)
@pytest.mark.parametrize('python', PYTHONS or [NONE])
def test_another_python_is_set_up_and_drives_the_same(
    python: str, driven: Path, tmp_path: Path
) -> None:
    """Nothing is compiled but the messages; trajectories and weights are the same to the bit."""
    root = tmp_path / 'a repository'
    shutil.copytree(ROOT, root, symlinks=True, ignore=BUILT)
    run([str(root / 'setup/bootstrap'), 'run'], {'PYTHON': python})
    there = drive(root, tmp_path / 'driven', PYTHON=python)
    first = (driven / 'lap/trajectory.csv').read_bytes()
    for lap in (driven / 'ros', there / 'lap', there / 'ros'):
        assert (lap / 'trajectory.csv').read_bytes() == first
    assert len(first.splitlines()) > 4000
    checkpoint = 'training/checkpoint.safetensors'
    expected, learnt = load_file(driven / checkpoint), load_file(there / checkpoint)
    assert learnt.keys() == expected.keys()
    for name in expected:
        np.testing.assert_array_equal(learnt[name], expected[name])
