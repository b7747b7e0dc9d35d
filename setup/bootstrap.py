"""Set up what is missing: virtual environment, pinned packages, built workspace.

Called by `setup/bootstrap run|learn|view|docs|test`; needs nothing but Python 3.10 to 3.13. What
is complete is noted in .venv/spikelane.json step by step, so that an interrupted set-up is
continued, and that a change of a requirement or an interface repeats what depends on it and
nothing else.

Where ROS 2 Jazzy is sourced, the environment is put on top of it; elsewhere ROS comes from wheels.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import contextlib
import fcntl
import hashlib
import json
import os
from pathlib import Path
import platform
import re
import shutil
import signal
import subprocess
import sys
import time
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / '.venv'
PYTHON = VENV / 'bin' / 'python'
REQUIREMENTS = ROOT / 'requirements'
WORKSPACE = ROOT / 'ros2_ws'
STATE = VENV / 'spikelane.json'

#: What pip and uv write when they cannot reach the package index.
_NO_NETWORK = re.compile(
    'NewConnectionError|NameResolutionError|ConnectTimeoutError|ProxyError|Network is unreachable'
    '|dns error|error sending request|tcp connect error'
)
#: Run by the Python that is to be used: what does it lack?
_PROBE = """
import importlib.util, os, sysconfig
for name in ('ensurepip', 'rclpy', 'colcon_core'):
    if importlib.util.find_spec(name) is None:
        print(name)
if not os.path.exists(os.path.join(sysconfig.get_path('include'), 'Python.h')):
    print('Python.h')
"""
_LOCATIONS = """
import numpy, sysconfig
print(sysconfig.get_path('include'), numpy.get_include(), sep='\\n')
"""


class SetupError(Exception):
    """Set-up cannot go on; the message says in one line what is needed."""


class Ros(NamedTuple):
    """Where ROS comes from."""

    prefix: Path | None  # of the installed ROS that is sourced, None for the wheels in .venv
    underlays: tuple[Path, ...]  # all prefixes below our workspace


# ------------------------------------------------------------------------------------ the plan


def set_up(purpose: str) -> None:
    """Set up what is missing for running, for another purpose as well.

    Raises:
        SetupError: Something is needed that only the user can install.
    """
    set_up_packages(purpose, find_ros(os.environ))
    if purpose == 'test' and not has_browser():
        with step('installing Chromium for the tests of pages'):
            run(['sh', str(ROOT / 'setup/browser')], 'browser', os.environ)


def set_up_packages(purpose: str, ros: Ros) -> None:
    """Set up the environment, the packages in it and the workspace."""
    state = read_state()
    environment = f'{ROOT}, {ros.prefix or f"wheels for Python {_version()}"}'
    is_kept = state.get('environment') == environment and _is_of_chosen_python(ros)
    lists = wanted_lists(purpose, ros)
    missing = list(lists)
    if is_kept:
        missing = [name for name in lists if state.get(name) != lists[name].fingerprint]
        if not missing and not outdated_packages(state, ros):
            return
    check_machine(ros)
    if not is_kept:
        make_environment(ros, is_continued=not state and _is_for_this_python(ros))
        state = {'environment': environment}
        write_state(state)
    if missing:
        install_lists([lists[name] for name in missing])
        if ros.prefix is None:
            repair_cmake_files()
        state |= {name: lists[name].fingerprint for name in missing}
        write_state(state)
    build_workspace(state, ros)


class RequirementLists(NamedTuple):
    """Files of requirements that are installed together."""

    files: tuple[Path, ...]
    is_closed: bool = False  # names all that it needs

    @property
    def fingerprint(self) -> str:
        """Changes when a requirement or a version does."""
        return digest(*self.files, REQUIREMENTS / 'constraints.txt')


def wanted_lists(purpose: str, ros: Ros) -> dict[str, RequirementLists]:
    """Return the requirements by purpose; what tests has all, all also run."""
    base = 'wheels.txt' if ros.prefix is None else 'system-ros.txt'
    lists = {'run': RequirementLists((REQUIREMENTS / base, REQUIREMENTS / 'run.txt'))}
    if purpose in ('learn', 'test'):
        lists['learn'] = RequirementLists((REQUIREMENTS / 'learn.txt',))
    if purpose in ('view', 'test'):
        lists['view'] = RequirementLists((REQUIREMENTS / 'view.txt',), is_closed=True)
    if purpose in ('docs', 'test'):
        lists['docs'] = RequirementLists((REQUIREMENTS / 'docs.txt',))
    if purpose == 'test':
        lists['test'] = RequirementLists((REQUIREMENTS / 'test.txt',))
    return lists


def find_ros(variables: Mapping[str, str]) -> Ros:
    """Return the ROS that is sourced, if it is installed and not some environment's wheels."""
    prefixes = tuple(
        Path(text)
        for text in variables.get('AMENT_PREFIX_PATH', '').split(':')
        if text and not Path(text).resolve().is_relative_to(ROOT)
    )
    if variables.get('ROS_DISTRO') == 'jazzy':
        for prefix in prefixes:
            if (prefix / 'share/rclpy').is_dir() and not (prefix / 'pyvenv.cfg').exists():
                return Ros(prefix, prefixes)
    return Ros(None, (VENV,))


