"""The wheel that `pip install .` builds, installed outside of the checkout, without ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
import csv
from email.message import Message
from email.parser import Parser
from importlib.metadata import version
import json
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
from zipfile import ZipFile

import gymnasium
import numpy as np
from packaging.requirements import Requirement
import pytest
from safetensors.numpy import load_file

from spikelane.main import run as run_here

ROOT = Path(__file__).resolve().parents[3]
CONSTRAINTS = ROOT / 'requirements/constraints.txt'
VENV = ROOT / '.venv/bin'
MODULES = (
    ROOT / 'sim_bridge/spikelane_sim',
    ROOT / 'controllers/spikelane_controllers',
    ROOT / 'ros2_ws/src/spikelane/spikelane',
)
#: A whole lap, in less than a second once everything is compiled.
LAP = ('lap', '--transport', 'inprocess', '--engine', 'kinematic', '--seed', '1')
PHYSICS_LAP = ('lap', '--transport', 'inprocess', '--lane', 'inner', '--seed', '1')
TRAINING = ('train', 'rstdp', '--seed', '1', '--steps', '1500')
#: An episode of an agent that only reads Gymnasium's documentation.
EPISODE = """
import sys
import gymnasium
import spikelane

env = gymnasium.make('spikelane/LaneKeeping-v0', scenario=2)
env.reset(seed=3)
rewards = [env.step(action)[1] for action in (1, 0, 1, 2, 1)]
env.close()
laps = spikelane.load_run('runs/lap'), spikelane.drive('braitenberg', engine='kinematic', seed=1)
assert laps[0].trajectory.equals(laps[1].trajectory)
assert not {'rclpy', 'torch'} & set(sys.modules)
print(rewards, file=sys.stderr)
"""

#: The page that Rerun's server shows; what we show in it can be imported.
VIEWER = """
from urllib.request import urlopen
import spikelane.viewer.scene
from spikelane.viewer.server import ViewerServer

with ViewerServer(0, 0) as server, urlopen(server.url) as page:
    assert b're_viewer.js' in page.read()
"""
#: Deep Q-learning with gradients from the second action on.
AT_ONCE = [
    *('--engine', 'kinematic', '--out', 'learnt'),
    *('--param', 'dqn.q_learning.random_steps=2', '--param', 'dqn.q_learning.batch_size=2'),
]
ONE_RUN = """
name: one
matrix:
  - controllers: [braitenberg]
    scenarios: [1]
    robots: [kinematic]
    seeds: 1
    tasks: {evaluate: {seeds: 1}}
"""

Run = Callable[..., str]


@pytest.fixture(scope='module')
def wheel(run_anew: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the wheel."""
    folder = tmp_path_factory.mktemp('wheel')
    run_anew(sys.executable, '-m', 'pip', 'wheel', '-q', '--no-deps', '-w', folder, ROOT)
    [made] = folder.iterdir()
    return made


@pytest.fixture(scope='module')
def metadata(wheel: Path) -> Message:
    """Give the wheel's metadata."""
    with ZipFile(wheel) as file:
        [name] = [name for name in file.namelist() if name.endswith('/METADATA')]
        return Parser().parsestr(file.read(name).decode())


