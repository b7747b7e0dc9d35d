"""`spikelane compare`: two folders of runs."""

import json
from pathlib import Path

import pytest

from spikelane.main import run


@pytest.fixture(scope='module')
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Give evaluations on three courses: two settings."""
    root = tmp_path_factory.mktemp('compare')
    found = {}
    for name, scenario, gain in (('a', 'random:3', '1.5'), ('b', 'random:3', '1.2')):
        found[name] = root / name
        arguments = ['evaluate', '--controller', 'rstdp', '--robot', 'kinematic']
        arguments += ['--courses', scenario, '--lanes', 'outer', '--out', str(found[name])]
        arguments += ['--param', f'rstdp.steering.v_max={gain}', '--json']
        assert run(arguments) == 0
    return found


def test_two_settings_are_compared(
    folders: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """Over the courses, by what each evaluation has in its metrics."""
    capsys.readouterr()
    assert run(['compare', str(folders['a']), str(folders['b']), '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    rows = {row['measure']: row for row in result['differences']}
    row = rows['steps of a lap, outer lane (mean)']
    means = []
    for folder in (folders['a'], folders['b']):
        laps = json.loads((folder / 'metrics.json').read_text())['laps']
        assert all(lap['completed'] for lap in laps)
        means.append(sum(lap['lap_time_s'] for lap in laps) / len(laps) / 0.05)
    assert [row['first'], row['second']] == pytest.approx(means)
    assert row['difference'] == pytest.approx(means[1] - means[0])
    assert row['ci_low'] < row['difference'] < row['ci_high']
    assert row['n'] == [3, 3]
    assert row['unit'] == 'course'
    share = rows['all laps completed']
    assert (share['first'], share['second'], share['p_value']) == (1.0, 1.0, 1.0)


def test_the_table_says_the_same(
    folders: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """In words, with what the tests are called."""
    capsys.readouterr()
    assert run(['compare', str(folders['a']), str(folders['b'])]) == 0
    text = capsys.readouterr().out
    assert 'all laps completed' in text
    assert "Welch's t-test" in text


def test_what_cannot_be_compared_is_refused(
    folders: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No runs, two settings in one folder, nothing in common: one line and exit status 2."""
    parent = folders['a'].parent
    training = tmp_path / 'training'
    arguments = ['train', 'rstdp', '--robot', 'kinematic', '--steps', '50', '--json']
    assert run([*arguments, '--out', str(training)]) == 0
    capsys.readouterr()
    for pair, reason in (
        ((folders['a'], tmp_path / 'none'), 'expected a folder of runs, got none'),
        ((parent, folders['a']), 'expected runs of one controller and setting, got 2: '),
        ((folders['a'], training), 'expected a scenario and a measure in common, got '),
    ):
        assert run(['compare', *map(str, pair)]) == 2
        [line] = capsys.readouterr().err.splitlines()
        assert line.startswith('spikelane compare: ')
        assert reason in line
