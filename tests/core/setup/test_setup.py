"""Setting up: what is done, what is left alone, and what is said when it cannot be done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import metadata
import importlib.util
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
from types import ModuleType
from typing import Any

from packaging.requirements import Requirement
import pytest

ROOT = Path(__file__).resolve().parents[3]
WHEELS = 'wheels.txt'
PATHS = (
    'PATH',
    'AMENT_PREFIX_PATH',
    'LD_LIBRARY_PATH',
    'PYTHONPATH',
    'FASTRTPS_DEFAULT_PROFILES_FILE',
)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Return a copy of what set-up reads, in a path with a space."""
    root = tmp_path / 'a tree'
    for folder in ('setup', 'requirements', 'msgs', 'sim_bridge/config'):
        shutil.copytree(ROOT / folder, root / folder)
    shutil.copy(ROOT / 'pyproject.toml', root)
    for name in ('package.xml', 'setup.py', 'setup.cfg'):
        shutil.copy(ROOT / 'sim_bridge' / name, root / 'sim_bridge')
    module = root / 'sim_bridge/spikelane_sim'
    module.mkdir()
    (module / '__init__.py').touch()
    source = root / 'ros2_ws/src'
    source.mkdir(parents=True)
    (source / 'msgs').symlink_to('../../msgs')
    (source / 'sim_bridge').symlink_to('../../sim_bridge')
    return root


@pytest.fixture
def bootstrap(tree: Path) -> ModuleType:
    """Return set-up's module, at home in the tree."""
    spec = importlib.util.spec_from_file_location('bootstrap', tree / 'setup/bootstrap.py')
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # NamedTuple looks its module up.
    sys.modules['bootstrap'] = module
    spec.loader.exec_module(module)
    return module


