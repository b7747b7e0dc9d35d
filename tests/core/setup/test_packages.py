"""What the packages say of themselves in package.xml and setup.py, and `colcon test`."""

import ast
from pathlib import Path
import re
import subprocess
import sys
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[3]
PYTHON_PACKAGES = {
    'spikelane_sim': ROOT / 'sim_bridge',
    'spikelane_controllers': ROOT / 'controllers',
    'spikelane': ROOT / 'ros2_ws/src/spikelane',
}
MANIFESTS = [
    *(folder / 'package.xml' for folder in PYTHON_PACKAGES.values()),
    *sorted((ROOT / 'msgs').glob('*/package.xml')),
    ROOT / 'docs/examples/balance/package.xml',
]
#: The keys in rosdep's list (ros/rosdistro, rosdep/python.yaml) of what is imported under a name.
KEYS = {
    'PIL': 'python3-pil',
    'gymnasium': 'python3-gymnasium-pip',
    'h5py': 'python3-h5py',
    'jinja2': 'python3-jinja2',
    'matplotlib': 'python3-matplotlib',
    'numba': 'python3-numba',
    'numpy': 'python3-numpy',
    'pandas': 'python3-pandas',
    'pybullet': 'python3-pybullet-pip',
    'rich': 'python3-rich',
    'rosbags': 'python3-rosbags-pip',
    'scipy': 'python3-scipy',
    'yaml': 'python3-yaml',
}
#: They come with others: the first two with rosbags, the last with rerun.
COME_ALONG = {'apsw', 'lz4', 'rerun_cli'}
#: Asked for by a file of requirements, or under another name.
IN_FILES = {'rerun': 'requirements/view.txt', 'stable_baselines3': 'stable-baselines3'}


def imported(folder: Path) -> set[str]:
    """Return the names of all that a package imports other than itself and Python's library."""
    names = set()
    for file in folder.rglob('*.py'):
        if file.name == 'setup.py':
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names.add((node.module or '').partition('.')[0])
    own = {path.parent.name for path in folder.glob('*/__init__.py')}
    own |= {'spikelane_entry', 'spikelane_sim_entry'}  # of packages that are named anyway
    return names - set(sys.stdlib_module_names) - own


def depended_on(package: str) -> set[str]:
    """Return what a package's manifest names, as rosdep reads it."""
    manifest = ElementTree.parse(PYTHON_PACKAGES[package] / 'package.xml').getroot()
    return {each.text or '' for each in manifest.iterfind('exec_depend')}


def by_pip(package: str) -> set[str]:
    """Return what the pip lines in the comments of a package's manifest install."""
    text = (PYTHON_PACKAGES[package] / 'package.xml').read_text(encoding='utf-8')
    lines = re.findall(r'pip install (.*?) -c requirements/constraints.txt', text)
    return {word for line in lines for word in line.split()}


@pytest.mark.parametrize('package', PYTHON_PACKAGES)
def test_what_a_package_imports_is_what_its_manifest_names(package: str) -> None:
    """By rosdep's key, or in a pip line where there is none; and nothing else."""
    names = imported(PYTHON_PACKAGES[package]) - COME_ALONG
    keys = depended_on(package)
    without_key = {IN_FILES.get(name, name) for name in names if KEYS.get(name, name) not in keys}
    all_or_tests = {'-r', 'requirements/run.txt', 'requirements/test.txt'}
    assert without_key == by_pip(package) - all_or_tests
    assert keys - {KEYS.get(name, name) for name in names} == set()


@pytest.mark.parametrize('name', [*KEYS.values(), 'torch', 'nir', 'ray', 'mcap', 'safetensors'])
def test_a_key_is_named_by_one_package_at_least(name: str) -> None:
    """Otherwise the test above could have compared nothing."""
    assert any(name in depended_on(each) | by_pip(each) for each in PYTHON_PACKAGES)


@pytest.mark.parametrize('manifest', MANIFESTS, ids=lambda file: file.parent.name)
def test_no_address_is_somebody_elses(manifest: Path) -> None:
    """example.org is a real domain; .invalid can never be one."""
    setup = manifest.with_name('setup.py')
    for file in (manifest, setup):
        text = file.read_text(encoding='utf-8') if file.exists() else ''
        assert set(re.findall(r'@[\w.-]+\.(\w+)', text)) <= {'invalid'}
    assert '@' in manifest.read_text(encoding='utf-8')


@pytest.mark.ros
@pytest.mark.slow
def test_colcon_runs_the_tests_of_each_package(tmp_path: Path) -> None:
    """With pytest, each those that import it; `colcon list` and `--packages-select` are there."""
    colcon = [sys.executable, '-m', 'colcon', '--log-base', str(tmp_path / 'log')]
    results = tmp_path / 'results'
    layout = ['--merge-install'] if (ROOT / 'ros2_ws/install/lib').is_dir() else []
    command = [*colcon, 'test', *layout, '--test-result-base', str(results)]
    command += ['--packages-select', *PYTHON_PACKAGES]
    command += ['--pytest-args', '-k', 'test_kinds or test_card or test_lock']
    subprocess.run(command, cwd=ROOT / 'ros2_ws', check=True, capture_output=True)
    for package, module in (
        ('spikelane_sim', 'test_kinds'),
        ('spikelane_controllers', 'test_card'),
        ('spikelane', 'test_lock'),
    ):
        cases = list(ElementTree.parse(results / package / 'pytest.xml').iter('testcase'))
        assert cases
        assert not [each for case in cases for each in case if each.tag != 'skipped']
        assert {case.get('classname', '').rpartition('.')[2] for case in cases} == {module}
    listed = subprocess.run(
        [*colcon, 'list', '--names-only'],
        cwd=ROOT / 'ros2_ws',
        check=True,
        capture_output=True,
        text=True,
    )
    assert set(PYTHON_PACKAGES) < set(listed.stdout.split())
