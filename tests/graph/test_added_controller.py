"""Controllers of another package, the example in the docs: installed by pip, driven, taught."""

from __future__ import annotations

from collections.abc import Callable
import json
import os
from pathlib import Path
import re
import shlex
import shutil
import subprocess
import sys
from typing import Any

from domain_coordinator import domain_id
import numpy as np
import pytest

from spikelane_controllers.checkpoint import read_checkpoint

pytestmark = pytest.mark.ros

DOCS = Path(__file__).parents[2] / 'docs'
EXAMPLE = DOCS / 'examples/balance'
NORSE = DOCS / 'examples/norse'
DEADLINE_S = 250

Run = Callable[..., dict[str, Any]]

#: Another package: two controllers that break the contract.
BROKEN = {
    'pyproject.toml': """
[project]
name = 'broken_controllers'
version = '0.1.0'

[project.entry-points.'spikelane.controllers']
forgetful = 'broken_controllers:Forgetful'
by_process = 'broken_controllers:ByProcess'

[project.entry-points.'spikelane.trainings']
forgetful = 'spikelane_controllers.learning.training:Training'
by_process = 'spikelane_controllers.learning.training:Training'

[build-system]
requires = ['setuptools>=64']
build-backend = 'setuptools.build_meta'
""",
    'broken_controllers.py': """
import os

from my_controllers.learning_balance import LearningBalance
from spikelane_sim.contract import WheelVelocities


class ByProcess(LearningBalance):
    # Drives otherwise in another process.
    def _turn(self, observation):
        return super()._turn(observation) + 1e-9 * os.getpid()


class Forgetful:
    # Has no attribute parameters.
    parameters_class = LearningBalance.parameters_class

    def __init__(self, parameters):
        self.learning = parameters.learning

    def initialise(self, rng):
        pass

    def reset(self, rng):
        pass

    def step(self, observation):
        return WheelVelocities(1.0, 1.0)

    def state(self):
        return {'learning': self.learning}

    def restore(self, state):
        self.learning = state['learning']
""",
}


@pytest.fixture(scope='module')
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder with copies of the examples and of the broken package, installed by pip.

    They are installed into an environment of its own, `venv`, which has all that this one has.
    """
    workspace = tmp_path_factory.mktemp('my work')
    subprocess.run([sys.executable, '-m', 'venv', '--without-pip', workspace / 'venv'], check=True)
    python = workspace / 'venv/bin/python'
    ask = [python, '-c', 'import sysconfig; print(sysconfig.get_path("purelib"))']
    told = subprocess.run(ask, check=True, capture_output=True, text=True)
    libraries = {str(Path(pytest.__file__).parents[1]), str(Path(np.__file__).parents[1])}
    lines = [f'import site; site.addsitedir({each!r})' for each in sorted(libraries)]
    Path(told.stdout.strip(), 'libraries.pth').write_text('\n'.join(lines), encoding='utf-8')
    for example in (EXAMPLE, NORSE):
        shutil.copytree(example, workspace / example.name)
    for name, text in BROKEN.items():
        path = workspace / 'broken' / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text.lstrip(), encoding='utf-8')
    packages = [part for name in ('balance', 'norse', 'broken') for part in ('-e', f'./{name}')]
    pip = [python, '-m', 'pip', 'install', *packages]
    done = subprocess.run(pip, cwd=workspace, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return workspace


def run_python(
    workspace: Path, *arguments: str, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run the Python that the packages are installed for."""
    # An interrupt lets it end its nodes, too.
    limit = ['timeout', '-s', 'INT', '-k', '20', str(DEADLINE_S)]
    return subprocess.run(
        [*limit, workspace / 'venv/bin/python', *arguments],
        cwd=workspace,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'} | environment,
    )


@pytest.fixture(scope='module')
def run(workspace: Path) -> Run:
    """Give `spikelane COMMAND ...` in the workspace."""

    def run_command(*arguments: str, status: int = 0, robot: str = 'kinematic') -> dict[str, Any]:
        given = (*arguments, '--robot', robot, '--json')
        ended = run_python(workspace, '-m', 'spikelane.main', *given)
        assert ended.returncode == status, ended.stderr
        result = json.loads(ended.stdout)
        return result | {'folder': str(workspace / result['folder'])}

    return run_command