# ------------------------------------------------------------------------------- the machine


def check_machine(ros: Ros) -> None:
    """Check what only the user can install.

    Raises:
        SetupError: Something is missing.
    """
    if any(character in str(ROOT) for character in ':;'):
        raise SetupError(f'the path {ROOT} must not contain ":" or ";": move the repository')
    if ros.prefix is None and (sys.platform, platform.machine()) != ('linux', 'x86_64'):
        raise SetupError('ROS wheels are for Linux on x86-64: install and source ROS 2 Jazzy')
    for language, variable, names in (
        ('C', 'CC', ('cc', 'gcc', 'clang')),
        ('C++', 'CXX', ('c++', 'g++', 'clang++')),
    ):
        if variable not in os.environ and not any(map(shutil.which, names)):
            raise SetupError(f'no {language} compiler: sudo apt install build-essential')
    _check_python(ros)


def _check_python(ros: Ros) -> None:
    python = base_python(ros)
    probe = subprocess.run([python, '-c', _PROBE], capture_output=True, text=True, check=False)
    if probe.returncode:
        raise SetupError(f'{python} does not run: choose another, PYTHON=/path/to/python3')
    lacks = probe.stdout.split()
    if 'ensurepip' in lacks:
        raise SetupError(f'no venv module for {python}: sudo apt install python3-venv')
    if 'Python.h' in lacks:
        raise SetupError(f'no C headers of {python}: sudo apt install python3-dev')
    if ros.prefix is None:
        return
    if 'rclpy' in lacks:
        raise SetupError(f'{python} lacks the rclpy of {ros.prefix}: PYTHON=/path/to/python3')
    if 'colcon_core' in lacks or not shutil.which('cmake'):
        raise SetupError('no colcon or CMake: sudo apt install ros-dev-tools')


def base_python(ros: Ros) -> str:
    """Return the interpreter that the environment is made with."""
    if ros.prefix is not None and not os.environ.get('PYTHON'):
        return '/usr/bin/python3'  # what an installed ROS is made for
    return os.path.realpath(sys.executable)


# ----------------------------------------------------------------------- the environment


def make_environment(ros: Ros, is_continued: bool) -> None:
    """Make the virtual environment.

    Args:
        ros: ROS to be seen in it.
        is_continued: Whether to complete what is there, as its making was interrupted.
    """
    python = base_python(ros)  # now: what runs this may be the link that is removed
    if VENV.exists() and not is_continued:
        with step('removing the environment of another Python, ROS or path'):
            for folder in (VENV, WORKSPACE / 'build', WORKSPACE / 'install'):
                shutil.rmtree(folder, ignore_errors=True)
    command = [python, '-m', 'venv', str(VENV)]
    if ros.prefix is not None:
        command.append('--system-site-packages')
    with step(f'making .venv with {command[0]}'):
        run(command, 'venv', os.environ)


def _is_of_chosen_python(ros: Ros) -> bool:
    """Whether .venv is there and of the Python that PYTHON names, if it names one."""
    is_chosen = not os.environ.get('PYTHON') or os.path.realpath(PYTHON) == base_python(ros)
    return PYTHON.exists() and is_chosen


def _is_for_this_python(ros: Ros) -> bool:
    folders = {path.name for path in VENV.glob('lib/python3.*')}
    return ros.prefix is None and folders <= {f'python{_version()}'}


def install_lists(lists: Sequence[RequirementLists]) -> None:
    """Install lists of requirements, those that are closed by themselves."""
    for is_closed in (False, True):
        files = [file for each in lists if each.is_closed is is_closed for file in each.files]
        if files:
            install(*files, is_closed=is_closed)


def install(*files: Path, is_closed: bool = False) -> None:
    """Install requirements, and what they ask for unless they are closed (`install.py`).

    Raises:
        SetupError: They cannot be installed.
    """
    names = ', '.join(file.name for file in files)
    # Through the environment, the versions also hold for what is built. They are split at spaces,
    # hence relative.
    variables = os.environ | {
        'PIP_CONSTRAINT': str((REQUIREMENTS / 'constraints.txt').relative_to(ROOT)),
        'PIP_USER': '0',
        '_ROS_WHEELS_BOOTSTRAP_COMPLETE': '1',
    }
    command = [str(PYTHON), '-I', str(ROOT / 'setup/install.py'), *['--no-deps'] * is_closed]
    command += [part for file in files for part in ('-r', str(file))]
    with step(f'installing {names}'):
        run(command, 'install', variables)


