"""How requirements are installed: by uv, from where pip would take them."""

from __future__ import annotations

from collections.abc import Sequence
import importlib.util
from pathlib import Path
import subprocess
import sys
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[3]
#: What `pip config list` prints.
LISTED = """\
:env:.cert='/etc/ca.crt'
:env:.find-links='/opt/wheels /more'
global.extra-index-url='file:///a\\nfile:///b'
global.find-links='/not/these'
install.no-compile='true'
list.format='columns'
"""


@pytest.fixture
def install() -> ModuleType:
    """Return the script as a module."""
    spec = importlib.util.spec_from_file_location('install', ROOT / 'setup/install.py')
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_variable_counts_more_than_a_file(install: ModuleType) -> None:
    """As it does for pip; other commands' settings are passed over."""
    assert install.pip_settings(LISTED) == {
        'cert': '/etc/ca.crt',
        'extra-index-url': 'file:///a\nfile:///b',
        'find-links': '/opt/wheels /more',
        'no-compile': 'true',
    }


def test_uv_is_told_where_pip_would_look(install: ModuleType) -> None:
    """Each value by itself, and the certificates in a variable."""
    settings = install.pip_settings(LISTED) | {'constraint': 'versions.txt'}
    assert list(install.uv_options(settings)) == [
        *('--index=file:///a', '--index=file:///b'),
        *('--find-links=/opt/wheels', '--find-links=/more'),
        *('--constraints=versions.txt', '--build-constraints=versions.txt'),
    ]
    assert install.uv_variables(settings) == {'SSL_CERT_FILE': '/etc/ca.crt'}


class Programs:
    """Notes which programs are called, and answers for pip's settings."""

    def __init__(self, install: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
        """Replace what starts programs."""
        self.listed = ''
        self.failing = 'nothing'
        self.calls: list[str] = []
        monkeypatch.setattr(install.subprocess, 'run', self._run)
        monkeypatch.setattr(install, 'sees_other_packages', lambda: False)

    def _run(self, command: Sequence[str], **_: Any) -> subprocess.CompletedProcess[str]:
        said = ' '.join([Path(command[0]).name, *command[1:]])
        if 'config list' not in said:
            self.calls.append(said)
        status = 3 if self.failing in said else 0
        return subprocess.CompletedProcess(command, status, self.listed, '')


@pytest.fixture
def programs(install: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Programs:
    """Return the programs that are called."""
    return Programs(install, monkeypatch)


def test_uv_comes_first_and_does_the_rest(install: ModuleType, programs: Programs) -> None:
    """For the Python that runs the script, or for another."""
    assert install.main(['-r', 'run.txt']) == 0
    first, then = programs.calls
    assert first.endswith(' uv')
    assert ' pip install ' in first
    assert then.startswith('uv pip install ')
    strategy = '--index-strategy=unsafe-best-match'
    assert then.endswith(f' --python {sys.executable} {strategy} -r run.txt')
    assert install.main(['--python', '/other', 'a.whl']) == 0
    assert programs.calls[-1].endswith(f' {strategy} --python /other a.whl')
    assert programs.calls[-1].count('--python') == 1


@pytest.mark.parametrize('failing', [' uv', 'uv pip'])
def test_a_failure_is_passed_on(install: ModuleType, programs: Programs, failing: str) -> None:
    """That of pip, which brings uv, and that of uv."""
    programs.failing = failing
    assert install.main(['-r', 'run.txt']) == 3


@pytest.mark.parametrize('why', ['an unknown setting', 'an installed ROS'])
def test_pip_does_it_where_uv_would_do_it_otherwise(
    install: ModuleType, programs: Programs, monkeypatch: pytest.MonkeyPatch, why: str
) -> None:
    """With a setting that uv has no option for, and where packages lie outside."""
    if why == 'an unknown setting':
        programs.listed = "global.no-index='true'\n"
    else:
        monkeypatch.setattr(install, 'sees_other_packages', lambda: True)
    assert install.main(['-r', 'run.txt']) == 0
    [only] = programs.calls
    assert ' pip install ' in only
    assert only.endswith(' --retries=2 -r run.txt')


@pytest.mark.parametrize(('option', 'sees'), [([], False), (['--system-site-packages'], True)])
def test_it_is_seen_whether_an_environment_has_other_packages(
    tmp_path: Path, option: list[str], sees: bool
) -> None:
    """In real ones."""
    environment = [sys.executable, '-m', 'venv', '--without-pip', *option, str(tmp_path)]
    subprocess.run(environment, check=True)
    code = (
        f'import sys; sys.path.insert(0, {str(ROOT / "setup")!r}); import install; '
        'print(install.sees_other_packages())'
    )
    done = subprocess.run(
        [tmp_path / 'bin/python', '-I', '-c', code], capture_output=True, text=True, check=True
    )
    assert done.stdout == f'{sees}\n'