def test_the_page_shows_the_files_that_are_tested() -> None:
    """Each as it is, and no Python file is left out."""
    page = (DOCS / 'add_a_controller.md').read_text('utf-8')
    shown = dict(
        re.findall(r'^\[`[^`]+`\]\((examples/\S+)\)\n\n```\w+\n(.*?)```', page, re.M | re.S)
    )
    for path, text in shown.items():
        assert (DOCS / path).read_text('utf-8') == text
    names = {Path(path).name for path in shown if path.startswith('examples/balance/')}
    modules = {'balance.py', 'cards.py', 'learning_balance.py', 'metered.py'}
    assert names == modules | {'pyproject.toml', 'setup.py'}


def test_a_controller_takes_one_module_one_card_and_one_entry_point() -> None:
    """In a package as any: `pyproject.toml` for pip; the four other files are for colcon."""
    files = {
        str(path.relative_to(EXAMPLE))
        for path in EXAMPLE.rglob('*')
        if path.is_file() and '__pycache__' not in path.parts
    }
    modules = ('__init__', 'balance', 'cards', 'learning_balance', 'metered')
    assert files == {
        'pyproject.toml',
        *(f'my_controllers/{each}.py' for each in modules),
        *('package.xml', 'resource/my_controllers', 'setup.cfg', 'setup.py'),
    }


def test_it_drives_a_lap(run: Run) -> None:
    """As the page says: 0.04 m from the lane's centre."""
    result = run('lap', '--controller', 'balance', '--transport', 'inprocess')
    assert result['completed']
    assert result['mean_abs_distance_m'] == pytest.approx(0.04, abs=0.005)


def test_its_node_drives_as_in_one_process(run: Run) -> None:
    """The same trajectory, bit for bit, with a parameter of its own."""
    rows = []
    for transport in ('inprocess', 'ros'):
        result = run(
            'lap', '--controller', 'balance', '--transport', transport,
            '--param', 'balance.gain_rad_s=0.4', '--param', 'simulator.episode.max_steps=100',
            status=1,
        )  # fmt: skip
        assert (result['controller'], result['steps']) == ('balance', 100)
        rows.append(Path(result['folder'], 'trajectory.csv').read_text())
    assert rows[0] == rows[1]


def test_encoders_are_the_same_in_one_process_over_ros_and_replayed(
    run: Run, workspace: Path
) -> None:
    """The same trajectory and the same answers; a bag without encoders is refused."""
    limit = ('--param', 'simulator.episode.max_steps=100')
    folders = []
    for transport in ('inprocess', 'ros'):
        drive = ('lap', '--controller', 'metered', '--transport', transport)
        folders.append(run(*drive, *limit, status=1, robot='pybullet')['folder'])
    rows = [Path(folder, 'trajectory.csv').read_text() for folder in folders]
    assert rows[0] == rows[1]
    told = run_python(workspace, '-m', 'spikelane.main', 'replay', f'{folders[1]}/bag', '--json')
    result = json.loads(told.stdout)
    assert (told.returncode, result['answers'], result['equal']) == (0, 101, 101)
    assert replayed_over_ros(workspace, f'{folders[1]}/bag') == (0, 101, 101)
    bare = run('lap', '--controller', 'balance', *limit, '--transport', 'ros', status=1)
    replay = ('replay', f'{bare["folder"]}/bag', '--controller', 'metered')
    told = run_python(workspace, '-m', 'spikelane.main', *replay)
    assert told.returncode == 1
    assert 'expected joint_states of the wheels with the stamp 50000000 ns' in told.stderr
    assert replayed_over_ros(workspace, f'{bare["folder"]}/bag') == (1, None, None)