def repair_cmake_files() -> None:
    """Put this machine's paths where the wheels' CMake files have those of their maker."""
    locations = subprocess.run(
        [str(PYTHON), '-I', '-c', _LOCATIONS], capture_output=True, text=True, check=True
    )
    include, numpy_include = locations.stdout.splitlines()
    for file in (VENV / 'share').rglob('*.cmake'):
        text = file.read_text(errors='surrogateescape')
        if '/opt/python/' not in text:
            continue
        text = re.sub(r'/opt/python/[^;"]*/numpy/_core/include', lambda _: numpy_include, text)
        text = re.sub(r'/opt/python/[^;"]*/include/python3\.\d+', lambda _: include, text)
        write_whole(file, text)


# ------------------------------------------------------------------------- the workspace


def build_workspace(state: dict[str, Any], ros: Ros) -> None:
    """Build the packages that have changed, all of them where what they are built on has.

    Raises:
        SetupError: A package cannot be built.
    """
    packages = outdated_packages(state, ros)
    if state.get('workspace') != workspace_fingerprint(ros):
        for folder in ('build', 'install'):
            shutil.rmtree(WORKSPACE / folder, ignore_errors=True)
        state |= {'workspace': workspace_fingerprint(ros), 'packages': {}}
        write_state(state)
    if not packages:
        return
    paths = [str(path.relative_to(WORKSPACE)) for path in packages]
    with step(f'building {", ".join(path.name for path in packages)}'):
        remove_dangling_links()
        run(_colcon(paths, ros), 'colcon', _without_make(os.environ))
        repair_executables()
    state['packages'] |= {str(path.relative_to(WORKSPACE)): packages[path] for path in packages}
    write_state(state)


def remove_dangling_links() -> None:
    """Forget files that are no longer in the source, at which setuptools would fail."""
    for folder in ('build', 'install'):
        for path in (WORKSPACE / folder).rglob('*'):
            if path.is_symlink() and not path.exists():
                path.unlink()


def repair_executables() -> None:
    """Let the system start our executables where the repository's path has spaces.

    setuptools then quotes the path of Python in their first line, which Linux does not understand.
    """
    for folder in ('install', 'install/*'):
        for file in WORKSPACE.glob(f'{folder}/lib/spikelane*/*'):
            if file.is_file() and file.read_bytes().startswith(b'#!"'):
                mode = file.stat().st_mode
                write_whole(file, re.sub('^#!.*', '#!/usr/bin/env python3', file.read_text()))
                file.chmod(mode)


def _colcon(paths: Sequence[str], ros: Ros) -> list[str]:
    arguments = ['build', '--symlink-install', '--paths', *paths]
    cmake = [f'-DPython3_EXECUTABLE={PYTHON}', '-DBUILD_TESTING=OFF']
    if ros.prefix is None:
        arguments += ['--merge-install']
        cmake += ['-GNinja', '-DPYTHON_ONLY=ON']
    script = 'source "$0/setup/underlay.sh" && cd "$0/ros2_ws" && exec python -m colcon "$@"'
    return ['bash', '-c', script, str(ROOT), *arguments, '--cmake-args', *cmake]


def _without_make(variables: Mapping[str, str]) -> dict[str, str]:
    """Return the variables without those that `make` passes on to a `make` it starts."""
    return {name: value for name, value in variables.items() if not name.startswith('MAKE')}


def outdated_packages(state: Mapping[str, Any], ros: Ros) -> dict[Path, str]:
    """Return the packages that must be built, and their fingerprints."""
    built: Mapping[str, str] = state.get('packages', {})
    is_there = (WORKSPACE / 'install/local_setup.bash').exists()
    if not is_there or state.get('workspace') != workspace_fingerprint(ros):
        built = {}
    fingerprints = {path: package_fingerprint(path) for path in our_packages(ros)}
    return {
        path: fingerprint
        for path, fingerprint in fingerprints.items()
        if built.get(str(path.relative_to(WORKSPACE))) != fingerprint
    }


def our_packages(ros: Ros) -> list[Path]:
    """Return the folders of the workspace's packages that ROS does not have already."""
    source = WORKSPACE / 'src'
    found = sorted([*source.glob('*/package.xml'), *source.glob('*/*/package.xml')])
    return [file.parent for file in found if not _is_in(ros, file)]


def _is_in(ros: Ros, manifest: Path) -> bool:
    name = re.search(r'<name>\s*(\S+?)\s*</name>', manifest.read_text())
    return name is not None and any(
        (prefix / 'share' / name[1] / 'package.xml').exists() for prefix in ros.underlays
    )