@pytest.fixture(scope='module')
def here(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give what the checkout drives and learns."""
    folder = tmp_path_factory.mktemp('here')
    for name, words in (('lap', LAP), ('physics', PHYSICS_LAP), ('training', TRAINING)):
        assert run_here([*words, '--out', str(folder / name)]) == 0
    return folder


@pytest.fixture(scope='module')
def laps(
    wheel: Path,
    metadata: Message,
    other_pythons: list[str],
    run_anew: Run,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[dict[str, Future[Path]]]:
    """Give the lap of each further Python, driven while this one is tested: two cores are used."""

    def drive(python: str, folder: Path) -> Path:
        versions = lowest(metadata, folder) if is_lowest(python) else pinned(folder)
        run_anew(VENV / 'uv', 'venv', '-q', '--python', python, folder / 'venv')
        programs = folder / 'venv/bin'
        add(run_anew, programs / 'python', str(wheel), *versions)
        run_anew(programs / 'spikelane', *LAP, '--out', folder / 'lap', cwd=folder)
        return folder / 'lap'

    with ThreadPoolExecutor(1) as background:
        yield {
            python: background.submit(drive, python, tmp_path_factory.mktemp('further'))
            for python in other_pythons
        }
        background.shutdown(cancel_futures=True)


@pytest.fixture(scope='module')
def library(wheel: Path, run_anew: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give an environment with the library and no extras."""
    folder = tmp_path_factory.mktemp('library')
    run_anew(sys.executable, '-m', 'venv', folder / 'venv')
    pip = [folder / 'venv/bin/python', '-m', 'pip', 'install', '-q', '--no-compile']
    run_anew(*pip, wheel, *pinned(folder))
    return folder / 'venv'


def is_lowest(python: str) -> bool:
    """Whether the lowest versions of the dependencies are tried with a Python."""
    return python.endswith('3.10')


def add(run: Run, python: Path, *wanted: str) -> None:
    """Install into an environment, as the set-up does: in a fraction of pip's time."""
    run(VENV / 'python', '-I', ROOT / 'setup/install.py', '--python', python, *wanted)


def pinned(folder: Path) -> list[str]:
    """Return pip's arguments for the versions that the set-up installs."""
    numpy = re.search('^numpy==[0-9.]+', (ROOT / 'requirements/wheels.txt').read_text(), re.M)
    assert numpy
    file = folder / 'numpy.txt'
    file.write_text(numpy[0])
    return ['-c', str(CONSTRAINTS), '-c', str(file)]


def lowest(metadata: Message, folder: Path) -> list[str]:
    """Return pip's arguments for the lowest version of each dependency that is said to do."""
    required = [Requirement(text) for text in metadata.get_all('Requires-Dist', [])]
    file = folder / 'lowest.txt'
    file.write_text('\n'.join(f'{each.name}=={lower_bound(each)}' for each in required))
    return ['-c', str(file)]


def lower_bound(requirement: Requirement) -> str:
    """Return the lowest version that a requirement allows."""
    [bound] = [each.version for each in requirement.specifier if each.operator == '>=']
    return bound


def rows(lap: Path) -> Iterator[list[str]]:
    """Yield the rows of a lap's trajectory."""
    with (lap / 'trajectory.csv').open(newline='') as file:
        yield from csv.reader(file)


def files_in(folder: Path) -> Iterator[Path]:
    """Yield the files in a folder and those below it, but for compiled ones."""
    for path in folder.rglob('*'):
        if path.is_file() and '__pycache__' not in path.parts:
            yield path


def test_the_wheel_has_all_files_and_no_others(wheel: Path) -> None:
    """Weights, URDFs, courses and page templates as well as modules, the nodes' parameters too."""
    with ZipFile(wheel) as file:
        names = {name for name in file.namelist() if '.dist-info/' not in name}
    parameters = {name for name in names if '.data/' in name}
    expected = {
        path.relative_to(folder.parent).as_posix()
        for folder in MODULES
        for path in files_in(folder)
    }
    assert names - parameters == expected | {'spikelane_entry.py', 'spikelane_sim_entry.py'}
    assert {
        'spikelane/experiment/paper.yaml',
        'spikelane/report/page.html',
        'spikelane_controllers/rstdp/weights/scenario_3.safetensors',
        'spikelane_sim/courses/scenario_1.yaml',
        'spikelane_sim/robots/pioneer.urdf',
    } <= expected
    shared = 'spikelane-0.1.0.data/data/share/'
    assert f'{shared}spikelane_controllers/config/rstdp.yaml' in parameters
    assert len(parameters) == len(
        [*ROOT.glob('*/config/*'), *ROOT.glob('ros2_ws/src/spikelane/config/*')]
    )


@pytest.mark.parametrize('modules', MODULES, ids=lambda path: path.name)
def test_colcon_builds_the_same_files(modules: Path, tmp_path: Path) -> None:
    """Without links, as on somebody's robot: setup.py names all kinds of data."""
    command = [sys.executable, 'setup.py', '-q', 'build_py', '--build-lib', str(tmp_path)]
    subprocess.run(command, cwd=modules.parent, check=True)
    built = {path.relative_to(tmp_path).as_posix() for path in files_in(tmp_path)}
    expected = {path.relative_to(modules.parent).as_posix() for path in files_in(modules)}
    assert built - {'spikelane_entry.py', 'spikelane_sim_entry.py'} == expected


def test_each_dependency_has_a_lower_bound(metadata: Message) -> None:
    """And the versions that are pinned for the set-up are allowed."""
    required = [Requirement(text) for text in metadata.get_all('Requires-Dist', [])]
    assert len(required) > 15
    for each in required:
        assert lower_bound(each)
        if each.marker is None or each.marker.evaluate({'extra': 'learn'}):
            assert each.specifier.contains(version(each.name)), each


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_the_library_does_everything_without_ros(
    library: Path,
    here: Path,
    laps: dict[str, Future[Path]],
    run_anew: Run,
    tmp_path: Path,
) -> None:
    """The same laps, trainings and rewards to the bit as the checkout; what lacks is told."""
    programs = library / 'bin'
    command = programs / 'spikelane'
    out = tmp_path / 'runs'
    for name, words in (('lap', LAP), ('physics', PHYSICS_LAP), ('training', TRAINING)):
        run_anew(command, *words, '--out', out / name, cwd=tmp_path)
    for name in ('lap', 'physics'):
        assert list(rows(out / name)) == list(rows(here / name))
    checkpoint = 'training/checkpoint.safetensors'
    expected, learnt = load_file(here / checkpoint), load_file(out / checkpoint)
    assert learnt.keys() == expected.keys()
    for name in expected:
        np.testing.assert_array_equal(learnt[name], expected[name])
    for words in (
        ['report', out],
        ['replay', ROOT / 'tests/data/bag_zstd', '--controller', 'braitenberg'],
        ['evaluate', '--engine', 'kinematic'],
        ['experiment', ROOT / 'experiments/rstdp.yaml', '--dry-run'],
        ['course', 'random:3'],
    ):
        run_anew(command, *words, cwd=tmp_path)
    own = shutil.copytree(ROOT / 'docs/examples/balance', tmp_path / 'own')
    run_anew(programs / 'python', '-m', 'pip', 'install', '-q', '-e', '.', cwd=own)
    run_anew(command, *LAP, '--controller', 'balance', cwd=tmp_path)
    run_anew(command, 'train', 'learning_balance', '--steps', '500', cwd=tmp_path)
    said = run_anew(programs / 'python', '-I', '-c', EPISODE, cwd=tmp_path)
    assert json.loads(said) == rewards_here()
    check_errors(command, tmp_path)


#: Stable-Baselines3 learns in a vector of environments.
LEARN = """
import gymnasium, spikelane
from spikelane_sim.stable_baselines import VectorEnvAdapter
from stable_baselines3 import PPO
simulator = {'robot.engine': 'kinematic'}
name = 'spikelane/LaneKeeping-v0'
envs = gymnasium.make_vec(name, num_envs=2, autoreset_mode='SameStep', simulator=simulator)
assert PPO('MlpPolicy', VectorEnvAdapter(envs), n_steps=8, batch_size=16).learn(16)
"""

#: What each extra is for, with the module that it brings: arguments of Python.
EXTRAS = {
    'nir': ('nir', ['-m', 'spikelane.main', 'export', 'nir', 'scenario_1', 'lane.nir']),
    'ray': ('ray', ['-m', 'spikelane.main', 'experiment', 'one.yaml', '--engine', 'ray']),
    'view': ('rerun', ['-c', VIEWER]),
    'sb3': ('stable_baselines3', ['-c', LEARN]),
    'learn': (
        'torch',
        [
            *('-m', 'spikelane.main', 'train', 'dqn', '--steps', '40', *AT_ONCE),
            *('--param', 'dqn.q_learning.backend=torch'),
        ],
    ),
}


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize('extra', EXTRAS)
def test_an_extra_brings_what_it_is_for(
    extra: str, wheel: Path, library: Path, run_anew: Run, tmp_path: Path
) -> None:
    """Without it the module is not there; with it, and nothing else, the command does its work.

    The environment is a copy of the library's, with links to its files.
    """
    module, arguments = EXTRAS[extra]
    shutil.copytree(library, tmp_path / 'venv', symlinks=True, copy_function=os.link)
    python = tmp_path / 'venv/bin/python'
    missing = f'import importlib.util; assert importlib.util.find_spec({module!r}) is None'
    run_anew(python, '-c', missing)
    add(run_anew, python, f'{wheel}[{extra}]', *pinned(tmp_path))
    (tmp_path / 'one.yaml').write_text(ONE_RUN)
    run_anew(python, *arguments, cwd=tmp_path)


def rewards_here() -> list[float]:
    """Return the rewards of EPISODE."""
    env = gymnasium.make('spikelane/LaneKeeping-v0', scenario=2)
    env.reset(seed=3)
    rewards = [float(env.step(action)[1]) for action in (1, 0, 1, 2, 1)]
    env.close()
    return rewards


def check_errors(command: Path, folder: Path) -> None:
    """Check what is said where something lacks: in one line, with what to do."""
    checkout = 'source install/setup.bash, or use ./spikelane in a checkout, which sets ROS 2 up'
    learn = "pip install 'spikelane[learn]', or setup/bootstrap learn in a checkout"
    for words, error in {
        'lap': f'{checkout}; --transport inprocess needs none',
        'node simulator': f'AMENT_PREFIX_PATH, got none: {checkout}',
        'view --controller rstdp': f'AMENT_PREFIX_PATH, got none: {checkout}',
        'train dqn --param dqn.q_learning.backend=torch': learn,
        'transfer': learn,
    }.items():
        done = subprocess.run(
            [command, *words.split()],
            cwd=folder,
            env={'PATH': os.defpath},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode in (1, 2), words
        assert done.stderr.endswith(f'{error}\n'), done.stderr
        assert done.stderr.count('\n') == 1


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_a_further_python_drives_the_same_lap(
    further_python: str, laps: dict[str, Future[Path]], here: Path
) -> None:
    """To the bit with the set-up's versions; nearly with the lowest ones, on Python 3.10."""
    (first, *expected), (header, *driven) = rows(here / 'lap'), rows(laps[further_python].result())
    assert (header, len(driven)) == (first, len(expected))
    if not is_lowest(further_python):
        assert driven == expected
    distance, events = header.index('distance_m'), header.index('events')
    for row, other in zip(driven, expected, strict=True):
        assert float(row[distance]) == pytest.approx(float(other[distance]), abs=1e-9)
        assert row[events] == other[events]


def test_modules_that_are_not_installed_say_so(tmp_path: Path) -> None:
    """Where they are only on the path, nothing is registered: that is told, and what to do."""
    for name in ('spikelane_sim', 'spikelane_controllers'):
        (tmp_path / name).symlink_to(next(path for path in MODULES if path.name == name))
    for code, group in {
        'from spikelane_controllers.registry import make_controller as make': 'controllers',
        'from spikelane_sim.robots.registry import engine as make': 'engines',
    }.items():
        paths = [str(tmp_path), *(path for path in sys.path if path.endswith('site-packages'))]
        isolated = f'import sys; sys.path = {paths!r} + sys.path; {code}; make("kinematic")'
        done = subprocess.run(
            [sys.executable, '-I', '-c', isolated], capture_output=True, text=True, check=False
        )
        assert f'spikelane.{group}: expected the entry points of ' in done.stderr
        assert 'run `pip install .` or `setup/bootstrap run` in the repository' in done.stderr