def replayed_over_ros(workspace: Path, bag: str) -> tuple[int, int | None, int | None]:
    """Replay a bag to the node `metered`; return the status, the answers and the equal ones."""
    nodes = """
"$0" -m spikelane.main node metered &
timeout -s INT 100 "$0" -m spikelane.main node replay --ros-args -p bag:="$1"
status=$?
kill -TERM %1; wait %1
exit $status
"""
    with domain_id() as domain:
        ended = subprocess.run(
            ['bash', '-c', nodes, workspace / 'venv/bin/python', bag],
            cwd=workspace,
            capture_output=True,
            text=True,
            check=False,
            env=os.environ
            | {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'},
        )
    result = json.loads(ended.stdout or '{}')
    return ended.returncode, result.get('answers'), result.get('equal')


def test_what_learns_is_trained_and_resumed(run: Run) -> None:
    """Over ROS, and in two parts, the checkpoint is the same; it is driven with."""
    learn = ('train', 'learning_balance', '--param')
    limit = 'simulator.episode.max_steps=150'
    whole = run(*learn, limit, '--steps', '400')
    over_ros = run(*learn, limit, '--steps', '400', '--transport', 'ros', '--out', 'ros')
    run(*learn, limit, '--steps', '200', '--out', 'parts')
    parts = run(*learn, limit, '--steps', '400', '--out', 'parts', '--resume')
    folders = [Path(result['folder']) for result in (whole, over_ros, parts)]
    (state, facts), *others = [read_checkpoint(path, 'learning_balance') for path in folders]
    for other, about in others:
        assert about['controller'] == facts['controller']
        for name, value in state.items():
            np.testing.assert_array_equal(other[name], value)
    assert facts['controller']['offset'] != 0.0
    assert facts['terminations'][0][-1] == 'step_limit'
    driven = run('lap', '--controller', 'learning_balance', '--checkpoint', str(folders[0]),
                 '--transport', 'inprocess', '--param', limit, status=1)  # fmt: skip
    config = Path(driven['folder'], 'config.yaml').read_text()
    assert f'checkpoint: {folders[0]}' in config


def test_the_checks_of_the_page_pass(workspace: Path) -> None:
    """In one process, and over ROS with its node."""
    page = (DOCS / 'add_a_controller.md').read_text('utf-8')
    (block,) = re.findall(r'^<!-- run -->\n```sh\n(.*?)^```', page, re.M | re.S)
    told = []
    for line in block.splitlines():
        command, *arguments = shlex.split(line, comments=True)
        assert command == '~/spikelane/spikelane'
        ended = run_python(workspace, '-m', 'spikelane.main', *arguments, '--json')
        assert ended.returncode == 0, ended.stdout + ended.stderr
        told.append(json.loads(ended.stdout))
    assert told == [
        {'controller': name, 'transport': transport, 'passed': True, 'violations': []}
        for name, transport in (('balance', 'inprocess'), ('learning_balance', 'ros'))
    ]


def test_a_network_in_norse_drives_a_lap(run: Run) -> None:
    """With the weights of its package, nearer to the lane's centre than 0.01 m."""
    result = run('lap', '--controller', 'norse_lane', '--transport', 'inprocess', '--seed', '1')
    assert result['completed']
    assert result['mean_abs_distance_m'] < 0.01


def test_a_network_in_norse_drives_the_same_over_ros(workspace: Path) -> None:
    """It keeps all other rules of the contract as well."""
    check = ('check', 'norse_lane', '--transport', 'ros', '--json')
    ended = run_python(workspace, '-m', 'spikelane.main', *check)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert json.loads(ended.stdout)['violations'] == []


def test_a_network_in_norse_learns_to_answer_as_rstdp(run: Run, workspace: Path) -> None:
    """Its error falls to less than half in a short training, whose weights can be driven with."""
    train = ('--steps', '1000', '--updates', '20', '--out', 'learnt.safetensors')
    ended = run_python(workspace, '-m', 'norse_lane.train', *train)
    assert ended.returncode == 0, ended.stderr
    first, last = map(float, re.findall(r'0\.\d+', ended.stdout))
    assert last < first / 2
    weights = ('--param', f'norse_lane.weights={workspace}/learnt.safetensors')
    limit = ('--param', 'simulator.episode.max_steps=20')
    drive = ('lap', '--controller', 'norse_lane', '--transport', 'inprocess')
    assert run(*drive, *weights, *limit, status=1)['reason'] == 'step_limit'
    none = run_python(
        workspace, '-m', 'spikelane.main', *drive, '--param', 'norse_lane.weights=nowhere'
    )
    assert none.returncode == 2
    assert none.stderr.endswith(
        'weights: expected a file that norse_lane.train has written, got nowhere\n'
    )


def test_it_has_a_reference_of_its_parameters(workspace: Path) -> None:
    """Those of its own class and of its training, by `spikelane parameters`."""
    ended = run_python(workspace, '-m', 'spikelane.main', 'parameters', 'learning_balance')
    assert ended.returncode == 0, ended.stderr
    names = re.findall(r'^\| `([^`]*)` \|', ended.stdout, re.M)
    assert {name.partition('.')[0] for name in names} == {'learning_balance', 'training'}
    assert 'training.steps' in names


def test_a_difference_between_processes_is_found_over_ros(workspace: Path) -> None:
    """By the lap and by the training; nothing else is wrong with it."""
    check = ('-m', 'spikelane.main', 'check', 'by_process', '--transport', 'ros', '--json')
    ended = run_python(workspace, *check)
    assert ended.returncode == 1, ended.stderr
    told = json.loads(ended.stdout)
    assert (told['transport'], told['passed']) == ('ros', False)
    assert told['violations'] == [
        'by_process: lap over ROS: expected the same trajectory of 60 steps as in one process, '
        'got another trajectory',
        'by_process: training over ROS: expected the checkpoint of the same training in one '
        'process, got another checkpoint',
    ]


@pytest.mark.parametrize(
    'arguments',
    [
        ('train', 'forgetful', '--transport', 'inprocess'),
        ('train', 'forgetful', '--transport', 'ros'),
        ('node', 'forgetful', '--ros-args', '-p', 'learning:=true', '-p', 'output:=forgotten'),
    ],
)
def test_a_learner_without_parameters_is_refused_alike(
    workspace: Path, arguments: tuple[str, ...]
) -> None:
    """With the same sentence in one process, over ROS and by the node itself; nothing is left."""
    before = sorted(workspace.rglob('runs/*'))
    ended = run_python(workspace, '-m', 'spikelane.main', *arguments)
    assert ended.returncode == 2
    assert ended.stderr.endswith(
        'controller forgetful: expected a controller that can be trained, '
        "got one without attribute 'parameters'\n"
    )
    assert 'Traceback' not in ended.stderr
    assert sorted(workspace.rglob('runs/*')) == before
    assert not (workspace / 'forgotten').exists()


def test_what_learns_is_evaluated_and_reported(run: Run, workspace: Path) -> None:
    """Under the name on its card, with the figure and the tables that every training has."""
    limit = ('--param', 'simulator.episode.max_steps=150')
    learnt = run('train', 'learning_balance', *limit, '--steps', '400', '--out', 'all/trained')
    taken = ('--controller', 'learning_balance', '--checkpoint', learnt['folder'])
    given = ('--transport', 'inprocess', '--seeds', '2', '--out', 'all/evaluated')
    run('evaluate', *taken, *limit, *given)
    ended = run_python(workspace, '-m', 'spikelane.main', 'report', 'all', '--out', 'reported')
    assert ended.returncode == 0, ended.stderr
    page = (workspace / 'reported/report.html').read_text('utf-8')
    assert 'Learning balance training' in page
    assert 'Terminations, Learning balance, scenario 1' in page
    assert len(list((workspace / 'reported/figures').glob('learning_balance_*.svg'))) == 1


def test_what_learns_is_trained_by_a_launch_file(workspace: Path) -> None:
    """It learns though nothing says what its training differs in from driving."""
    pytest.importorskip('launch_ros', reason='ROS launch is not installed')
    runner = Path(__file__).with_name('run_launch.py')
    file = DOCS.parent / 'ros2_ws/src/spikelane/launch/train.launch.py'
    given = ('controller:=learning_balance', 'steps:=100', 'output:=launched')
    with domain_id() as domain:
        environment = {
            'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'ROS_LOG_DIR': str(workspace / 'log'),
        }
        ended = run_python(workspace, str(runner), str(file), *given, **environment)
    assert ended.returncode == 0, ended.stderr
    assert 'ENDED /learning_balance 0\n' in ended.stdout
    facts = read_checkpoint(workspace / 'launched', 'learning_balance').facts
    assert facts['steps'] == 100
