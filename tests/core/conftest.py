"""What tests of the core share: this machine's Pythons, commands as in a new shell, figures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import functools
import os
from pathlib import Path
import shutil
import subprocess
import sys
from typing import Any

import pytest

from spikelane_sim import figure_style

#: The minor versions of Python 3 that are supported.
MINORS = (10, 11, 12, 13)
VENV = Path(__file__).resolve().parents[2] / '.venv'
#: Variables that commands as from a new shell keep begin so: where packages come from.
KEPT = ('PIP_', 'UV_', 'OPENBLAS_', 'http', 'HTTP', 'REQUESTS_')
PROBE = 'import sys, ensurepip; print(sys.version_info[1], sys.base_prefix)'

#: Runs a command, which must succeed, with some variables; returns its standard error.
Run = Callable[..., str]


@functools.cache
def pythons() -> dict[int, str]:
    """Return one Python of each version that is supported, by minor version."""
    return {minor: found for minor in MINORS for found in [*_of_version(minor)][:1]}


def _of_version(minor: int) -> Iterator[str]:
    name = f'python3.{minor}'
    if minor == sys.version_info[1]:
        yield os.path.realpath(sys.executable)
    pyenv = Path(os.environ.get('PYENV_ROOT', Path.home() / '.pyenv'))
    found = [str(path) for path in sorted(pyenv.glob(f'versions/3.{minor}.*/bin/{name}'))]
    for python in [*found, shutil.which(name) or '']:
        if python and _runs(python, minor):
            yield python


def _runs(python: str, minor: int) -> bool:
    done = subprocess.run([python, '-c', PROBE], capture_output=True, text=True, check=False)
    return done.returncode == 0 and done.stdout.startswith(f'{minor} ')


def further_pythons() -> dict[int, str]:
    """Return those of `pythons` that do not run the tests."""
    return {minor: path for minor, path in pythons().items() if minor != sys.version_info[1]}


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Repeat tests with the argument `further_python` for all but the Python that runs them."""
    if 'further_python' in metafunc.fixturenames:
        found = [
            pytest.param(path, id=f'python3.{minor}') for minor, path in further_pythons().items()
        ]
        reason = 'no other Python that is supported'
        none = pytest.param('', marks=pytest.mark.skip(reason=reason))
        metafunc.parametrize('further_python', found or [none])


@pytest.fixture(scope='session')
def other_pythons() -> list[str]:
    """Give all values of `further_python`."""
    return list(further_pythons().values())


@pytest.fixture(scope='session')
def run_anew() -> Run:
    """Give what runs a command as from a new shell, which must succeed."""
    return _run_anew


def _run_anew(*command: str | Path, cwd: Path | None = None, **variables: str) -> str:
    kept = ('PATH', 'HOME', 'LANG', 'TMPDIR', 'SSL_CERT_FILE')
    environment = {
        name: value
        for name, value in os.environ.items()
        if name in kept
        or name.startswith(('PIP_', 'UV_', 'OPENBLAS_', 'http', 'HTTP', 'REQUESTS_'))
    }
    path = environment['PATH'].split(os.pathsep)
    environment['PATH'] = os.pathsep.join(each for each in path if not each.startswith(str(VENV)))
    environment |= variables
    done = subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert 'pybullet build time' not in done.stdout + done.stderr
    return done.stderr


@pytest.fixture
def drawn_figures(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Give a list to which every figure of matplotlib that is saved is added."""
    figures: list[Any] = []
    save = figure_style.save

    def keep(figure: Any, path: Path) -> tuple[Path, ...]:
        figures.append(figure)
        return save(figure, path)

    monkeypatch.setattr(figure_style, 'save', keep)
    return figures
