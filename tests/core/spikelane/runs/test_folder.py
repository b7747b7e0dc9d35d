"""The folder a run leaves."""

import os
from pathlib import Path
import re
import subprocess
import sys

import numpy as np
import pytest
import yaml

from spikelane.runs import folder as run_folder
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder, RunFolderError, versions
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.replay.config import ReplayConfig


def test_a_lap_is_named_after_what_determines_it() -> None:
    """Scenario, controller, lane and seed are in the name."""
    config = LapConfig.make(Request('1', 'braitenberg', 7, 'inprocess', {}), 'outer')
    assert config.usual_name == 'lap-1-braitenberg-outer-seed7'


def test_a_new_folder_has_the_name_wanted(tmp_path: Path) -> None:
    """Folders above it are made too."""
    folder = RunFolder.create(tmp_path / 'runs' / 'with space')
    assert folder.path == tmp_path / 'runs' / 'with space'
    assert folder.path.is_dir()


def test_the_next_runs_of_a_name_are_numbered_from_two(tmp_path: Path) -> None:
    """What is there, even if empty, is another run's."""
    paths = [RunFolder.create(tmp_path / 'lap').path for _ in range(3)]
    assert [path.name for path in paths] == ['lap', 'lap-2', 'lap-3']


def test_a_file_of_that_name_is_left_alone(tmp_path: Path) -> None:
    """The run moves on to the next number."""
    (tmp_path / 'lap').write_text('mine')
    assert RunFolder.create(tmp_path / 'lap').path.name == 'lap-2'
    assert (tmp_path / 'lap').read_text() == 'mine'


def test_an_exact_folder_may_exist_empty(tmp_path: Path) -> None:
    """As `mktemp -d` makes it."""
    assert RunFolder.create(tmp_path, numbered=False).path == tmp_path


def test_an_exact_folder_with_files_is_refused(tmp_path: Path) -> None:
    """Nothing of another run is written over."""
    (tmp_path / 'metrics.json').write_text('{}')
    with pytest.raises(RunFolderError, match='expected a new or empty folder'):
        RunFolder.create(tmp_path, numbered=False)


@pytest.mark.parametrize('numbered', [True, False])
def test_a_folder_below_a_file_is_refused(tmp_path: Path, numbered: bool) -> None:
    """One sentence names the folder that cannot be made."""
    (tmp_path / 'file').write_text('')
    with pytest.raises(RunFolderError, match=r'file.*: cannot be made: '):
        RunFolder.create(tmp_path / 'file' / 'lap', numbered=numbered)


def test_a_configuration_carries_the_versions(tmp_path: Path) -> None:
    """What was given and the versions come after the values."""
    folder = RunFolder.create(tmp_path / 'lap')
    given = {'sensor.crop_left': 2}
    config = ReplayConfig.make(Request('1', 'braitenberg', 3, parameters=given), Path('bag'))
    folder.write_config(config, ['replay', 'bag'])
    read = yaml.safe_load(folder.config.read_text())
    assert list(read)[:2] == ['bag', 'events_topic']
    assert list(read)[-3:] == ['given', 'command_line', 'versions']
    assert (read['bag'], read['seed'], read['sensor']['crop_left']) == ('bag', 3, 2)
    assert (read['given'], read['command_line']) == (given, ['replay', 'bag'])
    assert read['versions']['numpy'] == np.__version__


def test_versions_name_what_computes() -> None:
    """Python is one of them; what is not installed is None."""
    assert list(versions()) == [
        *('python', 'spikelane', 'numpy', 'numba', 'pybullet', 'torch'),
        *('commit', 'machine'),
    ]
    assert str(versions()['python']).startswith('3.')
    # 3.2.7 of pybullet, 3.2.8 of pybullet-arm64.
    assert str(versions()['pybullet']) == ('3.2.8' if sys.version_info >= (3, 12) else '3.2.7')


def test_metrics_are_plain_json(tmp_path: Path) -> None:
    """NumPy's numbers become numbers, in the order given."""
    folder = RunFolder.create(tmp_path / 'lap')
    folder.write_metrics({'steps': np.int64(4), 'bag': Path('a/b'), 'd': np.array([0.5, 1.0])})
    assert folder.metrics.read_text() == (
        '{\n  "steps": 4,\n  "bag": "a/b",\n  "d": [\n    0.5,\n    1.0\n  ]\n}\n'
    )


def test_the_commit_is_that_of_the_checkout() -> None:
    """As git says it, whatever differs from it; none where the source is not git's."""
    source = Path(run_folder.__file__).resolve().parent
    head = subprocess.run(
        ['git', '-C', str(source), 'rev-parse', 'HEAD'], capture_output=True, text=True
    )
    expected = head.stdout[:12] if head.returncode == 0 else None
    found = versions()['commit']
    assert (found and found.rstrip('+')) == expected


def test_a_package_in_somebody_elses_checkout_has_no_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The commit of a repository that only has it among its ignored files is not its own."""
    git = ['git', '-C', str(tmp_path), '-c', 'user.name=x', '-c', 'user.email=x']
    subprocess.run([*git, 'init', '-q'], check=True)
    subprocess.run([*git, 'commit', '-q', '--allow-empty', '-m', 'x'], check=True)
    (tmp_path / 'installed.py').write_text('')
    monkeypatch.setattr(run_folder, '__file__', str(tmp_path / 'installed.py'))
    assert run_folder.commit.__wrapped__() is None
    subprocess.run([*git, 'add', 'installed.py'], check=True)
    commit = str(run_folder.commit.__wrapped__())
    assert re.fullmatch(r'[0-9a-f]{12}\+', commit)


def test_the_machine_is_told() -> None:
    """Its processors, and how many there are."""
    assert f', {os.cpu_count()} x ' in str(versions()['machine'])