class Machine:
    """Stands in for what installs and builds; notes what they are called for."""

    def __init__(self, bootstrap: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
        """Replace what starts programs, except for the questions to Python."""
        self.calls: list[str] = []
        self.failing = ''
        self.has_browser = True
        self._bootstrap = bootstrap
        monkeypatch.setattr(bootstrap, 'run', self._run)
        monkeypatch.setattr(bootstrap, 'repair_cmake_files', lambda: None)
        monkeypatch.setattr(bootstrap, 'check_machine', lambda ros: None)
        monkeypatch.setattr(bootstrap, 'has_browser', lambda: self.has_browser)
        for name in ('AMENT_PREFIX_PATH', 'PYTHON'):
            monkeypatch.delenv(name, raising=False)

    def _run(self, command: Sequence[str], name: str, variables: Mapping[str, str]) -> None:
        arguments = [Path(word).name for word in command if word.endswith('.txt')]
        if name == 'colcon':
            between = command[command.index('--paths') + 1 : command.index('--cmake-args')]
            arguments = [Path(word).name for word in between if not word.startswith('--')]
        if name == 'browser':
            arguments = []
        self.calls.append(' '.join([name, *arguments]))
        if name == self.failing:
            raise self._bootstrap.SetupError(name)
        made = {'venv': '.venv/bin/python', 'colcon': 'ros2_ws/install/local_setup.bash'}
        if name in made:
            file: Path = self._bootstrap.ROOT / made[name]
            file.parent.mkdir(parents=True, exist_ok=True)
            file.touch()

    def calls_of(self, purpose: str) -> list[str]:
        """Return what is called when set-up is."""
        self.status_of(purpose)
        return self.calls

    def status_of(self, purpose: str) -> int:
        """Return set-up's exit status."""
        self.calls = []
        status: int = self._bootstrap.main(purpose)
        return status


@pytest.fixture
def machine(bootstrap: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Machine:
    """Return a machine on which nothing is set up."""
    return Machine(bootstrap, monkeypatch)


BUILD_ALL = 'colcon event_camera_msgs simulation_interfaces spikelane_msgs tf2_msgs sim_bridge'


def test_a_second_call_does_nothing(machine: Machine) -> None:
    """What is complete is not repeated; tests add their own requirements only."""
    assert machine.calls_of('run') == ['venv', f'install {WHEELS} run.txt', BUILD_ALL]
    assert machine.calls_of('run') == []
    assert machine.calls_of('view') == ['install view.txt']
    assert machine.calls_of('learn') == ['install learn.txt']
    assert machine.calls_of('docs') == ['install docs.txt']
    assert machine.calls_of('test') == ['install test.txt']
    assert machine.calls_of('test') == []


def test_tests_bring_a_browser_where_there_is_none(machine: Machine) -> None:
    """It is looked for at each call, as the machine's can be removed; set-up fails without one."""
    machine.calls_of('test')
    machine.has_browser = False
    assert machine.calls_of('run') == []
    assert machine.calls_of('test') == ['browser']
    machine.failing = 'browser'
    assert machine.status_of('test') == 1


def test_another_python_that_is_asked_for_is_obeyed(
    machine: Machine, bootstrap: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may have the same version; the environment's own Python does not count as another."""
    machine.calls_of('run')
    monkeypatch.setenv('PYTHON', sys.executable)
    assert machine.calls_of('run') == ['venv', f'install {WHEELS} run.txt', BUILD_ALL]
    bootstrap.PYTHON.unlink()
    bootstrap.PYTHON.symlink_to(os.path.realpath(sys.executable))
    assert machine.calls_of('run') == []


@pytest.mark.parametrize(
    ('failing', 'then'),
    [
        ('venv', ['venv', f'install {WHEELS} run.txt', BUILD_ALL]),
        ('install', [f'install {WHEELS} run.txt', BUILD_ALL]),
        ('colcon', [BUILD_ALL]),
    ],
)
def test_an_interrupted_set_up_goes_on(machine: Machine, failing: str, then: list[str]) -> None:
    """The step that did not end is repeated, those before it are not."""
    machine.failing = failing
    machine.calls_of('run')
    machine.failing = ''
    assert machine.calls_of('run') == then


@pytest.mark.parametrize(
    ('changed', 'then'),
    [
        ('msgs/tf2_msgs/msg/TFMessage.msg', ['colcon tf2_msgs']),
        ('sim_bridge/package.xml', ['colcon sim_bridge']),
        ('pyproject.toml', ['colcon sim_bridge']),
        ('sim_bridge/config/new.yaml', ['colcon sim_bridge']),
        ('sim_bridge/spikelane_sim/__init__.py', []),
        ('sim_bridge/spikelane_sim/new.py', []),
        ('requirements/run.txt', [f'install {WHEELS} run.txt']),
        ('requirements/test.txt', []),
        ('requirements/wheels.txt', [f'install {WHEELS} run.txt', BUILD_ALL]),
    ],
)
def test_a_change_repeats_what_depends_on_it(
    machine: Machine, tree: Path, changed: str, then: list[str]
) -> None:
    """Modules are linked and need no build; interfaces and manifests do, and new data files."""
    machine.calls_of('run')
    with (tree / changed).open('a') as file:
        file.write('\n')
    assert machine.calls_of('run') == then
    assert machine.calls_of('run') == []


def test_a_moved_repository_is_set_up_anew(machine: Machine, bootstrap: ModuleType) -> None:
    """Environments and builds have paths in them."""
    machine.calls_of('run')
    state = bootstrap.read_state() | {'environment': '/elsewhere, wheels for Python 3.11'}
    bootstrap.write_state(state)
    assert machine.calls_of('run') == ['venv', f'install {WHEELS} run.txt', BUILD_ALL]


def test_the_environment_s_own_python_makes_it_anew(
    bootstrap: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a copy of a repository it still runs, and is removed before it is needed."""
    link = bootstrap.VENV / 'bin/python'
    link.parent.mkdir(parents=True)
    link.symlink_to(sys.executable)
    monkeypatch.setattr(sys, 'executable', str(link))
    commands: list[Sequence[str]] = []
    monkeypatch.setattr(bootstrap, 'run', lambda command, *rest: commands.append(command))
    bootstrap.make_environment(bootstrap.Ros(None, ()), is_continued=False)
    [[python, *_]] = commands
    assert Path(python).exists()


def test_what_ros_has_is_not_built(machine: Machine, tmp_path: Path, monkeypatch: Any) -> None:
    """An installed ROS is used as it is, with those packages alone that it lacks."""
    ros = tmp_path / 'ros'
    for name in ('rclpy', 'tf2_msgs', 'simulation_interfaces'):
        (ros / 'share' / name).mkdir(parents=True)
        (ros / 'share' / name / 'package.xml').touch()
    monkeypatch.setenv('ROS_DISTRO', 'jazzy')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(ros))
    assert machine.calls_of('run') == [
        'venv',
        'install system-ros.txt run.txt',
        'colcon event_camera_msgs spikelane_msgs sim_bridge',
    ]


@pytest.mark.parametrize('distro', ['humble', None])
def test_other_ros_is_passed_over(
    bootstrap: ModuleType, tmp_path: Path, distro: str | None
) -> None:
    """Neither another distribution nor the wheels of another environment are an installed ROS."""
    (tmp_path / 'ros/share/rclpy').mkdir(parents=True)
    variables = {'ROS_DISTRO': distro or 'jazzy', 'AMENT_PREFIX_PATH': str(tmp_path / 'ros')}
    if distro is None:
        (tmp_path / 'ros/pyvenv.cfg').touch()
    assert bootstrap.find_ros(variables).prefix is None


def say(*command: str, **variables: str) -> str:
    """Return what a command says, which must fail with one line."""
    done = subprocess.run(
        command, env=variables, capture_output=True, text=True, timeout=30, check=False
    )
    assert done.returncode == 1
    assert done.stdout == ''
    assert done.stderr.count('\n') == 1
    return done.stderr


def fake(path: Path, script: str) -> str:
    """Write a program and return its path."""
    path.write_text(f'#!/bin/sh\n{script}\n')
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    ('script', 'fault'),
    [
        (None, 'is not found'),
        ('echo 3.9', 'is Python 3.9'),
        ('echo 3.14', 'is Python 3.14'),
        ('exit 1', 'does not run'),
        ('echo "libpython.so: not found" >&2; exit 127', 'does not run (libpython.so: not found)'),
    ],
)
def test_wrong_python_is_refused_in_one_line(
    tree: Path, tmp_path: Path, script: str | None, fault: str
) -> None:
    """It says what is wrong with it, and which will do."""
    python = str(tmp_path / 'python3')
    if script is not None:
        fake(Path(python), script)
    said = say(str(tree / 'setup/bootstrap'), 'run', PYTHON=python, PATH=os.defpath)
    assert said == (
        f'set-up: Python 3.10, 3.11, 3.12 or 3.13 is needed, but {python} {fault}: '
        'choose another with PYTHON=/path/to/python3\n'
    )


def test_a_machine_without_a_python_is_told_what_was_tried(tree: Path, tmp_path: Path) -> None:
    """With what to install."""
    for name in ('dirname', 'head'):
        (tmp_path / name).symlink_to(str(shutil.which(name)))
    fake(tmp_path / 'python3', 'echo 3.9')
    fake(tmp_path / 'python3.12', 'echo "pyenv: python3.12: command not found" >&2; exit 127')
    said = say('/bin/sh', str(tree / 'setup/bootstrap'), 'run', PATH=str(tmp_path))
    assert said == (
        'set-up: Python 3.10, 3.11, 3.12 or 3.13 is needed, but python3 is Python 3.9, '
        'python3.12 does not run (pyenv: python3.12: command not found), '
        'python3.13 is not found, python3.11 is not found, python3.10 is not found: '
        'sudo apt install python3-venv python3-dev, or PYTHON=/path/to/python3 make run\n'
    )


def test_missing_compiler_is_told_in_one_line(tree: Path, tmp_path: Path) -> None:
    """It says what to install."""
    said = say(sys.executable, str(tree / 'setup/bootstrap.py'), 'run', PATH=str(tmp_path))
    assert said == 'set-up: no C compiler: sudo apt install build-essential\n'


@pytest.mark.parametrize(
    ('lacking', 'package'), [('ensurepip', 'python3-venv'), ('Python.h', 'python3-dev')]
)
def test_missing_part_of_python_is_told(
    bootstrap: ModuleType, tmp_path: Path, monkeypatch: Any, lacking: str, package: str
) -> None:
    """Debian ships Python in parts."""
    python = fake(tmp_path / 'python3', f'echo {lacking}')
    monkeypatch.setattr(bootstrap, 'base_python', lambda ros: python)
    with pytest.raises(bootstrap.SetupError, match=f'sudo apt install {package}$'):
        bootstrap.check_machine(bootstrap.Ros(None, ()))


@pytest.mark.parametrize(
    ('output', 'said'),
    [
        ("broken by 'NewConnectionError(...)'", 'no network: the package index'),
        ('ERROR: No space left on device', 'pip ended with status 3: ERROR: No space left'),
        ('', 'pip ended with status 3 '),
    ],
)
def test_failing_pip_is_told_in_one_line(
    bootstrap: ModuleType, tmp_path: Path, output: str, said: str
) -> None:
    """All of its output is in a file."""
    pip = fake(tmp_path / 'pip', f'echo "{output}"; exit 3')
    with pytest.raises(bootstrap.SetupError) as error:
        bootstrap.run([pip], 'pip', os.environ)
    assert str(error.value).startswith(said)
    assert '\n' not in str(error.value)


def test_paths_of_the_wheels_maker_are_replaced(bootstrap: ModuleType) -> None:
    """CMake refuses include folders that are not there."""
    bootstrap.VENV.mkdir()
    fake_python = bootstrap.PYTHON
    fake_python.parent.mkdir()
    fake(fake_python, 'echo /inc/python3.12; echo "/site packages/numpy/inc"')
    file = bootstrap.VENV / 'share/x/cmake/x.cmake'
    file.parent.mkdir(parents=True)
    theirs = '/opt/python/cp312-cp312/include/python3.12'
    numpy = '/opt/python/cp312-cp312/lib/python3.12/site-packages/numpy/_core/include'
    file.write_text(f'INCLUDE "${{_PREFIX}}/include;{theirs};{numpy}"\n')
    bootstrap.repair_cmake_files()
    assert file.read_text() == (
        'INCLUDE "${_PREFIX}/include;/inc/python3.12;/site packages/numpy/inc"\n'
    )


def test_executables_start_in_a_path_with_spaces(bootstrap: ModuleType) -> None:
    """Linux does not understand the quotes that setuptools writes."""
    file = bootstrap.WORKSPACE / 'install/lib/spikelane_sim/simulator'
    file.parent.mkdir(parents=True)
    file.write_text('#!"/a tree/.venv/bin/python"\nprint(1)\n')
    file.chmod(0o755)
    bootstrap.repair_executables()
    assert file.read_text() == '#!/usr/bin/env python3\nprint(1)\n'
    assert os.access(file, os.X_OK)


def test_the_environment_is_the_same_when_sourced_twice(tree: Path) -> None:
    """Our packages come before ROS, and the loader's folders are named."""
    venv, workspace = tree / '.venv', tree / 'ros2_ws'
    (venv / 'share/rclpy').mkdir(parents=True)
    (venv / 'lib/python3.11/site-packages/ros_rcl.libs').mkdir(parents=True)
    (workspace / 'install/share/ament_index').mkdir(parents=True)
    (workspace / 'install/lib/python3.11/site-packages').mkdir(parents=True)
    (workspace / 'build/spikelane_sim/spikelane_sim.egg-info').mkdir(parents=True)
    script = f'source "{tree}/setup/env.sh"; source "{tree}/setup/env.sh"; env -0'
    done = subprocess.run(
        ['bash', '-euc', script], env={'PATH': '/usr/bin:/bin'}, capture_output=True, check=True
    )
    variables = dict(entry.split('=', 1) for entry in done.stdout.decode().split('\0') if entry)
    site = 'lib/python3.11/site-packages'
    assert {name: variables[name].replace(str(tree), '.').split(':') for name in PATHS} == {
        'PATH': ['./.venv/bin', '/usr/bin', '/bin'],
        'AMENT_PREFIX_PATH': ['./ros2_ws/install', './.venv'],
        'LD_LIBRARY_PATH': [
            './ros2_ws/install/lib',
            './.venv/lib',
            f'./.venv/{site}/ros_rcl.libs',
        ],
        'PYTHONPATH': ['./ros2_ws/build/spikelane_sim', f'./ros2_ws/install/{site}'],
        'FASTRTPS_DEFAULT_PROFILES_FILE': [
            './sim_bridge/spikelane_sim/nodes/fastdds/spikelane_loopback.xml'
        ],
    }
    assert variables['_ROS_WHEELS_BOOTSTRAP_COMPLETE'] == '1'


@pytest.mark.parametrize('own', ['', '/elsewhere'])
def test_bytecode_is_kept_within_the_environment(tree: Path, own: str) -> None:
    """No bytecode is written next to the sources."""
    (tree / '.venv/share/rclpy').mkdir(parents=True)
    variables = {'PATH': '/usr/bin:/bin', 'PYTHONDONTWRITEBYTECODE': '1'}
    if own:
        variables['PYTHONPYCACHEPREFIX'] = own
    script = f'source "{tree}/setup/env.sh"; env | grep -E "^PYTHON(DONT|PYC)"'
    done = subprocess.run(
        ['bash', '-euc', script], env=variables, capture_output=True, text=True, check=True
    )
    assert done.stdout == f'PYTHONPYCACHEPREFIX={own or tree / ".venv/pycache"}\n'


@pytest.mark.parametrize(
    ('words', 'purposes'),
    [
        ('lap --controller dqn', ['run']),
        ('train rstdp', ['run']),
        ('train dqn --help', ['run']),
        ('transfer', ['run']),
        ('view --controller rstdp', ['view']),
        ('view --help', ['run']),
        ('node viewer', ['view']),
        ('node dqn', ['run']),
        ('', ['run']),
        ('view --controller dqn --train', ['view']),
    ],
)
def test_a_command_sets_up_what_it_needs(tmp_path: Path, words: str, purposes: list[str]) -> None:
    """Rerun is large, so that only users of `spikelane view` wait for it."""
    command = shutil.copy(ROOT / 'spikelane', tmp_path)
    (tmp_path / 'setup').mkdir()
    asked = tmp_path / 'asked'
    fake(tmp_path / 'setup/bootstrap', f'echo $1 >> "{asked}"')
    (tmp_path / 'setup/env.sh').write_text('exit 0')
    subprocess.run([command, *words.split()], cwd=ROOT, check=True)
    assert asked.read_text().split() == purposes


def test_every_version_is_pinned() -> None:
    """Each requirement has one exact version, in its list or among the constraints."""
    pins = requirements('constraints.txt')
    assert len(pins) > 200
    assert all(re.fullmatch(r'==[\w.]+', version) for version in pins.values())
    for name in (WHEELS, 'system-ros.txt', 'run.txt', 'docs.txt', 'test.txt'):
        for package, version in requirements(name).items():
            assert version.startswith('==') or package in pins, f'{name}: {package} is not pinned'
            assert not (version and package in pins), f'{name}: {package} is pinned twice'


def test_the_lists_are_the_dependencies_of_the_library() -> None:
    """Those in pyproject.toml, which colcon has put into the packages' metadata."""
    needed: dict[str, set[str]] = {}
    for text in metadata.requires('spikelane') or []:
        requirement = Requirement(text)
        extra = re.search(r'extra == .(\w+)', str(requirement.marker))
        needed.setdefault(extra[1] if extra else '', set()).add(requirement.name.lower())
    # NumPy's version is that of ROS.
    assert needed[''] == {*requirements('run.txt'), 'numpy', 'setuptools'}
    assert needed['learn'] == set(requirements('learn.txt'))
    assert needed['view'] < set(requirements('view.txt'))
    assert needed['nir'] | needed['ray'] | needed['sb3'] < set(requirements('test.txt'))


def test_pybullet_has_one_wheel_for_each_python() -> None:
    """Both distributions own the same module; the one has no wheels from Python 3.12 on."""
    lines = [line.split('#')[0].strip() for line in (ROOT / 'requirements/run.txt').open()]
    assert [line for line in lines if line.startswith('pybullet')] == [
        "pybullet; python_version < '3.12'",
        "pybullet-arm64; python_version >= '3.12'",
    ]


def requirements(name: str) -> dict[str, str]:
    """Return a list's packages, by pip's canonical names, and what follows them."""
    lines = [line.split('#')[0].strip() for line in (ROOT / 'requirements' / name).open()]
    lines = [line.split(';')[0] for line in lines]  # without the Python it is for
    matches = [re.match(r'([\w.-]+)(?:\[\w+\])?(.*)', line) for line in lines if line]
    return {
        re.sub('[-_.]+', '-', match[1]).lower(): match[2] for match in matches if match is not None
    }