def workspace_fingerprint(ros: Ros) -> str:
    """Return what all packages are built on: another value means to build all of them anew."""
    base = wanted_lists('run', ros)['run'].files[0]
    names = ' '.join(path.name for path in our_packages(ros))
    return f'{digest(base)} {names}'


def package_fingerprint(package: Path) -> str:
    """Return what a package's build depends on.

    Modules and data of Python packages are linked, so that only their names count.
    """
    files = [path for path in sorted(package.rglob('*')) if path.is_file()]
    if (package / 'CMakeLists.txt').exists():
        return digest(*files, relative_to=package)
    recipe = [path for path in files if path.name in ('package.xml', 'setup.py', 'setup.cfg')]
    recipe += [ROOT / 'pyproject.toml', ROOT / 'setup/ros_package.py']  # what setup.py reads
    modules = {path.parent.name for path in package.glob('*/__init__.py')} | {'__pycache__'}
    names = [path.relative_to(package) for path in files]
    data = [str(name) for name in names if name.parts[0] not in modules]
    return digest(*recipe, relative_to=package) + digest_text('\n'.join(data))


def has_browser() -> bool:
    """Whether there is a browser for the tests of pages, of the machine or in .venv."""
    path = f'{VENV / "bin"}{os.pathsep}{os.environ.get("PATH", os.defpath)}'
    return any(shutil.which(name, path=path) for name in ('chromium', 'google-chrome'))


# ------------------------------------------------------------------------------ small things


def digest(*files: Path, relative_to: Path = ROOT) -> str:
    """Return a fingerprint of files' names and contents."""
    parts = [f'{os.path.relpath(file, relative_to)}\n{file.read_text()}' for file in files]
    return digest_text('\0'.join(parts))


def digest_text(text: str) -> str:
    """Return a fingerprint of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def read_state() -> dict[str, Any]:
    """Return what is complete; nothing where it was never noted or cannot be read."""
    try:
        state = json.loads(STATE.read_text())
    except (OSError, ValueError):
        return {}
    return state if isinstance(state, dict) else {}


def write_state(state: Mapping[str, Any]) -> None:
    """Note what is complete."""
    write_whole(STATE, json.dumps(state, indent=1))


def write_whole(file: Path, text: str) -> None:
    """Write a file such that it is there wholly or not at all."""
    temporary = file.with_name(f'{file.name}.new')
    temporary.write_text(text, errors='surrogateescape')
    temporary.replace(file)


def run(command: Sequence[str], name: str, variables: Mapping[str, str]) -> None:
    """Run a command at the root, its output going to .venv/NAME.log.

    Raises:
        SetupError: It failed.
    """
    VENV.mkdir(exist_ok=True)
    log = VENV / f'{name}.log'
    with (
        log.open('wb') as output,
        subprocess.Popen(
            command,
            cwd=ROOT,
            env=variables,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            close_fds=False,
            start_new_session=True,
        ) as child,
    ):
        try:
            status = child.wait()
        except KeyboardInterrupt:
            os.killpg(child.pid, signal.SIGTERM)  # it has started others
            raise
    if status == 0:
        return
    text = log.read_text(errors='replace')
    if _NO_NETWORK.search(text):
        raise SetupError('no network: the package index cannot be reached; connect and repeat')
    wrong = [line for line in text.splitlines() if re.search('error|failed', line, re.IGNORECASE)]
    said = f': {wrong[-1].strip()}' if wrong else ''
    raise SetupError(f'{name} ended with status {status}{said} (all of it: {log})')


@contextlib.contextmanager
def step(what: str) -> Iterator[None]:
    """Say what is done and how long it took, in one line."""
    start_s = time.monotonic()
    print(f'set-up: {what} ...', end='', file=sys.stderr, flush=True)
    try:
        yield
    except BaseException:
        print(file=sys.stderr)
        raise
    print(f' {time.monotonic() - start_s:.0f} s', file=sys.stderr, flush=True)


@contextlib.contextmanager
def alone() -> Iterator[None]:
    """Wait until no other set-up of this repository runs, and keep others waiting."""
    descriptor = os.open(ROOT / 'setup', os.O_RDONLY)
    # A set-up that was killed may leave pip or colcon at work: they keep the lock too.
    os.set_inheritable(descriptor, True)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print('set-up: waiting for another one to finish', file=sys.stderr, flush=True)
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _version() -> str:
    return f'{sys.version_info.major}.{sys.version_info.minor}'


def main(purpose: str) -> int:
    """Set up, and say in one line what is needed where that fails.

    Returns:
        0 done, 1 failed, 130 interrupted.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT, signal.SIGTERM))
        with alone():
            set_up(purpose)
    except (SetupError, OSError) as error:
        print(f'set-up: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('set-up: interrupted; the next call goes on from here', file=sys.stderr)
        return 130
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1]))
